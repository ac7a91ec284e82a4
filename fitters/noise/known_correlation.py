"""Known autocorrelation and size of the noise, for fits too short to estimate them from their own residual.

The residual of a parabola fitted to 25 samples looks white, whatever the noise, and smaller than it is: what lasts over
many samples is taken for motion. Where the tracker measured the autocorrelation of its errors, that is the prior of
the autoregression, and the size that it states one of their variance; the residual updates both.
"""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
from scipy.optimize import minimize

from fitters.noise.autoregression import EDGE, Autoregression, Vector, autocovariance, minus_restricted
from iris_sysid.types import Array, ErrorAutocorrelation

SHORT = 100  # samples; more tell each partial autocorrelation to 0.1 by themselves, better than the tracker does
MAX_PARTIAL = 0.95  # largest measured partial autocorrelation that is used
# independent samples that the stated size counts for: stated errors of tracks are true to a factor of 1.4, one standard
# deviation (the table of pulls, 960x540 seed 4101; validation/tracking.md)
STATED_COUNTS = 4.0


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
    known = np.arctanh(np.clip(measured.partial, -MAX_PARTIAL, MAX_PARTIAL))
    spread = np.array(measured.stderr) / (1 - np.tanh(known) ** 2)

    def objective(unbounded: Vector) -> float:
        off = (unbounded - known) / spread
        return minus_restricted(residual, basis, EDGE * np.tanh(unbounded))[0] + float(off @ off)

    minimum = minimize(objective, cast("Vector", known), method="L-BFGS-B", jac="3-point")
    partial = np.asarray(EDGE * np.tanh(minimum.x), dtype=np.float64)
    return Autoregression.of(residual, basis, partial)


def with_stated_size(process: Autoregression, stated: float) -> Autoregression:
    """The autoregression with its variance averaged with the stated one, where that is larger.

    Each variance counts by its number of independent samples: a process of autocorrelations r_k over n samples has
    n / (1 + 2 sum r_k^2) (Bartlett 1946). A smaller stated one is left alone: the residual is then more than noise.

    Parameters
    ----------
    process
        From a residual of at most ``SHORT`` samples; longer ones are returned as they are.
    stated
        Standard deviation of single samples that the tracker states, in the unit of the residual; NaN where unknown.
    """
    if process.n > SHORT or not stated > process.sd > 0:
        return process
    correlation = autocovariance(process.partial, process.n)[1:] * (process.innovation_sd / process.sd) ** 2
    independent = process.n / (1 + 2 * float(correlation @ correlation))
    raised = (independent + STATED_COUNTS * (stated / process.sd) ** 2) / (independent + STATED_COUNTS)
    return replace(process, innovation_sd=process.innovation_sd * float(np.sqrt(raised)))
