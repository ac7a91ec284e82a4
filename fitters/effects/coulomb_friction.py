"""Dry friction: a constant force against the motion."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import rubs
from fitters.effects._friction import sharper, turnover_parameter, turnovers
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float]
) -> float:
    """-c v / |v|, smooth about v = 0."""
    friction, turnover = params
    return -friction * velocity / np.sqrt(speed * speed + turnover * turnover)


EFFECT = Effect(
    name="coulomb-friction",
    summary="dry friction, constant against the motion",
    equation=r"-c\,\dot x / |\dot x|",
    source="Coulomb (1785), Theorie des machines simples",
    parameters=(
        Parameter("coulomb_friction", "{x}/s^2", "c", lower=0.0, default=0.0),
        turnover_parameter("coulomb_turnover", role="form"),
    ),
    component="force-of-velocity",
    applies=rubs,
    acceleration=acceleration,
    # Rolling resistance is this law with a coefficient of 0.001 to 0.02; what of it grows with v^2 is quadratic drag.
    alike="constant-force, while the motion keeps its direction; rolling resistance, which is the same law",
    trials=turnovers,
    nearby=sharper,
    typical=(
        "a ball that rolls on a hard floor: 0.02 to 0.1 m/s^2; wood on wood: 2 to 5 m/s^2; a pendulum of 0.5 m that "
        "loses 0.1° in half a swing: 0.017 rad/s^2"
    ),
    example=EffectExample("pendulum", size=0.05),
)
