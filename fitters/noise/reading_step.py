"""The step in which a sensor reads: an encoder's count, a converter's last bit, the digits of a table."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array

STEP_TO_SD = 1.0 / np.sqrt(12.0)  # standard deviation of an error that is uniform within a step
MIN_GAPS = 8  # between different values: fewer lie on some grid by chance
SKIPPED = 4  # the smallest gap that occurs may be this many steps
NEAR = 1e-2  # of a step, within which a value lies on the grid


def reading_step(values: Array) -> float:
    """The step of the grid on which all values lie; 0 where they lie on none.

    ``values`` (n,) in any unit, which the step has too; NaN are left out. The grid may lie anywhere.
    """
    known = np.unique(values[np.isfinite(values)])
    gaps = np.diff(known)
    gaps = gaps[gaps > 1e-12 * np.max(np.abs(known), initial=0.0)]  # the same number, rounded in two ways
    if gaps.size < MIN_GAPS:
        return 0.0
    for part in range(1, SKIPPED + 1):
        step = float(np.min(gaps)) / part
        places = (known - known[0]) / step
        step *= float(places[-1] / np.round(places[-1]))  # the smallest gap has the largest error of rounding
        places = (known - known[0]) / step
        if np.max(np.abs(places - np.round(places))) < NEAR:
            return step
    return 0.0
