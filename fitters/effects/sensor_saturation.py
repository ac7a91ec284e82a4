"""What lies outside the range of a sensor is read as its end: a converter at its limits, a gauge at its stops."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import tells_one_reading
from iris_sysid.types import Array, Effect, EffectExample, Parameter

QUANTILES = (0.98, 0.95, 0.9, 0.8, 0.7)  # of what was seen, tried as the upper end; the same from below as the lower


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """What is outside the range counts less: x - c (x - clip(x)); at c = 1 it is cut.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    share, low, high = params
    return np.asarray(observed - share * (observed - np.clip(observed, min(low, high), max(low, high))))


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Ends of the range. ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit."""
    seen = observed[:, 0]
    return [(float(np.nanquantile(seen, 1 - q)), float(np.nanquantile(seen, q))) for q in QUANTILES]


EFFECT = Effect(
    name="sensor-saturation",
    summary="a sensor that reads the end of its range beyond it",
    equation=r"x_\mathrm{seen} = x - c\,(x - \mathrm{clip}(x, x_l, x_h))",
    source="Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities, chapter 2",
    parameters=(
        Parameter("sensor_saturation", "1", "c", lower=0.0, upper=1.5, default=0.0),
        Parameter("sensor_low", "{x}", "x_l", default=-0.01, role="location"),
        Parameter("sensor_high", "{x}", "x_h", default=0.01, role="location"),
    ),
    component="reading-of-position",
    applies=tells_one_reading,
    cause="measurement",
    plausibility=0.1,
    observe=observe,
    alike="gain-change, of the upper end alone",
    trials=trials,
    typical="a converter of 5 V or 10 V, cut whole",
    example=EffectExample("driven-oscillator", size=0.5),
)
