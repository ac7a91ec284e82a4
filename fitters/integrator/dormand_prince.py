"""Integrate many initial value problems at once with a step sequence that is fixed beforehand (numba).

The method is the explicit Runge-Kutta method of order 8 of Dormand and Prince in the form of Hairer, Norsett and
Wanner (1993, Solving Ordinary Differential Equations I, section II.5), with its coefficients.
At a camera's frame rate one step a frame is then exact to rounding, also after hours, when the phase of a method of
order 5 has drifted. Steps are not chosen on the way: the result is a smooth function of the parameters, and
differences between columns carry no noise from step control.

The integrator takes the right-hand side as a function pointer, so that it is compiled once, and kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numba import boolean, float64, int64, types
from numpy.typing import NDArray

from fitters.integrator.dop853_coefficients import NODES, STAGES, WEIGHTS
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
def _weighted(state: Array, slopes: Array, stage: int, step_s: float, out: Array) -> None:
    """Fill out = state + step * sum_j WEIGHTS[stage, j] slopes[j], for every state and column."""
    for i in range(state.shape[0]):
        for c in range(state.shape[1]):
            total = 0.0
            for j in range(stage):
                total += WEIGHTS[stage, j] * slopes[j, i, c]
            out[i, c] = state[i, c] + step_s * total


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


@kernel(types.void(_COLUMNS, _VECTOR, int64[::1], _MATRIX, _MATRIX, _MATRIX, boolean, _CUBE))
def integrate(
    columns: Columns,
    t_s: Array,
    substeps: NDArray[np.int64],
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
    substeps
        (n - 1,) number of equal steps within each sample interval.
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
    slopes = np.zeros((STAGES, initial.shape[0], initial.shape[1]))
    state = np.zeros((initial.shape[0], initial.shape[1]))
    trial = np.zeros((initial.shape[0], initial.shape[1]))
    inputs_now = np.zeros(inputs.shape[1])
    _copy(initial, state)
    _copy(state, out[0])
    for k in range(t_s.size - 1):
        step_s = (t_s[k + 1] - t_s[k]) / substeps[k]
        for m in range(substeps[k]):
            for stage in range(STAGES):
                _weighted(state, slopes, stage, step_s, trial)
                if inputs_now.size > 0:
                    _inputs_at((m + NODES[stage]) / substeps[k], inputs[k], inputs[k + 1], linear, inputs_now)
                columns(t_s[k] + (m + NODES[stage]) * step_s, trial, params, inputs_now, slopes[stage])
            _weighted(state, slopes, STAGES, step_s, trial)
            state, trial = trial, state
        _copy(state, out[k + 1])


@kernel(types.void(_COLUMNS, _VECTOR, int64[::1], int64[::1], _MATRIX, _MATRIX, _MATRIX, boolean, _MATRIX))
def restarted(
    columns: Columns,
    t_s: Array,
    substeps: NDArray[np.int64],
    which: NDArray[np.int64],
    starts: Array,
    params: Array,
    inputs: Array,
    linear: bool,
    out: Array,
) -> None:
    """Fill ``out`` (k, s) with the states at the ends of sample intervals, each begun anew from given states.

    Parameters
    ----------
    columns, t_s, inputs, linear
        As for :func:`integrate`.
    substeps
        (k,) number of equal steps in each of these intervals.
    which
        (k,) the intervals.
    starts
        (n, s) states at the samples.
    params
        (p, 1).
    out
        (k, s), written.
    """
    initial, ends = np.zeros((starts.shape[1], 1)), np.zeros((2, starts.shape[1], 1))
    for k in range(which.size):
        at = which[k]
        for i in range(starts.shape[1]):
            initial[i, 0] = starts[at, i]
        integrate(columns, t_s[at : at + 2], substeps[k : k + 1], initial, params, inputs[at : at + 2], linear, ends)
        for i in range(starts.shape[1]):
            out[k, i] = ends[1, i, 0]
