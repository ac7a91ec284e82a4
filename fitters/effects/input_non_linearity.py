"""What an input does is not in proportion to it: a valve, an amplifier near its limits, a fan or a propeller."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import is_driven, largest_parameter, on_one_input, powers_of_each, which_parameter
from fitters.effects._powers import power
from iris_sysid.types import Array, Effect, EffectExample, Parameter

POWERS = (3.0, 2.0)


def bent(t_s: Array, given: Array, share: float, exponent: float, largest: float) -> Array:
    """Return u (1 + b (|u| / u_1)^(p - 1)) of ``given`` (n,) and ``largest``, in its unit, at ``t_s`` (n,) s."""
    return np.asarray(given * (1.0 + share * (np.abs(given) / largest) ** (exponent - 1.0)))


EFFECT = Effect(
    name="input-non-linearity",
    summary="an input that acts more, or less, than in proportion",
    equation=r"u \to u\,(1 + b\,|u / u_1|^{p - 1})",
    source="Narendra and Gallman (1966), IEEE Trans. Autom. Control 11, 546: a static function before linear dynamics",
    parameters=(
        Parameter("input_non_linearity", "1", "b", lower=-1.0, default=0.0),
        power("input_non_linearity", 3.0, (1.5, 5.0), "the first odd term of any smooth function; 2 is tried as well"),
        largest_parameter("input_scale", "the largest input; b is the share that it gains there"),
        which_parameter("bent_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.3,
    drive=on_one_input(bent),
    alike="input-saturation, where little is cut; a gain, where the input has one size",
    trials=powers_of_each(POWERS),
    typical="an amplifier near its limits: -0.1; a propeller or a fan, whose force goes with the square: far more",
    example=EffectExample("driven-oscillator", size=0.2),
)
