"""An input acts more one way than the other: a motor driver, a valve, heating beside cooling."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from fitters.effects._drives import is_driven, on_one_input, which_parameter
from fitters.effects._powers import MIN_BASE, SCALE, power
from iris_sysid.types import Array, Effect, EffectExample, Parameter

POWERS = (2.0, 1.0)


def uneven(t_s: Array, given: Array, share: float, exponent: float, largest: float) -> Array:
    """Return u + b u_1 |u / u_1|^p of ``given`` (n,) and ``largest``, in its unit, at ``t_s`` (n,) s."""
    return np.asarray(given + share * largest * (np.abs(given) / largest) ** exponent)


def trials(t_s: Array, inputs: Array) -> list[tuple[float, ...]]:
    """Powers of each input, and its largest size. ``t_s`` (n,), s; ``inputs`` (n, m), in their units."""
    sizes = [float(size) + MIN_BASE for size in np.nanmax(np.abs(inputs), axis=0)]
    return [(exponent, size, float(k)) for (k, size), exponent in product(enumerate(sizes), POWERS)]


EFFECT = Effect(
    name="input-asymmetry",
    summary="an input that acts more one way than the other",
    equation=r"u \to u + b\,u_1\,|u / u_1|^{p}",
    source="Narendra and Gallman (1966), IEEE Trans. Autom. Control 11, 546: a static function before linear dynamics",
    parameters=(
        Parameter("input_asymmetry", "1", "b", lower=-1.0, upper=1.0, default=0.0),
        power("input_asymmetry", 2.0, (0.5, 4.0), "the first even term of any smooth function; 1 is tried as well"),
        replace(
            SCALE,
            name="asymmetry_scale",
            unit="1",
            symbol="u_1",
            source="the largest input; b is the share that it gains there one way, and loses the other way",
        ),
        which_parameter("uneven_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.3,
    drive=on_one_input(uneven),
    alike="a constant force, where the input has two sizes alone",
    trials=trials,
    typical="a driver of a motor, whose gain differs by the direction: 0.01 to 0.1; a valve: 0.3",
    example=EffectExample("driven-oscillator", size=0.2),
)
