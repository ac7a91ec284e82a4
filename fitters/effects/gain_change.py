"""The sensor's gain is another one above some level: two ranges, another width, a plate that ends, saturation."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import GAUGE, on_a_line
from iris_sysid.types import Array, Effect, EffectExample, Parameter

QUANTILES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)  # of what was seen, tried as the level at which the gain changes


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + g * (observed - level) above the level.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    gain, level = params
    return np.asarray(observed + gain * np.maximum(observed - level, 0.0))


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Levels at which the gain may change. ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit."""
    return [(float(level),) for level in np.nanquantile(observed[:, 0], QUANTILES)]


EFFECT = Effect(
    name="gain-change",
    summary="a sensor whose gain changes at a level",
    equation=r"x_\mathrm{seen} = x + g\,\max(x - x_g, 0)",
    source="first-order expansion of a calibration curve with two ranges",
    parameters=(
        Parameter("gain_change", "1", "g", lower=-1.0, default=0.0),
        Parameter("gain_level", "{x}", "x_g", default=0.0, role="location"),
    ),
    component="reading-of-position",
    applies=on_a_line,
    sensors=GAUGE,
    cause="measurement",
    plausibility=0.1,
    observe=observe,
    alike="a level from which the way out is another",
    trials=trials,
    typical="linearity in data sheets of gauges: 0.001 to 0.01; a gauge outside its range: 0.1 and more",
    example=EffectExample("torricelli", size=0.05, unit="V"),
)
