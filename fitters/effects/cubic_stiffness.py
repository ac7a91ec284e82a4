"""A restoring force that is not linear: a stiff cord, a large angle taken as small."""

from __future__ import annotations

from fitters.effects._domain import is_pulled_back
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """-k x^3."""
    (stiffness,) = params
    return -stiffness * position**3


EFFECT = Effect(
    name="cubic-stiffness",
    summary="a cubic restoring force",
    equation=r"-k_3\,x^3",
    source="Duffing (1918), Erzwungene Schwingungen bei veraenderlicher Eigenfrequenz",
    parameters=(Parameter("cubic_stiffness", "1/{x}^2/s^2", "k_3", default=0.0),),
    component="force-of-position",
    applies=is_pulled_back,
    plausibility=0.3,
    acceleration=acceleration,
    alike="radial-distortion and a wrong scale, which also change the period with the amplitude",
    typical=(
        "a pendulum taken for linear: -g / 6L, -3.3 1/rad^2/s^2 at 0.5 m; a spring of rate α that is 1 % harder at a "
        "stretch A: 0.01 α / A^2"
    ),
    example=EffectExample("pendulum", size=0.05),
)
