"""A sensor of the first order: a thermometer, a pressure line, a filter before the converter."""

from __future__ import annotations

import numpy as np
from numba import types

from fitters.effects._drives import tells_one_reading
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array, Effect, EffectExample, Parameter


@kernel(types.float64[::1](types.float64[::1], types.float64[::1], types.float64, types.float64))
def followed(t_s: Array, values: Array, start: float, lag_s: float) -> Array:
    """What a sensor of the first order reads (n,) of values (n,) that change on a line between times (n,) s.

    ``start`` is the first reading, in the unit of the values; ``lag_s`` > 0 the time constant, s.
    """
    read = np.empty_like(values)
    read[0] = start
    for k in range(1, values.size):
        step = t_s[k] - t_s[k - 1]
        behind = lag_s * (values[k] - values[k - 1]) / step  # of a steady slope
        read[k] = values[k] - behind + (read[k - 1] - values[k - 1] + behind) * np.exp(-step / lag_s)
    return read


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """The reading from its first value on; a lag below zero leads, to first order.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    lag_s, first = params
    if not lag_s > 0:
        return np.asarray(observed - lag_s * velocity)
    values = np.ascontiguousarray(observed[:, 0])
    remembered = 1.0 - np.exp(-lag_s / (t_s[1] - t_s[0])) if t_s.size > 1 else 0.0  # a fast sensor begins where it is
    return followed(t_s, values, values[0] + remembered * (first - values[0]), lag_s)[:, None]


def first_values(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """What was read first. ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit."""
    return [(float(observed[0, 0]),)]


EFFECT = Effect(
    name="sensor-lag",
    summary="a slow sensor, of the first order",
    equation=r"\tau\,\dot x_\mathrm{seen} = x - x_\mathrm{seen}",
    source="Doebelin (1990), Measurement Systems, section 3.3: the first-order instrument",
    parameters=(
        Parameter("sensor_lag", "s", r"\tau", lower=0.0, default=0.0),
        Parameter("first_reading", "{x}", "x_0", default=0.0, role="location"),
    ),
    component="reading-of-velocity",
    applies=tells_one_reading,
    cause="measurement",
    plausibility=0.2,
    observe=observe,
    trials=first_values,
    alike="exposure-lag, where it is short; input-delay",
    typical="a filter before a converter: 0.001 to 0.1 s; a thermocouple in air: 1 to 10 s",
    example=EffectExample("driven-oscillator", size=0.05),
)
