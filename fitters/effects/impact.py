"""Something hits: the velocity jumps at one moment."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import moves_on_a_line
from fitters.effects._times import moments
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """A normal pulse whose area is the jump."""
    jump, when, width = params
    late = (t - when) / width
    return jump / (width * 2.5066282746310002) * np.exp(-0.5 * late * late)


EFFECT = Effect(
    name="impact",
    summary="a blow at one moment",
    equation=r"+J\,\delta(t - t_i)",
    source="Newton's second law, integrated over a time that is short against the motion",
    parameters=(
        Parameter("impact", "{x}/s", "J", default=0.0),
        Parameter("impact_time", "s", "t_i", default=0.0, role="moment"),
        Parameter("impact_width", "s", "w_i", lower=1e-9, default=1.0, constant=True, source="frame interval"),
    ),
    component="pulse",
    absorbs=True,
    applies=moves_on_a_line,
    plausibility=0.5,
    acceleration=acceleration,
    alike="dropped-frame",
    trials=moments,
    recurrence="once",
    typical="5 g at 1 m/s that stick to a body of 100 g: 0.05 m/s",
    example=EffectExample("pendulum", size=0.05),
)
