"""Integrate a long record in equal steps over many samples each, which the continuous extension of the method fills in.

Where a motion is sampled far more often than the method of order 8 needs steps, a step for every sample is waste. Steps
here are equal and begin at the first sample, whatever the times of the others; within each the solution is the
polynomial of order 7 of Hairer, Norsett and Wanner (1993, Solving Ordinary Differential Equations I, section II.6).
"""

from __future__ import annotations

import numpy as np
from numba import float64, types

from fitters.integrator.dop853_coefficients import (
    EXTENDED,
    EXTENSION,
    EXTENSION_NODES,
    NODES,
    POLYNOMIAL,
    STAGES,
)
from fitters.integrator.dormand_prince import _COLUMNS, _CUBE, _MATRIX, _VECTOR, Columns, _copy, _weighted
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

ORDER = 7  # of the extension
TERMS = 7  # of its polynomial


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
def _polynomial(before: Array, after: Array, slopes: Array, step_s: float, out: Array) -> None:
    """Fill out (7, s, c) with the coefficients of the extension over a step."""
    for i in range(before.shape[0]):
        for c in range(before.shape[1]):
            change = after[i, c] - before[i, c]
            out[0, i, c] = change
            out[1, i, c] = step_s * slopes[0, i, c] - change
            out[2, i, c] = 2.0 * change - step_s * (slopes[STAGES, i, c] + slopes[0, i, c])
            for row in range(POLYNOMIAL.shape[0]):
                total = 0.0
                for j in range(EXTENDED):
                    total += POLYNOMIAL[row, j] * slopes[j, i, c]
                out[3 + row, i, c] = step_s * total


@kernel(inline="always")
def _evaluated(before: Array, terms: Array, x: float, out: Array) -> None:
    """Fill out (s, c) with the state at the fraction x of a step."""
    for i in range(before.shape[0]):
        for c in range(before.shape[1]):
            value = 0.0
            for k in range(TERMS - 1, -1, -1):
                value = (value + terms[k, i, c]) * (x if k % 2 == 0 else 1.0 - x)
            out[i, c] = before[i, c] + value


@kernel(types.void(_COLUMNS, _VECTOR, float64, _MATRIX, _MATRIX, _CUBE))
def integrate_over_samples(
    columns: Columns, t_s: Array, step_s: float, initial: Array, params: Array, out: Array
) -> None:
    """Fill ``out`` with the states at every sample, in equal steps of a model without inputs.

    Parameters
    ----------
    columns
        As for :func:`fitters.integrator.dormand_prince.integrate`.
    t_s
        (n,) s, increasing.
    step_s
        Length of all steps, of which the first begins at ``t_s[0]``.
    initial
        (s, c) states at ``t_s[0]``.
    params
        (p, c).
    out
        (n, s, c), written. Not finite from where the solution diverges.
    """
    rows, count = initial.shape
    slopes = np.zeros((EXTENDED, rows, count))
    terms = np.zeros((TERMS, rows, count))
    state, trial, after = np.zeros((rows, count)), np.zeros((rows, count)), np.zeros((rows, count))
    no_inputs = np.zeros(0)
    _copy(initial, state)
    _copy(state, out[0])
    columns(t_s[0], state, params, no_inputs, slopes[0])
    k = 1
    for m in range(int(np.ceil((t_s[-1] - t_s[0]) / step_s))):
        start_s = t_s[0] + m * step_s
        last = m + 1 >= (t_s[-1] - t_s[0]) / step_s  # to rounding, the last sample may lie beyond its end
        for stage in range(1, STAGES):
            _weighted(state, slopes, stage, step_s, trial)
            columns(start_s + NODES[stage] * step_s, trial, params, no_inputs, slopes[stage])
        _weighted(state, slopes, STAGES, step_s, after)
        columns(start_s + step_s, after, params, no_inputs, slopes[STAGES])
        if k < t_s.size and (last or t_s[k] <= start_s + step_s):
            for extra in range(EXTENSION.shape[0]):
                stage = STAGES + 1 + extra
                _moved(state, slopes, EXTENSION[extra], stage, step_s, trial)
                columns(start_s + EXTENSION_NODES[extra] * step_s, trial, params, no_inputs, slopes[stage])
            _polynomial(state, after, slopes, step_s, terms)
            while k < t_s.size and (last or t_s[k] <= start_s + step_s):
                _evaluated(state, terms, (t_s[k] - start_s) / step_s, out[k])
                k += 1
        _copy(slopes[STAGES], slopes[0])
        state, after = after, state
