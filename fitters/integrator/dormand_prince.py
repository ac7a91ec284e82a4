"""Integrate many initial value problems at once with a step sequence that is fixed beforehand (numba).

The method is the explicit Runge-Kutta method of order 8 of Dormand and Prince in the form of Hairer, Norsett and
Wanner (1993, Solving Ordinary Differential Equations I, section II.5), with its coefficients.
Steps are not chosen on the way: the result is a smooth function of the parameters, and differences between columns
carry no noise from step control. They may span many samples, or a part of the time between two.

The integrator takes the right-hand side as a function pointer, so that it is compiled once, and kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import boolean, float64, types

from fitters.integrator.continuous_extension import TERMS, _evaluated, _polynomial
from fitters.integrator.dop853_coefficients import EXTENDED, EXTENSION, EXTENSION_NODES, NODES, STAGES, WEIGHTS
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

# Writes dstate/dt of every column: (t, states (s, c), params (p, c), inputs (m,), out (s, c)).
Columns = Callable[[float, Array, Array, Array, Array], None]

ORDER = 8

_VECTOR = float64[::1]
_MATRIX = float64[:, ::1]
_CUBE = float64[:, :, ::1]
COLUMNS_SIGNATURE = types.void(float64, _MATRIX, _MATRIX, _VECTOR, _MATRIX)
_COLUMNS = types.FunctionType(COLUMNS_SIGNATURE)


@kernel(inline="always")
def _moved(state: Array, slopes: Array, weights: Array, count: int, step_s: float, out: Array) -> None:
    """Fill out = state + step * sum_j weights[j] slopes[j] over the first slopes, for every state and column."""
    for i in range(state.shape[0]):
        for c in range(state.shape[1]):
            total = 0.0
            for j in range(count):
                total += weights[j] * slopes[j, i, c]
            out[i, c] = state[i, c] + step_s * total


@kernel(inline="always")
def _weighted(state: Array, slopes: Array, stage: int, step_s: float, out: Array) -> None:
    """Fill out with the state at which a stage takes its slope; after the last one, that at the end of the step."""
    _moved(state, slopes, WEIGHTS[stage], stage, step_s, out)


@kernel(inline="always")
def _copy(values: Array, out: Array) -> None:
    """Fill out with values, one by one: an assignment of whole arrays takes numba seconds to compile."""
    for i in range(values.shape[0]):
        for c in range(values.shape[1]):
            out[i, c] = values[i, c]


@kernel(inline="always")
def _inputs_at(fraction: float, before: Array, after: Array, linear: bool, out: Array) -> None:
    """Inputs inside a sample interval: on the line between its ends, or held at the value of its start."""
    for i in range(before.size):
        out[i] = before[i] + fraction * (after[i] - before[i]) if linear else before[i]


@kernel(inline="always")
def time_at(t_s: Array, position: float) -> float:
    """The time (s) at a position in samples, e.g. 2.5 in the middle between those of numbers 2 and 3."""
    k = min(int(position), t_s.size - 2)
    return t_s[k] + (position - k) * (t_s[k + 1] - t_s[k])


@kernel(types.void(_COLUMNS, _VECTOR, _VECTOR, _MATRIX, _MATRIX, _MATRIX, boolean, _CUBE))
def integrate(
    columns: Columns,
    t_s: Array,
    ends: Array,
    initial: Array,
    params: Array,
    inputs: Array,
    linear: bool,
    out: Array,
) -> None:
    """Fill ``out`` with the states at every sample, for every column of initial states and parameters.

    Parameters
    ----------
    columns
        ``columns(t, states (s, c), params (p, c), inputs (m,), out (s, c))`` writes dstate/dt.
    t_s
        (n,) s, increasing, as uneven as it likes.
    ends
        (k + 1,) where each of k steps begins and the last one ends, in samples, from 0 to n - 1; every
        sample at which an input jumps or bends is among them.
    initial
        (s, c) states at ``t_s[0]``.
    params
        (p, c).
    inputs
        (n, m) at the samples; m may be 0.
    linear
        Inputs vary linearly between samples; otherwise each is held until the next sample.
    out
        (n, s, c), written. Not finite from where the solution diverges.
    """
    rows, count = initial.shape
    slopes = np.zeros((EXTENDED, rows, count))
    terms = np.zeros((TERMS, rows, count))
    state, trial, after = np.zeros((rows, count)), np.zeros((rows, count)), np.zeros((rows, count))
    inputs_now = np.zeros(inputs.shape[1])
    _copy(initial, state)
    _copy(state, out[0])
    sample = 1
    for m in range(ends.size - 1):
        start_s, interval = time_at(t_s, ends[m]), int(ends[m])
        step_s = time_at(t_s, ends[m + 1]) - start_s
        for stage in range(STAGES):
            _weighted(state, slopes, stage, step_s, trial)
            if inputs_now.size > 0:
                fraction = ends[m] - interval + NODES[stage] * (ends[m + 1] - ends[m])
                _inputs_at(fraction, inputs[interval], inputs[interval + 1], linear, inputs_now)
            columns(start_s + NODES[stage] * step_s, trial, params, inputs_now, slopes[stage])
        _weighted(state, slopes, STAGES, step_s, after)
        if sample < ends[m + 1]:
            columns(start_s + step_s, after, params, inputs_now, slopes[STAGES])
            for extra in range(EXTENSION.shape[0]):
                stage = STAGES + 1 + extra
                _moved(state, slopes, EXTENSION[extra], stage, step_s, trial)
                columns(start_s + EXTENSION_NODES[extra] * step_s, trial, params, inputs_now, slopes[stage])
            _polynomial(state, after, slopes, step_s, terms)
        while sample < ends[m + 1]:
            _evaluated(state, terms, (t_s[sample] - start_s) / step_s, out[sample])
            sample += 1
        if sample == ends[m + 1]:
            _copy(after, out[sample])
            sample += 1
        state, after = after, state


@kernel(types.void(_COLUMNS, _VECTOR, _CUBE, _MATRIX, _MATRIX, _CUBE))
def slopes_along(columns: Columns, t_s: Array, states: Array, params: Array, inputs: Array, out: Array) -> None:
    """Fill ``out`` with dstate/dt along a motion of one column.

    Parameters
    ----------
    columns, t_s, params, inputs
        As for :func:`integrate`.
    states
        (n, s, 1) at the times.
    out
        (n, s, 1), written.
    """
    for k in range(t_s.size):
        columns(t_s[k], states[k], params, inputs[k], out[k])
