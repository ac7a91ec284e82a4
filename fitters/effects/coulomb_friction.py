"""Dry friction: a constant force against the motion."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import moves
from iris_sysid.types import Effect, EffectExample, Parameter

# Within this speed, relative to 1 unit/s, the sign turns over smoothly, so that the solution is differentiable.
TURNOVER = 3e-2


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """-c v / |v|, smooth about v = 0."""
    (friction,) = params
    return -friction * velocity / np.sqrt(speed * speed + TURNOVER * TURNOVER)


EFFECT = Effect(
    name="coulomb-friction",
    summary="dry friction, constant against the motion",
    equation=r"-c\,\dot x / |\dot x|",
    source="Coulomb (1785), Theorie des machines simples",
    parameters=(Parameter("coulomb_friction", "{x}/s^2", "c", lower=0.0, default=0.0),),
    applies=moves,
    acceleration=acceleration,
    alike="constant-force, while the motion keeps its direction",
    example=EffectExample("pendulum", size=0.05),
)
