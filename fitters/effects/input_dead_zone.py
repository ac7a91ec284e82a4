"""A small input does nothing: a valve that overlaps, a motor whose brushes stick, an amplifier with a threshold."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import chosen, each, is_driven, which_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def drive(t_s: Array, inputs: Array, params: Array) -> Array:
    """sign(u) max(|u| - w, 0).

    ``t_s`` (n,), s; ``inputs`` (n, m), in their units; ``params`` (k,).
    """
    width, which = params
    acting, column = chosen(inputs, which)
    acting[:, column] = np.sign(inputs[:, column]) * np.maximum(np.abs(inputs[:, column]) - width, 0.0)
    return acting


EFFECT = Effect(
    name="input-dead-zone",
    summary="an input that does nothing below a size",
    equation=r"u \to \mathrm{sgn}(u)\,\max(|u| - w, 0)",
    source="Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities, chapter 2",
    parameters=(
        Parameter("dead_zone", "1", "w", lower=0.0, default=0.0),
        which_parameter("dead_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.3,
    drive=drive,
    alike="coulomb-friction, where the motion follows the sign of the input",
    trials=each,
    typical="a valve that overlaps: 1 to 5 % of its range",
    example=EffectExample("driven-oscillator", size=0.2),
)
