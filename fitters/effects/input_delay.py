"""The input acts late: a bus, a computer, a long pipe."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import each, is_driven, on_one_input, which_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def late(t_s: Array, given: Array, delay: float) -> Array:
    """u(t - delay), on a line between samples: of a held input, its mean until the next one.

    ``t_s`` (n,) and ``delay``, s; ``given`` (n,), in its unit.
    """
    return np.interp(t_s - delay, t_s, given)


EFFECT = Effect(
    name="input-delay",
    summary="an input that acts late",
    equation=r"u \to u(t - \tau)",
    source="transport delay; Ljung (1999), System Identification, section 4.2",
    parameters=(
        Parameter("input_delay", "s", r"\tau_u", lower=0.0, upper=100.0, default=0.0),
        which_parameter("delayed_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.5,
    drive=on_one_input(late),
    alike="exposure-lag, of the only reading; an actuator of the first order",
    trials=each,
    typical="a command over a bus: 0.001 to 0.02 s; hot water in a pipe: seconds",
    example=EffectExample("driven-oscillator", size=0.05),
)
