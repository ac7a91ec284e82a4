"""Median over the neighbours of each value of a series: as SciPy's filter, whose import takes half a second."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from iris_sysid.types import Array


def running_median(values: Array, size: int, beyond: Literal["reflect", "edge"] = "reflect") -> Array:
    """The median (n,) of each value (n,) and of those about it, an odd number of them.

    Beyond its ends the series is mirrored at its last value, or goes on with that value.
    """
    return np.asarray(np.median(sliding_window_view(np.pad(values, size // 2, mode=beyond), size), axis=1))
