"""A sensor that knows no sign: pulses of a wheel counted in either direction, the size of a signal, a rectifier."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import tells_one_reading
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """The reading x + r (|x| - x): at r = 1 the size alone is read, and below that what is negative counts less.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    (share,) = params
    return np.asarray(observed + share * (np.abs(observed) - observed))


EFFECT = Effect(
    name="rectified-reading",
    summary="a sensor that does not see the sign",
    equation=r"x_\mathrm{seen} = x + r\,(|x| - x)",
    source="Wigren and Schoukens (2017), Coupled electric drives data set and reference models: a pulse counter",
    parameters=(Parameter("rectified_reading", "1", "r", lower=0.0, upper=1.5, default=0.0),),
    component="reading-of-position",
    applies=tells_one_reading,
    cause="measurement",
    plausibility=0.1,
    observe=observe,
    alike="even-reading and gain-change, of small parts of the range",
    typical="a pulse counter or a rectifier: 1, the whole sign",
    example=EffectExample("driven-oscillator", size=0.2),
)
