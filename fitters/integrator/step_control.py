"""Choose a sequence of steps for one solution: each as long as the embedded errors of the method allow.

The error of a step is that of Hairer, Norsett and Wanner (1993, Solving Ordinary Differential Equations I, section
II.10), from embedded formulas of order 5 and 3. It falls with the power ORDER of the step; where the equation has a
kink, as a rim over which water runs, it falls with a low power whatever the method, and a larger one is enough.
"""

from __future__ import annotations

import numpy as np
from numba import boolean, types
from numpy.typing import NDArray

from fitters.integrator.dop853_coefficients import ERROR_3, ERROR_5, NODES, STAGES
from fitters.integrator.dormand_prince import (
    _COLUMNS,
    _MATRIX,
    _VECTOR,
    ORDER,
    Columns,
    _copy,
    _inputs_at,
    _weighted,
    time_at,
)
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

SAFETY = 0.9
SHORTER, LONGER = 0.25, 2.0  # a step than the one before, at most
KINKED_ORDER = 4  # an error that falls with a lower power of the step is that of an equation with a kink
APART = 3.0  # times as long as the next one a step may be: kinks move when values change


@kernel(inline="always")
def _error(slopes: Array, step_s: float, size: Array, after: Array) -> float:
    """Largest error of a state over a step, relative to the state's size so far; not finite where a slope is not."""
    largest_5, largest_3 = 0.0, 0.0
    for i in range(size.size):
        total_5, total_3 = 0.0, 0.0
        for j in range(STAGES):
            total_5 += ERROR_5[j] * slopes[j, i, 0]
            total_3 += ERROR_3[j] * slopes[j, i, 0]
        scale = max(size[i], abs(after[i, 0]))
        scale = scale if 0.0 < scale < np.inf else 1.0
        largest_5 += (total_5 / scale) ** 2
        largest_3 += (total_3 / scale) ** 2
    both = np.sqrt(largest_5 + 0.01 * largest_3)
    return step_s * largest_5 / both if both != 0.0 else 0.0


@kernel(inline="always")
def _next_end(t_s: Array, begin: float, length_s: float, last: int) -> float:
    """Position (in samples) of the end of a step about so long: that of the last sample is not left for a short one."""
    time_s = time_at(t_s, begin)
    left_s = t_s[last] - time_s
    if left_s <= (1.0 + 1e-9) * length_s:
        return float(last)
    time_s += min(length_s, 0.5 * left_s)
    k = int(begin)
    while t_s[k + 1] <= time_s:
        k += 1
    return k + (time_s - t_s[k]) / (t_s[k + 1] - t_s[k])


@kernel(inline="always")
def _is_exact(error: float, step_s: float, limits: Array, failure: Array) -> bool:
    """Whether a step is exact enough; ``failure``: length and error of the trial before that was not, or zero."""
    tolerance, enough, shortest_s = limits
    kinked = failure[0] > 0.0 and error > failure[1] * (step_s / failure[0]) ** KINKED_ORDER
    exact = error <= (enough if kinked else tolerance) or step_s <= 1.01 * shortest_s
    failure[0], failure[1] = (0.0 if exact else step_s), error
    return exact


@kernel(inline="always")
def _next_length(error: float, step_s: float, exact: bool, limits: Array) -> float:
    """Length of the next trial: as long as its error allows, and after a kink what was exact enough at it."""
    tolerance, _, shortest_s = limits
    ratio = SAFETY * (tolerance / error) ** (1.0 / ORDER) if error != 0.0 else LONGER
    if not ratio > SHORTER:  # as well where the error is not a number
        ratio = SHORTER
    ratio = min(ratio, LONGER)
    if exact and ratio < 1.0:
        ratio = 1.0
    return max(ratio * step_s, shortest_s)


@kernel(types.int64(_COLUMNS, _VECTOR, _MATRIX, _MATRIX, _MATRIX, boolean, types.int64[::1], _VECTOR, _VECTOR, _VECTOR))
def controlled_steps(
    columns: Columns,
    t_s: Array,
    initial: Array,
    params: Array,
    inputs: Array,
    linear: bool,
    latest: NDArray[np.int64],
    limits: Array,
    size: Array,
    ends: Array,
) -> int:
    """Fill ``ends`` with the positions (in samples) at which steps begin and end; give how many there are.

    Parameters
    ----------
    columns, t_s, params, inputs, linear
        As for :func:`fitters.integrator.dormand_prince.integrate`, of one column and at least two samples.
    initial
        (s, 1) state at ``t_s[0]``.
    latest
        (n - 1,) the sample up to which a step that begins in each interval may last.
    limits
        (3,) largest error of a step and of one at a kink, both relative to the size of each state; shortest step, s.
    size
        (s,) least size of each state; what it reaches is written.
    ends
        (k,) written. The last one is before the last sample where there are too few, or the solution diverges.
    """
    slopes, inputs_now = np.zeros((STAGES, initial.shape[0], 1)), np.zeros(inputs.shape[1])
    state, trial, failure = np.zeros(initial.shape), np.zeros(initial.shape), np.zeros(2)
    _copy(initial, state)
    count, length_s = 1, t_s[1] - t_s[0]
    ends[0] = 0.0
    while ends[count - 1] < t_s.size - 1 and count < ends.size:
        begin, interval = ends[count - 1], int(ends[count - 1])
        end = _next_end(t_s, begin, length_s, latest[interval])
        step_s = time_at(t_s, end) - time_at(t_s, begin)
        for stage in range(STAGES):
            _weighted(state, slopes, stage, step_s, trial)
            if inputs_now.size > 0:
                fraction = begin - interval + NODES[stage] * (end - begin)
                _inputs_at(fraction, inputs[interval], inputs[interval + 1], linear, inputs_now)
            columns(time_at(t_s, begin) + NODES[stage] * step_s, trial, params, inputs_now, slopes[stage])
        _weighted(state, slopes, STAGES, step_s, trial)
        error = _error(slopes, step_s, size, trial)
        exact = _is_exact(error, step_s, limits, failure)
        length_s = _next_length(error, step_s, exact, limits)
        if exact:
            if not error < np.inf:
                break
            for i in range(size.size):
                size[i] = max(size[i], abs(trial[i, 0]))
            state, trial = trial, state
            ends[count] = end
            count += 1
    return count


def graded(ends: Array) -> Array:
    """The ends of steps with some split in two, so that none is many times as long as the next."""
    while True:
        lengths = np.diff(ends)
        long = np.flatnonzero(lengths[:-1] > APART * lengths[1:])
        if not long.size:
            return ends
        ends = np.insert(ends, long + 1, ends[long] + lengths[long] / 2)
