"""The size of an effect that is named only where it is significant: without correction it comes out too large.

Of sizes near the threshold only those are seen that noise has made larger ("winner's curse"). Value and interval here
are those of a normal variable given that it lies beyond the threshold (Zhong and Prentice 2008, Biostatistics 9, 621).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from iris_sysid.types import Estimate, normal_cdf

NEGLIGIBLE = 4.0  # standard errors above the threshold, beyond which the correction is below 1e-3 of a standard error
LOWEST = -30.0  # standard errors: lower limit of the true size


def corrected_for_selection(size: Estimate, critical: float) -> Estimate:
    """The size given that it was found significant: its median-unbiased value, and its 95 % interval.

    Its standard error is taken from its interval, which may be that of Student's t.

    Parameters
    ----------
    size
        As fitted.
    critical
        Standard errors above which it counts as significant.
    """
    scale = float(np.copysign(size.interval_stderr, size.value))
    if not 0.0 < critical < size.value / scale < critical + NEGLIGIBLE:
        return size
    value, *ends = (scale * _true_size(size.value / scale, critical, share) for share in (0.5, 0.025, 0.975))
    return replace(size, value=value, ci95=(min(ends), max(ends)))


def _true_size(z: float, critical: float, probability: float) -> float:
    """The mean of a unit normal that exceeds z with this probability, given that it lies beyond the critical value."""

    def excess(mean: float) -> float:
        beyond = float(normal_cdf(mean - critical)) + float(normal_cdf(-critical - mean))
        return float(normal_cdf(mean - z)) / max(beyond, 1e-300) - probability

    return float(brentq(excess, LOWEST, z + NEGLIGIBLE)) if excess(LOWEST) < 0.0 else LOWEST
