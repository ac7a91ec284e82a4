"""Above a critical speed the flow about a ball becomes turbulent, and its drag coefficient falls to a quarter."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.effects._domain import falls
from fitters.effects._friction import largest_speed
from iris_sysid.types import Array, Effect, EffectExample, Parameter

FALL = 0.75  # of the drag coefficient: from 0.47 to about 0.12
WIDTH = 0.1  # of the critical speed, over which it falls
SHARES = (0.4, 0.55, 0.7, 0.85)  # of the largest speed, tried as the critical one
SLOWEST, FASTEST = 0.25, 0.95  # of the largest speed: below or above, the crisis is not in the clip


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """-c |v| v; three quarters of it are lost above the critical speed, smoothly."""
    drag, critical, _ = params
    beyond = 0.5 * (1.0 + np.tanh((speed - critical) / (2.0 * WIDTH * critical)))
    return -drag * (1.0 - FALL * beyond) * speed * velocity


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Critical speeds, and the largest speed, per second. ``t_s`` (n,), s; ``observed`` (n, d), in its unit."""
    fastest = largest_speed(t_s, observed)
    return [(share * fastest, fastest) for share in SHARES]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether it brakes, and the critical speed is one of the clip's: else it is plain drag. ``t_s`` is not used."""
    drag, critical, fastest = params
    return drag > 0 and SLOWEST * fastest < critical < FASTEST * fastest


EFFECT = Effect(
    name="drag-crisis",
    summary="quadratic drag whose coefficient falls above a critical speed",
    equation=r"-c\,|\dot x|\,\dot x\,\left(1 - \frac{3/4}{1 + e^{-(|\dot x| - v_c) / 0.1 v_c}}\right)",
    source="Achenbach (1972), J. Fluid Mech. 54, 565: a smooth sphere at a Reynolds number of 2 to 4 x 10^5",
    parameters=(
        Parameter("drag_crisis", "1/{x}", "c", default=0.0),  # below zero: for plain drag to say
        Parameter(
            "crisis_speed",
            "{x}/s",
            "v_c",
            lower=1e-12,
            default=10.0,
            role="form",
            source="a diagnosis begins at shares of the largest speed",
        ),
        Parameter(
            "crisis_fastest",
            "{x}/s",
            "v_m",
            lower=1e-12,
            default=20.0,
            constant=True,
            role="shape",
            source="a diagnosis takes the largest speed",
        ),
    ),
    component="force-of-velocity",
    applies=falls,
    plausibility=0.1,
    acceleration=acceleration,
    alike="quadratic-drag, with another power",
    trials=trials,
    sensible=sensible,
    scaling={"mass": -1.0, "radius": 2.0},
    typical="a football: 0.025 1/m below some 10 to 15 m/s, a quarter of it above",
    example=EffectExample("projectile", size=0.05),
)
