"""The reading is off by the same on both sides: an oblique view, a wrong pivot, a scale that bends."""

from __future__ import annotations

from functools import partial

from fitters.effects._domain import on_a_line
from fitters.effects._readings import middle_and_reach, middle_parameter, reach_parameter, small_part
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + a (observed - middle)^2.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    size, middle, _ = params
    return observed + size * (observed - middle) ** 2


EFFECT = Effect(
    name="even-reading",
    summary="a reading whose error is even in the position",
    equation=r"x_\mathrm{seen} = x + a\,(x - x_m)^2",
    source="Taylor expansion of any smooth reading, second order",
    parameters=(
        Parameter("even_reading", "1/{x}", "a", default=0.0),
        middle_parameter("even_middle"),
        reach_parameter("even_reach"),
    ),
    component="reading-of-position",
    applies=on_a_line,
    cause="measurement",
    plausibility=0.02,  # less than the physical forms, also where no sensor is stated
    observe=observe,
    alike="camera-tilt and wrong-pivot, its physical forms for a camera; gain-change, of a gauge; quadratic forces",
    trials=middle_and_reach,
    sensible=partial(small_part, 2),
    typical="a camera tilted by 5° at a distance of 1 m: 0.09 1/m",
    example=EffectExample("pendulum", size=0.05),
)
