"""Dry friction that changes at a position on the path: a board of two surfaces, a seam, wax."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import slides
from fitters.effects._friction import turnover, turnover_parameter
from fitters.effects._times import frame_interval
from iris_sysid.types import Array, Effect, EffectExample, Parameter

POSITIONS = 16  # tried, spread evenly over the path
SLOWEST = 1e-9  # unit/s, so that a body at rest is on one surface or on the other


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float, float]
) -> float:
    """-c v / |v| beyond the position, smooth about v = 0, and over a frame interval on crossing it."""
    change, where, width, turnover = params
    beyond = 0.5 * (1.0 + np.tanh((position - where) / (width * speed + SLOWEST)))
    return -change * beyond * velocity / np.sqrt(speed * speed + turnover * turnover)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Positions within the path, its ends left out, how long (s) it takes to get across, and the speed of the turnover.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    ends = np.linspace(np.nanmin(observed), np.nanmax(observed), POSITIONS + 2)
    return [(float(where), frame_interval(t_s), turnover(t_s, observed)) for where in ends[1:-1]]


EFFECT = Effect(
    name="friction-change",
    summary="dry friction that changes at a position on the path",
    equation=r"-c\,\dot x / |\dot x|\quad (x > x_c)",
    source="Coulomb's law with a coefficient for each of two surfaces",
    parameters=(
        Parameter("friction_change", "{x}/s^2", "c", default=0.0),
        Parameter("change_place", "{x}", "x_c", default=0.0, role="location"),
        Parameter("change_width", "s", "w_c", lower=1e-9, default=1.0, constant=True, source="frame interval"),
        turnover_parameter("change_turnover"),
    ),
    component="force-of-velocity",
    absorbs=True,
    applies=slides,
    plausibility=0.3,
    acceleration=acceleration,
    alike="impact, where the rest of the way is short",
    trials=trials,
    typical="a coefficient of friction that changes by 0.1 on a level bench: 1 m/s^2",
    example=EffectExample("incline", size=0.05),
)
