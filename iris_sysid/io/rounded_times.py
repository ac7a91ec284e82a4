"""Times that a spreadsheet rounded: rows at even steps show them better than the cells."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array

UNITS_S = (1.0, 0.1, 0.01, 0.001)  # to which people and programs round times
MIN_ROWS = 20  # rows from which even steps are more than chance
COARSE = 0.02  # of a step: a finer rounding does no harm
WITHIN = 0.55  # of the unit: what rounding may do to a time, and a little for steps that a sensor does not keep


def unrounded(t_s: Array) -> tuple[Array, str]:
    """Times (n,) s at even steps in place of rounded ones, perhaps several alike; and what was done, in a clause.

    The clause is empty where the times are as they were.
    """
    if t_s.size < MIN_ROWS or not np.all(np.isfinite(t_s)) or np.any(np.diff(t_s) < 0):
        return t_s, ""
    unit = next((unit for unit in UNITS_S if np.all(np.abs(t_s / unit - np.round(t_s / unit)) < 1e-6)), None)
    rows = np.arange(t_s.size)
    step, start = (float(value) for value in np.polyfit(rows, t_s, 1))
    even: Array = start + step * rows.astype(np.float64)
    off = float(np.max(np.abs(even - t_s)))
    if unit is None or not step > 0 or unit < COARSE * step or not 1e-9 < off < WITHIN * unit:
        return t_s, ""
    return even, f"times are rounded to {unit:g} s: taken for even steps of {step:.6g} s"
