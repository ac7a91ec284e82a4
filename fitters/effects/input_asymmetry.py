"""An input acts more one way than the other: a motor driver, a valve, heating beside cooling."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import is_driven, largest_parameter, on_one_input, powers_of_each, which_parameter
from fitters.effects._powers import power
from iris_sysid.types import Array, Effect, EffectExample, Parameter

POWERS = (2.0, 1.0)


def uneven(t_s: Array, given: Array, share: float, exponent: float, largest: float) -> Array:
    """Return u + b u_1 |u / u_1|^p of ``given`` (n,) and ``largest``, in its unit, at ``t_s`` (n,) s."""
    return np.asarray(given + share * largest * (np.abs(given) / largest) ** exponent)


EFFECT = Effect(
    name="input-asymmetry",
    summary="an input that acts more one way than the other",
    equation=r"u \to u + b\,u_1\,|u / u_1|^{p}",
    source="Narendra and Gallman (1966), IEEE Trans. Autom. Control 11, 546: a static function before linear dynamics",
    parameters=(
        Parameter("input_asymmetry", "1", "b", lower=-1.0, upper=1.0, default=0.0),
        power("input_asymmetry", 2.0, (0.5, 4.0), "the first even term of any smooth function; 1 is tried as well"),
        largest_parameter(
            "asymmetry_scale", "the largest input; b is the share that it gains there one way, and loses the other way"
        ),
        which_parameter("uneven_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.3,
    drive=on_one_input(uneven),
    alike="a constant force, where the input has two sizes alone",
    trials=powers_of_each(POWERS),
    typical="a driver of a motor, whose gain differs by the direction: 0.01 to 0.1; a valve: 0.3",
    example=EffectExample("driven-oscillator", size=0.2),
)
