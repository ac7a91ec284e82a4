"""Noise that is known beforehand to last over some samples, for fits too short to see it in their own residual.

Twenty-five samples less what a parabola takes out of them look white whatever they are. Where the tracker says how
long its errors last, that is where the autoregression starts from, and the residual moves it as far as it can.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from scipy.optimize import minimize

from fitters.noise.autoregression import EDGE, Autoregression, Vector, minus_restricted
from iris_sysid.types import Array, ErrorAutocorrelation

SHORT = 100  # samples; more tell each partial autocorrelation to 0.1 by themselves, better than the tracker does
MOST = 0.95  # of the unit circle, for a partial autocorrelation that was measured


def with_measured_correlation(
    residual: Array, basis: Array, measured: ErrorAutocorrelation | None, alone: Autoregression
) -> Autoregression:
    """Autoregression of the largest restricted likelihood times the density of what is known of it beforehand.

    ``residual`` (n,), NaN in the gaps, in units of its noise; ``basis`` (n, r), dimensionless.

    Known are the inverse hyperbolic tangents of the partial autocorrelations, with normal errors. That is for short
    residuals: others, and those whose own order is higher, keep what they tell alone.

    Parameters
    ----------
    residual, basis
        As for :func:`fitters.noise.autoregression.fit_autoregression`.
    measured
        What the tracker measured of the noise; None where it did not.
    alone
        What the residual tells without it.
    """
    if measured is None or alone.n > SHORT or alone.partial.size > len(measured.partial):
        return alone
    known = np.arctanh(np.clip(measured.partial, -MOST, MOST))
    spread = np.array(measured.stderr) / (1 - np.tanh(known) ** 2)

    def objective(unbounded: Vector) -> float:
        off = (unbounded - known) / spread
        return minus_restricted(residual, basis, EDGE * np.tanh(unbounded))[0] + float(off @ off)

    minimum = minimize(objective, cast("Vector", known), method="L-BFGS-B", jac="3-point")
    partial = np.asarray(EDGE * np.tanh(minimum.x), dtype=np.float64)
    return Autoregression.of(residual, basis, partial)
