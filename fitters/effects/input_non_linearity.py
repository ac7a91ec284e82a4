"""What an input does is not in proportion to it: a valve, an amplifier near its limits, a fan or a propeller."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from fitters.effects._drives import is_driven, on_one_input, which_parameter
from fitters.effects._powers import MIN_BASE, SCALE, power
from iris_sysid.types import Array, Effect, EffectExample, Parameter

POWERS = (3.0, 2.0)


def bent(t_s: Array, given: Array, share: float, exponent: float, largest: float) -> Array:
    """Return u (1 + b (|u| / u_1)^(p - 1)) of ``given`` (n,) and ``largest``, in its unit, at ``t_s`` (n,) s."""
    return np.asarray(given * (1.0 + share * (np.abs(given) / largest) ** (exponent - 1.0)))


def trials(t_s: Array, inputs: Array) -> list[tuple[float, ...]]:
    """Powers of each input, and its largest size. ``t_s`` (n,), s; ``inputs`` (n, m), in their units."""
    sizes = [float(size) + MIN_BASE for size in np.nanmax(np.abs(inputs), axis=0)]
    return [(exponent, size, float(k)) for (k, size), exponent in product(enumerate(sizes), POWERS)]


EFFECT = Effect(
    name="input-non-linearity",
    summary="an input that acts more, or less, than in proportion",
    equation=r"u \to u\,(1 + b\,|u / u_1|^{p - 1})",
    source="Narendra and Gallman (1966), IEEE Trans. Autom. Control 11, 546: a static function before linear dynamics",
    parameters=(
        Parameter("input_non_linearity", "1", "b", lower=-1.0, default=0.0),
        power("input_non_linearity", 3.0, (1.5, 5.0), "the first odd term of any smooth function; 2 is tried as well"),
        replace(
            SCALE,
            name="input_scale",
            unit="1",
            symbol="u_1",
            source="the largest input; b is the share that it gains there",
        ),
        which_parameter("bent_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.3,
    drive=on_one_input(bent),
    alike="input-saturation, where little is cut; a gain, where the input has one size",
    trials=trials,
    typical="an amplifier near its limits: -0.1; a propeller or a fan, whose force goes with the square: far more",
    example=EffectExample("driven-oscillator", size=0.2),
)
