"""The force changes with time: a cord that stretches, a battery that runs down."""

from __future__ import annotations

from fitters.effects._domain import any_model
from fitters.effects._times import first_time, start_parameter
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float]
) -> float:
    """The base acceleration, times rate * (t - start)."""
    rate, start = params
    return base * rate * (t - start)


EFFECT = Effect(
    name="parameter-drift",
    summary="forces that change slowly with time",
    equation=r"\ddot x_0\,\epsilon\,(t - t_0)",
    source="first-order expansion of a slowly varying parameter",
    parameters=(Parameter("parameter_drift", "1/s", r"\epsilon", default=0.0), start_parameter("drift_start")),
    component="own-force-drift",
    absorbs=True,
    applies=any_model,
    plausibility=0.3,
    acceleration=acceleration,
    trials=first_time,
    alike="time-scale errors that grow; frequency that depends on amplitude, in a damped swing",
    recurrence="anew",
    typical="a steel spring that warms by 10 K in a minute: -0.00004 1/s",
    example=EffectExample("pendulum", size=0.05),
)
