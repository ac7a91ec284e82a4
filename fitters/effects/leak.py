"""A second way out at the bottom, too narrow for turbulence: the level falls in proportion to itself."""

from __future__ import annotations

from fitters.effects._domain import drains
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """-l h."""
    (leak,) = params
    return -leak * position


EFFECT = Effect(
    name="leak",
    summary="a narrow leak at the bottom",
    equation=r"-l\,h",
    source="Hagen (1839) and Poiseuille (1840): laminar flow in proportion to the pressure",
    parameters=(Parameter("leak", "1/s", "l", lower=0.0, default=0.0),),
    component="force-of-position",
    applies=drains,
    acceleration=acceleration,
    alike="the decay rate itself, where the decay is exponential",
    typical="a vessel that loses 1 % in 100 s: 0.0001 1/s",
    example=EffectExample("torricelli", size=0.05),
)
