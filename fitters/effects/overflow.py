"""Above a level there is a second, wide way out: a rim, an overflow pipe."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import drains
from iris_sysid.types import Array, Effect, EffectExample, Parameter

QUANTILES = (0.95, 0.9, 0.8, 0.7, 0.6, 0.5)  # of what was seen, tried as the level of the rim


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float]
) -> float:
    """-w (h - h_r) above the rim."""
    overflow, rim = params
    above = position - rim
    return -0.5 * overflow * (above + abs(above))


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Levels of the rim. ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit."""
    return [(float(level),) for level in np.nanquantile(observed[:, 0], QUANTILES)]


EFFECT = Effect(
    name="overflow",
    summary="a way out above some level",
    equation=r"-w\,\max(h - h_r, 0)",
    source="first-order expansion of the flow over a broad rim",
    parameters=(
        Parameter("overflow", "1/s", "w", lower=0.0, default=0.0),
        Parameter("rim", "{x}", "h_r", default=0.0, role="location"),
    ),
    applies=drains,
    acceleration=acceleration,
    alike="leak, when the rim is low",
    trials=trials,
    example=EffectExample("torricelli", size=0.05),
)
