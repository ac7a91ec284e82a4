"""Autoregressive noise in the residual of a fit: order by BIC, coefficients by restricted maximum likelihood.

A fit absorbs the part of the noise that its parameters can imitate, mostly slow parts, so plain estimates of the
residual's autocorrelation are too small. The restricted likelihood (Patterson and Thompson 1971, Biometrika 58, 545)
uses only the part of the data that the fit cannot imitate, and has no such bias to first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, toeplitz
from scipy.optimize import minimize

from iris_sysid.types import Array

Vector: TypeAlias = np.ndarray[tuple[int], np.dtype[np.float64]]

MAX_ORDER = 8
MAX_GAP = 5000  # samples; noise is not correlated over more
RESTRICTED_UP_TO = 5000  # samples; beyond, the share that the fit absorbs is negligible
EDGE = 0.999  # largest partial autocorrelation; 1 is the unit circle
TOLERANCE = 1e-10  # relative, of the likelihood
DIGITS_LOST = 1e-4  # largest rounding error of -2 log L: products of very smooth columns cancel when whitened


@dataclass(frozen=True, eq=False, slots=True)
class Autoregression:
    """e[t] = sum_k coefficients[k] e[t - 1 - k] + white noise of standard deviation ``innovation_sd``.

    ``partial`` (q,) are the partial autocorrelations, ``coefficients`` (q,) follow from them; ``n`` is the
    number of independent white samples behind the estimate, parameters of the fit deducted.
    """

    partial: Array
    coefficients: Array
    innovation_sd: float
    n: int

    @classmethod
    def of(cls, residual: Array, basis: Array, partial: Array) -> Autoregression:
        """The autoregression with given partial autocorrelations (q,), and its innovations from a residual.

        Partial autocorrelations are dimensionless, innovations in the unit of the residual.

        ``residual`` and ``basis`` as for :func:`fit_autoregression`.
        """
        degrees = max(int(np.isfinite(residual).sum()) - basis.shape[1], 1)
        return cls(partial, coefficients_of(partial)[-1], minus_restricted(residual, basis, partial)[1], degrees)

    @property
    def sd(self) -> float:
        """Standard deviation of the noise itself."""
        return self.innovation_sd / float(np.sqrt(np.prod(1.0 - self.partial**2)))

    def partial_covariance(self) -> Array:
        """Asymptotic covariance (q, q) of the partial autocorrelations.

        It is dimensionless.

        The covariance of the coefficients is the innovation variance over n times the inverse autocovariance matrix
        (Brockwell and Davis 1991, section 8.1); central differences transform it to partial autocorrelations.
        """
        order = self.partial.size
        steps = 1e-5 * np.eye(order) * (1.0 - self.partial**2)
        moved = [coefficients_of(self.partial + step)[-1] - coefficients_of(self.partial - step)[-1] for step in steps]
        # of exact data the residual is rounding, and either matrix may be singular
        inverse = np.linalg.pinv(np.array(moved).T / (2.0 * np.diag(steps)))
        covariance = np.linalg.pinv(toeplitz(autocovariance(self.partial, order)), hermitian=True) / self.n
        return np.asarray(inverse @ covariance @ inverse.T)


def grid_positions(t_s: Array) -> NDArray[np.int64]:
    """Index of each sample on an even grid of frames; lost frames leave holes, long gaps are shortened.

    ``t_s`` (n,), s.
    """
    step = np.diff(t_s)
    if step.size == 0:
        return np.zeros(t_s.size, dtype=np.int64)
    jumps = np.clip(np.rint(step / np.median(step)), 1, MAX_GAP).astype(np.int64)
    return np.concatenate([[0], np.cumsum(jumps)])


def on_grid(positions: NDArray[np.int64], values: Array, fill: float) -> Array:
    """Put values (n, ...) on the even grid, with ``fill`` where there is no sample.

    The unit does not change; ``positions`` (n,) are indices.
    """
    spread = np.full((int(positions[-1]) + 1, *values.shape[1:]), fill)
    spread[positions] = values
    return spread


def coefficients_of(partial: Array) -> list[Array]:
    """Coefficients of the predictors of order 0 to q from partial autocorrelations (Durbin 1960, Levinson 1947).

    ``partial`` (q,), and q + 1 arrays of coefficients (0,) to (q,): all dimensionless.
    """
    rows = [np.zeros(0)]
    for k, reflection in enumerate(partial):
        before = rows[-1]
        rows.append(np.concatenate([before - reflection * before[::-1], [reflection]]) if k else np.array([reflection]))
    return rows


def autocovariance(partial: Array, count: int) -> Array:
    """Autocovariance at lags 0 to count - 1 of the process with unit innovation variance.

    ``partial`` (q,) and the result (count,) are dimensionless.
    """
    rows = coefficients_of(partial)
    gamma = [1.0 / float(np.prod(1.0 - partial**2))]
    for lag in range(1, count):
        row = rows[min(lag, partial.size)]
        gamma.append(float(sum(row[k] * gamma[lag - 1 - k] for k in range(min(row.size, lag)))))
    return np.array(gamma)


def burg(residual: Array, max_order: int) -> tuple[Array, Array]:
    """Partial autocorrelations (max_order,) and innovation variances (max_order + 1,) of a residual with NaN gaps.

    Autocorrelations are dimensionless, variances in the squared unit of the residual (n,).

    Burg (1967): forward and backward prediction errors are minimised together, so that the result is stable.
    """
    forward, backward = residual.copy(), residual.copy()
    variance = [float(np.nanmean(residual**2))]
    partial = []
    for _ in range(max_order):
        ahead, behind = forward[1:], backward[:-1]
        both = np.isfinite(ahead) & np.isfinite(behind)
        power = float(np.sum(ahead[both] ** 2 + behind[both] ** 2))
        reflection = 2.0 * float(np.sum(ahead[both] * behind[both])) / power if power > 0 else 0.0
        partial.append(float(np.clip(reflection, -EDGE, EDGE)))
        forward, backward = ahead - partial[-1] * behind, behind - partial[-1] * ahead
        variance.append(variance[-1] * (1.0 - partial[-1] ** 2))
    return np.array(partial), np.array(variance)


def choose_order(variance: Array, n: int) -> int:
    """Order with the smallest Bayesian information criterion n log(variance) + order log(n) (Schwarz 1978).

    ``variance`` (q + 1,), in the squared unit of the residual, by order.
    """
    criterion = n * np.log(np.maximum(variance, 1e-300)) + np.arange(variance.size) * np.log(n)
    return int(np.argmin(criterion))


def fit_autoregression(residual: Array, basis: Array) -> Autoregression:
    """Fit an autoregression to a residual on an even grid.

    The residual may have any unit; the basis is dimensionless.

    Parameters
    ----------
    residual
        (n,) with NaN where there is no sample.
    basis
        (n, r) orthonormal basis of what the fit can absorb; any values in the gaps.
    """
    n = int(np.isfinite(residual).sum())
    most = int(np.clip((n - basis.shape[1]) // 10, 0, MAX_ORDER))
    partial, variance = burg(residual, most)
    order = choose_order(variance, n)
    chosen = partial[:order]
    if order and n <= RESTRICTED_UP_TO:
        chosen = _most_likely(residual, basis, chosen)
    return Autoregression.of(residual, basis, chosen)


def _most_likely(residual: Array, basis: Array, start: Array) -> Array:
    """Partial autocorrelations of largest restricted likelihood, from a start; tanh keeps them below 1."""
    products = _LaggedProducts.of(residual, basis, start.size)

    def quick(unbounded: Vector) -> tuple[float, Vector]:
        inside = np.tanh(unbounded)
        value, gradient = products.minus_restricted(EDGE * inside)
        return value, cast("Vector", gradient * EDGE * (1.0 - inside**2))

    def exact(unbounded: Vector) -> float:
        return minus_restricted(residual, basis, EDGE * np.tanh(unbounded))[0]

    unbounded = cast("Vector", np.arctanh(start / EDGE * (1 - 1e-6)))
    try:
        minimum = minimize(quick, unbounded, method="L-BFGS-B", jac=True, tol=TOLERANCE)
        holds = minimum.success and abs(minimum.fun - exact(minimum.x)) < DIGITS_LOST
    except (LinAlgError, ValueError):  # singular to rounding, or too large to be squared
        holds = False
    if not holds:
        minimum = minimize(exact, unbounded, method="L-BFGS-B", jac="3-point", tol=TOLERANCE)
    return np.asarray(EDGE * np.tanh(minimum.x), dtype=np.float64)


@dataclass(frozen=True, eq=False, slots=True)
class _LaggedProducts:
    """Sufficient sums of a residual and a basis x (n, c) for the restricted likelihood of order q, from one pass.

    ``products`` (q + 1, q + 1, c, q + 1, c): sums of x[t - i, a] x[t - j, b] over the samples that the predictor of
    each order predicts (lower orders just after a gap); ``counts`` (q + 1,) of these samples; ``degrees`` of freedom.
    """

    products: Array
    counts: Array
    degrees: int

    @classmethod
    def of(cls, residual: Array, basis: Array, order: int) -> _LaggedProducts:
        present = np.isfinite(residual)
        columns = np.where(present[:, None], np.column_stack([residual, basis]), 0.0)
        padded = np.concatenate([np.zeros((order, columns.shape[1])), columns])
        ends = range(order, -1, -1)
        lagged = np.stack([padded[end : end + len(columns)] for end in ends], axis=1).reshape(len(columns), -1)
        order_at = np.where(present, np.minimum(_run_length(present) - 1, order), -1)
        parts = [lagged[order_at == length] for length in range(order + 1)]
        products = np.array([part.T @ part for part in parts])
        shape = (order + 1, *(order + 1, columns.shape[1]) * 2)
        counts = np.array([float(len(part)) for part in parts])
        return cls(products.reshape(shape), counts, max(int(present.sum()) - basis.shape[1], 1))

    def minus_restricted(self, partial: Array) -> tuple[float, Array]:
        """:func:`minus_restricted` and its gradient (q,); LinAlgError or ValueError when they do not exist."""
        filters, slopes = _filters(partial)
        shares, share_slopes = _shares(partial)
        half = np.einsum("piajb,pj->piab", self.products, filters)
        filtered = np.einsum("piab,pi->pab", half, filters)
        white = np.einsum("p,pab->ab", shares, filtered)  # products of the whitened columns
        factor = cho_factor(white[1:, 1:], lower=True)
        taken = cho_solve(factor, white[1:, 0])
        square = max(float(white[0, 0] - white[1:, 0] @ taken), 1e-300)
        logs = np.sum(np.log(np.diag(factor[0])))
        value = float(-self.counts @ np.log(shares) + 2.0 * logs + self.degrees * np.log(square))
        combination = np.append(1.0, -taken)
        by_white = self.degrees / square * np.outer(combination, combination)
        by_white[1:, 1:] += cho_solve(factor, np.eye(taken.size))
        by_share = shares * np.einsum("pab,ab->p", filtered, by_white) - self.counts
        by_filter = 2.0 * shares[:, None] * np.einsum("piab,ab->pi", half, by_white)
        return value, by_share @ share_slopes + np.einsum("mpi,pi->m", slopes, by_filter)


def _filters(partial: Array) -> tuple[Array, Array]:
    """Prediction-error filters (q + 1, q + 1) of order 0 to q, and their slopes (q, q + 1, q + 1) by each partial."""
    order = partial.size
    filters, slopes = np.zeros((order + 1, order + 1)), np.zeros((order, order + 1, order + 1))
    filters[:, 0] = 1.0
    for p, reflection in enumerate(partial):
        back = filters[p, : p + 1][::-1]
        filters[p + 1] = filters[p]
        filters[p + 1, 1 : p + 2] -= reflection * back
        slopes[:, p + 1] = slopes[:, p]
        slopes[:, p + 1, 1 : p + 2] -= reflection * slopes[:, p, : p + 1][:, ::-1]
        slopes[p, p + 1, 1 : p + 2] -= back
    return filters, slopes


def _shares(partial: Array) -> tuple[Array, Array]:
    """Innovation over prediction variance (q + 1,) of the predictors, and the slopes (q + 1, q) of its log."""
    left = 1.0 - partial**2
    shares = np.append(np.cumprod(left[::-1])[::-1], 1.0)
    later = np.arange(partial.size) >= np.arange(partial.size + 1)[:, None]
    return shares, np.where(later, -2.0 * partial / left, 0.0)


def minus_restricted(residual: Array, basis: Array, partial: Array) -> tuple[float, float]:
    """Minus twice the log restricted likelihood, innovation variance profiled out; and the root of that variance.

    The root has the unit of ``residual`` (n,); ``basis`` (n, r) and ``partial`` (q,) are dimensionless.
    """
    white, variances = whiten(np.column_stack([residual, basis]), partial)
    directions, triangle = np.linalg.qr(white[:, 1:])
    inside = directions.T @ white[:, 0]
    square = float(white[:, 0] @ white[:, 0] - inside @ inside)
    degrees = max(white.shape[0] - basis.shape[1], 1)
    logs = np.log(np.abs(np.diag(triangle)) + 1e-300)
    value = float(np.sum(np.log(variances)) + 2.0 * np.sum(logs) + degrees * np.log(max(square, 1e-300)))
    return value, float(np.sqrt(max(square, 0.0) / degrees))


def whiten(columns: Array, partial: Array) -> tuple[Array, Array]:
    """Standardised one-step prediction errors (n, c) of columns whose first one has NaN gaps, and their variances.

    Errors in the unit of the columns, variances dimensionless; ``partial`` (q,), dimensionless.

    After each gap the predictors of lower order are used until enough samples are known, with their larger
    variance; gaps themselves are left out. Unit innovation variance.
    """
    present = np.isfinite(columns[:, 0])
    known = _run_length(present)
    rows = coefficients_of(partial)
    shares = _shares(partial)[0]
    filled = np.where(present[:, None], columns, 0.0)
    taps = np.concatenate([[1.0], -rows[-1]])
    error = np.column_stack([np.convolve(column, taps)[: len(filled)] for column in filled.T])
    for order in range(partial.size):
        at = np.flatnonzero(known == order + 1)
        error[at] = filled[at] - np.einsum("k,akc->ac", rows[order], filled[at[:, None] - np.arange(1, order + 1)])
    order_at = np.minimum(known[present] - 1, partial.size)
    variances = 1.0 / shares[order_at]
    return np.asarray(error[present] / np.sqrt(variances)[:, None]), np.asarray(variances)


def _run_length(present: NDArray[np.bool_]) -> NDArray[np.int64]:
    """1, 2, 3, ... along each run of True, 0 elsewhere."""
    index = np.arange(present.size)
    last_gap = np.maximum.accumulate(np.where(present, -1, index))
    return np.where(present, index - last_gap, 0)
