"""Hidden states along a motion that is known: only they are integrated, from sample to sample (numba)."""

from __future__ import annotations

import numpy as np
from numba import int64, types

from fitters.integrator.dormand_prince import _COLUMNS, _CUBE, _MATRIX, _VECTOR, Columns
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array


@kernel(types.void(_COLUMNS, _VECTOR, _CUBE, _MATRIX, _MATRIX, int64))
def follow_hidden(columns: Columns, t_s: Array, states: Array, params: Array, inputs: Array, own: int) -> None:
    """Fill in the hidden states, which are in ``states`` after the first ``own`` ones and begin as they are there.

    One step of the classical Runge-Kutta method from sample to sample, between which all else is on a line.

    Parameters
    ----------
    columns, t_s, params, inputs
        As for :func:`fitters.integrator.dormand_prince.integrate`, of one column.
    states
        (n, s, 1) at the times; the hidden ones are written.
    own
        Number of states that are known.
    """
    count = states.shape[1]
    tried, slopes = np.empty((count, 1)), np.zeros((count, 1))
    given, total = np.empty(inputs.shape[1]), np.empty(count)
    for k in range(t_s.size - 1):
        step_s = t_s[k + 1] - t_s[k]
        total[:] = 0.0
        for stage in range(4):
            share = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for i in range(own):
                tried[i, 0] = states[k, i, 0] + share * (states[k + 1, i, 0] - states[k, i, 0])
            for j in range(given.size):
                given[j] = inputs[k, j] + share * (inputs[k + 1, j] - inputs[k, j])
            for i in range(own, count):
                tried[i, 0] = states[k, i, 0] + share * step_s * slopes[i, 0]
            columns(t_s[k] + share * step_s, tried, params, given, slopes)
            for i in range(own, count):
                total[i] += slopes[i, 0] if stage in (0, 3) else 2.0 * slopes[i, 0]
        for i in range(own, count):
            states[k + 1, i, 0] = states[k, i, 0] + step_s * total[i] / 6.0
