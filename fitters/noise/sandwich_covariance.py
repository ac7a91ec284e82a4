"""Covariance of least-squares estimates whose residual is correlated in time: the sandwich.

With J the sensitivities and Gamma the covariance of the noise, both in units of sigma, the covariance is
(J'J)^-1 J' Gamma J (J'J)^-1 (White 1980; Gallant 1987, Nonlinear Statistical Models, chapter 2). Gamma is that of
an autoregression fitted to the residual, so the middle costs one filter pass over J, also for a million samples.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitters.noise.autoregression import Autoregression, coefficients_of, fit_autoregression, grid_positions, on_grid
from fitters.noise.known_correlation import with_measured_correlation, with_stated_size
from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array, ErrorAutocorrelation, student_ppf

MAX_LAG = 20_000  # samples before the first one that its noise may be correlated with
MAX_DEGREES = 1e6


@dataclass(frozen=True, eq=False, slots=True)
class Uncertainty:
    """Random uncertainty of the free values.

    ``covariance`` (k, k); ``degrees`` (k,) effective degrees of freedom of each variance, for Student's t;
    ``noise`` one autoregression a quantity, in units of sigma.
    """

    covariance: Array
    degrees: Array
    noise: tuple[Autoregression, ...]


def quantile_975(degrees: float) -> float:
    """97.5 % quantile of Student's t, the normal's for many degrees of freedom."""
    return student_ppf(0.975, float(np.clip(degrees, 1.0, MAX_DEGREES)))


def inverse_normal(jacobian: Array, smallest: float = 0.0) -> Array:
    """(J'J)^-1 (k, k) of sensitivities (m, k), computed with columns scaled to unit length.

    Directions whose singular value is below ``smallest`` times the largest are left out (pseudo-inverse).
    """
    size = np.sqrt(np.sum(jacobian**2, axis=0))
    size = np.where(size > 0, size, 1.0)
    _, singular, right = np.linalg.svd(np.linalg.qr(jacobian / size, mode="r"))
    keep = singular > smallest * singular.max(initial=0.0)
    scaled = right[keep].T / singular[keep]
    return np.asarray(scaled @ scaled.T / np.outer(size, size))


def random_uncertainty(
    t_s: Array,
    residual: Array,
    sensitivity: Array,
    bread: Array,
    measured: ErrorAutocorrelation | None = None,
    stated: Array | None = None,
) -> Uncertainty:
    """Covariance of the free values from the residual, autocorrelation allowed for.

    Parameters
    ----------
    t_s
        (n,) s, the samples used.
    residual
        (n, d) in units of sigma.
    sensitivity
        (n, d, k) d predicted / d value, in units of sigma.
    bread
        (k, k) :func:`inverse_normal` of the sensitivities.
    measured
        Autocorrelation of the noise where the tracker measured it: short residuals need it.
    stated
        (d,) standard deviations of single samples as the tracker states them, in units of sigma; None where unknown.

    Notes
    -----
    The effective degrees of freedom of a variance V follow from its own uncertainty, 2 V^2 / var(V)
    (Satterthwaite 1946), var(V) by linear propagation from the coefficients and the innovation variance.
    """
    _, d, k = sensitivity.shape
    positions = grid_positions(t_s)
    total, spread, noise = np.zeros((k, k)), np.zeros(k), []
    for channel in range(d):
        columns = on_grid(positions, sensitivity[:, channel], 0.0)
        errors = on_grid(positions, residual[:, channel], np.nan)
        basis = orthonormal_basis(columns)
        process = with_measured_correlation(errors, basis, measured, fit_autoregression(errors, basis))
        if stated is not None:
            process = with_stated_size(process, float(stated[channel]))
        part = bread @ middle(columns, process.coefficients) @ bread * process.innovation_sd**2
        total += part
        spread += _variance_of_variance(columns, bread, process, np.diag(part))
        noise.append(process)
    variance = np.diag(total)
    degrees = np.divide(2 * variance**2, spread, out=np.full(k, MAX_DEGREES), where=spread > 0)
    return Uncertainty(total, degrees, tuple(noise))


def orthonormal_basis(columns: Array) -> Array:
    """Orthonormal basis (n, r) of the span of columns (n, k), directions below 1e-7 of the largest left out.

    The basis is dimensionless.
    """
    size = np.sqrt(np.sum(columns**2, axis=0))
    present = columns[:, size > 0] / size[size > 0]
    left, singular, _ = np.linalg.svd(present, full_matrices=False)
    return np.asarray(left[:, singular > 1e-7 * singular.max(initial=0.0)])


def middle(columns: Array, coefficients: Array) -> Array:
    """J' Gamma J (k, k) for an autoregression of unit innovation variance and J (n, k) on an even grid.

    Noise e = sum_k psi_k u[t - k] of white u gives J'e = sum_t w[t] u[t]. Here w is the filter run backwards over J,
    and beyond the first sample for as long as the noise is correlated. So J' Gamma J = sum_t w[t] w[t]'.
    """
    if coefficients.size == 0:
        return np.asarray(columns.T @ columns)
    padded = np.concatenate([columns[::-1], np.zeros((_memory(coefficients), columns.shape[1]))])
    filtered = _all_pole_filter(coefficients, padded)
    return np.asarray(filtered.T @ filtered)


@kernel()
def _all_pole_filter(coefficients: Array, columns: Array) -> Array:
    """y[t] = x[t] + sum_k coefficients[k] y[t - 1 - k] of every column x (n, k), in direct form II transposed.

    As ``scipy.signal.lfilter`` computes it, which takes a second to import.
    """
    filtered = np.empty_like(columns)
    delayed = np.zeros((coefficients.size + 1, columns.shape[1]))
    for t in range(columns.shape[0]):
        for k in range(columns.shape[1]):
            value = columns[t, k] + delayed[0, k]
            filtered[t, k] = value
            for order in range(coefficients.size):
                delayed[order, k] = delayed[order + 1, k] + coefficients[order] * value
    return filtered


def _memory(coefficients: Array) -> int:
    """Samples until the impulse response has fallen to 1e-6."""
    slowest = float(np.max(np.abs(np.roots(np.concatenate([[1.0], -coefficients])))))
    if not 0 < slowest < 1:
        return MAX_LAG
    return int(np.clip(np.ceil(np.log(1e-6) / np.log(slowest)), coefficients.size, MAX_LAG))


def _variance_of_variance(columns: Array, bread: Array, process: Autoregression, variance: Array) -> Array:
    """Variance (k,) of the contribution of one quantity to the variances."""
    spread = 2.0 * variance**2 / process.n
    if process.coefficients.size == 0:
        return np.asarray(spread)
    slopes = np.array([_slope(columns, bread, process, index) for index in range(process.coefficients.size)])
    return np.asarray(spread + np.einsum("ak,ab,bk->k", slopes, process.partial_covariance(), slopes))


def _slope(columns: Array, bread: Array, process: Autoregression, index: int) -> Array:
    """Derivative of the variance (k,) with respect to one partial autocorrelation, by central differences."""
    step = 1e-4 * (1.0 - process.partial[index] ** 2)
    sides = []
    for sign in (1.0, -1.0):
        partial = process.partial.copy()
        partial[index] += sign * step
        sides.append(np.diag(bread @ middle(columns, coefficients_of(partial)[-1]) @ bread))
    return np.asarray((sides[0] - sides[1]) / (2 * step) * process.innovation_sd**2)
