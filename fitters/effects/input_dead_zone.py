"""A small input does nothing: a valve that overlaps, a motor whose brushes stick, an amplifier with a threshold."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import each, is_driven, on_one_input, which_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def narrowed(t_s: Array, given: Array, width: float) -> Array:
    """sign(u) max(|u| - w, 0) of ``given`` (n,) and ``width`` in its unit, at ``t_s`` (n,) s."""
    return np.asarray(np.sign(given) * np.maximum(np.abs(given) - width, 0.0))


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
    drive=on_one_input(narrowed),
    alike="coulomb-friction, where the motion follows the sign of the input",
    trials=each,
    typical="a valve that overlaps: 1 to 5 % of its range",
    example=EffectExample("driven-oscillator", size=0.2),
)
