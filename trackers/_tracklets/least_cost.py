"""Rows and columns paired at the least total cost."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array

Numbers = NDArray[np.intp]


def least_cost_pairs(cost: Array) -> tuple[Numbers, Numbers]:
    """Row and column numbers (min(m, n),) of the pairs of least total cost, by row (Kuhn-Munkres).

    Parameters
    ----------
    cost
        Finite cost (m, n) of each pair.
    """
    if 1 in cost.shape:  # SciPy's optimisers take a third of a second to import, and one body needs none
        return np.divmod([np.argmin(cost)], cost.shape[1])
    from scipy.optimize import linear_sum_assignment

    rows, columns = linear_sum_assignment(cost)
    return rows, columns
