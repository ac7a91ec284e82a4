"""Above a level there is a second, wide way out: a rim, an overflow pipe."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitters.effects._domain import drains
from fitters.effects._powers import MIN_BASE, SCALE, power
from iris_sysid.types import Array, Effect, EffectExample, Parameter

QUANTILES = (0.95, 0.9, 0.8, 0.7, 0.6, 0.5)  # of what was seen, tried as the level of the rim


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float, float]
) -> float:
    """-w (h - h_r) ((h - h_r) / h_1)^(p - 1) above the rim."""
    overflow, rim, exponent, depth = params
    above = 0.5 * (position - rim + abs(position - rim))
    return -overflow * above * ((above + MIN_BASE) / depth) ** (exponent - 1.0)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Levels of the rim, a flow in proportion to the depth above it, and a usual depth.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    levels = observed[:, 0]
    depth = float(np.nanmax(levels) - np.nanmedian(levels)) or 1.0
    return [(float(level), 1.0, depth) for level in np.nanquantile(levels, QUANTILES)]


EFFECT = Effect(
    name="overflow",
    summary="a way out above some level",
    equation=r"-w\,\max(h - h_r, 0)",
    source="first-order expansion of the flow over a broad rim",
    parameters=(
        Parameter("overflow", "1/s", "w", lower=0.0, default=0.0),
        Parameter("rim", "{x}", "h_r", default=0.0, role="location"),
        power("overflow", 1.0, (0.5, 3.0), "first order; 3/2 over a weir"),
        replace(
            SCALE,
            name="overflow_depth",
            unit="{x}",
            symbol="h_1",
            source="a usual depth; another power gives the same flow there",
        ),
    ),
    component="force-of-position",
    applies=drains,
    plausibility=0.3,
    acceleration=acceleration,
    alike="leak, when the rim is low",
    trials=trials,
    typical="the water above the rim is gone in a second: 1 1/s",
    example=EffectExample("torricelli", size=0.05),
)
