"""The force changes with time: a cord that stretches, a battery that runs down."""

from __future__ import annotations

from fitters.effects._domain import any_model
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """The base acceleration, times rate * t."""
    (rate,) = params
    return base * rate * t


EFFECT = Effect(
    name="parameter-drift",
    summary="forces that change slowly with time",
    equation=r"\ddot x_0\,\epsilon\,t",
    source="first-order expansion of a slowly varying parameter",
    parameters=(Parameter("parameter_drift", "1/s", r"\epsilon", default=0.0),),
    applies=any_model,
    acceleration=acceleration,
    alike="time-scale errors that grow; frequency that depends on amplitude, in a damped swing",
    example=EffectExample("pendulum", size=0.05),
)
