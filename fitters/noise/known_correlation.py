"""Known autocorrelation of the noise, for fits too short to estimate it from their own residual.

The residual of a parabola fitted to 25 samples looks white, whatever the noise. Where the tracker measured the
autocorrelation of its errors, that is the prior of the autoregression, and the residual updates it.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from scipy.optimize import minimize

from fitters.noise.autoregression import EDGE, Autoregression, Vector, minus_restricted
from iris_sysid.types import Array, ErrorAutocorrelation

SHORT = 100  # samples; more tell each partial autocorrelation to 0.1 by themselves, better than the tracker does
MOST = 0.95  # largest measured partial autocorrelation that is used


def with_measured_correlation(
    residual: Array, basis: Array, measured: ErrorAutocorrelation | None, alone: Autoregression
) -> Autoregression:
    """Autoregression of largest posterior density: restricted likelihood times the prior that the tracker measured.

    ``residual`` (n,), NaN in the gaps, in units of its noise; ``basis`` (n, r), dimensionless.

    The prior is normal in the inverse hyperbolic tangents of the partial autocorrelations. It is used for short
    residuals only; longer ones, and those whose own order is higher, keep their own autoregression.

    Parameters
    ----------
    residual, basis
        As for :func:`fitters.noise.autoregression.fit_autoregression`.
    measured
        Autocorrelation of the noise as the tracker measured it; None where it did not.
    alone
        The autoregression from the residual without the prior.
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
