"""What rolls has to be spun up as well: all accelerations are smaller by one factor."""

from __future__ import annotations

from fitters.effects._domain import falls, moves
from fitters.effects._inertia import slowed
from iris_sysid.types import Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Where a body moves along a way, and does not fly."""
    return moves(model) and model.states[0].unit == "m" and not falls(model)


EFFECT = Effect(
    name="rolling-inertia",
    summary="rolling instead of sliding: k = I / (m r^2), 2/5 for a ball",
    equation=r"\ddot x_0\,\left(\frac{1}{1 + k} - 1\right)",
    source="Goldstein (1980), Classical Mechanics, section 1.4",
    parameters=(Parameter("rolling_inertia", "1", "k", lower=-0.5, default=0.0),),
    component="force-of-position",
    applies=applies,
    plausibility=0.3,
    acceleration=slowed,
    alike="the acceleration itself, unless it is known; time-scale",
    scaling={"mass": 0.0, "radius": 0.0},
    typical="solid ball 0.4, solid cylinder 0.5, hollow ball 0.67, hoop 1",
    example=EffectExample("incline", size=0.05),
)
