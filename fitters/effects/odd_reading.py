"""The scale of the reading depends on the position: a lens, a gauge's curve, an angle read as its sine."""

from __future__ import annotations

from functools import partial

from fitters.effects._domain import on_a_line
from fitters.effects._readings import middle_and_reach, middle_parameter, reach_parameter, small_part
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + b (observed - middle)^3.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    size, middle, _ = params
    return observed + size * (observed - middle) ** 3


EFFECT = Effect(
    name="odd-reading",
    summary="a reading whose scale changes with the distance from the middle",
    equation=r"x_\mathrm{seen} = x + b\,(x - x_m)^3",
    source="Taylor expansion of any smooth reading, third order",
    parameters=(
        Parameter("odd_reading", "1/{x}^2", "b", default=0.0),
        middle_parameter("odd_middle"),
        reach_parameter("odd_reach"),
    ),
    component="reading-of-position",
    applies=on_a_line,
    cause="measurement",
    plausibility=0.008,  # less than the physical forms, also where no sensor is stated
    observe=observe,
    alike="radial-distortion, its physical form for a camera; cubic-stiffness; clearance",
    trials=middle_and_reach,
    sensible=partial(small_part, 3),
    typical="a sine taken for the angle: -0.17 1/rad^2",
    example=EffectExample("pendulum", size=0.05),
)
