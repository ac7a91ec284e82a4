"""A cord pulls but does not push, or touches a peg: the restoring force differs from side to side."""

from __future__ import annotations

from collections.abc import Sequence

from fitters.effects._domain import has_rest_force, moves_on_a_line, swings
from iris_sysid.types import Array, Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Where something pulls back to the middle, and nothing turns it: no torque acts on a cord."""
    pulled = any(parameter.name == "stiffness" for parameter in model.parameters)
    return (swings(model) or (pulled and moves_on_a_line(model))) and not model.inputs


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float]
) -> float:
    """Minus a share of the base acceleration, on one side."""
    slack, side = params
    return -slack * base * (side * position > 0.0)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Both sides, dimensionless. ``t_s`` (n,), s, and ``observed`` (n, d), in the observed unit, are not used."""
    return [(-1.0,), (1.0,)]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether the cord pulls less there, not more: then it is the other side that counts. ``t_s`` (n,) is not used."""
    return params[0] > 0.0


EFFECT = Effect(
    name="slack-tether",
    summary="a cord that pulls less on one side; s = 1 is a cord that goes slack there",
    equation=r"-s\,\ddot x_0\quad (\sigma x > 0)",
    source="one-sided stiffness; Shaw and Holmes (1983), J. Sound Vib. 90, 129",
    parameters=(
        Parameter("slack_tether", "1", "s", upper=1.5, default=0.0),
        Parameter(
            "slack_side",
            "1",
            r"\sigma",
            lower=-1.0,
            upper=1.0,
            default=-1.0,
            constant=True,
            source="-1 or 1, a diagnosis tries both",
        ),
    ),
    component="force-of-position",
    applies=applies,
    plausibility=0.1,
    acceleration=acceleration,
    acts_at_rest=has_rest_force,
    alike="zero-offset and constant-force, for swings of one size",
    trials=trials,
    sensible=sensible,
    typical="a cord, which cannot push: 1; a bent strip that pushes back a little: less",
    example=EffectExample("pendulum", size=0.05),
)
