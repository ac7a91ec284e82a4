"""The input has play: a gear, a linkage, a valve stem that moves only after the gap is crossed."""

from __future__ import annotations

import numpy as np
from numba import types

from fitters.effects._drives import each, is_driven, on_one_input, which_parameter
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array, Effect, EffectExample, Parameter


@kernel(types.float64[::1](types.float64[::1], types.float64))
def play(values: Array, half: float) -> Array:
    """What follows ``values`` (n,) with a play of ``half`` to each side, both in the same unit: the play operator."""
    followed = values.copy()
    for k in range(1, values.size):
        followed[k] = min(max(followed[k - 1], values[k] - half), values[k] + half)
    return followed


def loose(t_s: Array, given: Array, gap: float) -> Array:
    """What follows the input with a play of half the gap to each side; a gap below zero leads instead.

    ``t_s`` (n,), s; ``given`` (n,) and ``gap``, in its unit.
    """
    followed = play(given, abs(gap) / 2)
    return followed if gap >= 0 else np.asarray(2.0 * given - followed)


EFFECT = Effect(
    name="input-backlash",
    summary="an input with play",
    equation=r"u \to \mathrm{play}(u, b/2)",
    source="Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities, chapter 2",
    parameters=(
        Parameter("backlash", "1", "b", lower=0.0, default=0.0),
        which_parameter("loose_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.2,
    drive=on_one_input(loose),
    alike="input-delay, where the input goes up and down evenly; input-dead-zone",
    trials=each,
    typical="a train of gears: 0.1 to 1 degree at the shaft",
    example=EffectExample("driven-oscillator", size=0.3),
)
