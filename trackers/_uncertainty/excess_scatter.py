"""Standard errors of a track raised to its scatter about smooth motion, by local polynomials over time.

A compressed frame consists of motion-compensated blocks of the frames before it. A shift of the whole body looks right
in each frame; only the scatter from frame to frame shows it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import toeplitz

from iris_sysid.types import Array, ErrorAutocorrelation, Mask

DEGREE = 4  # of the local polynomials
WINDOWS = (7, 11, 15, 21, 31)  # frames that one of them follows
FEWEST_WINDOWS = 4
GROWTH = 1.1  # of the scatter from one window to the next: more is the curvature of the motion itself
EVEN = 1.5  # times its length at even frames: a longer window holds gaps


@dataclass(frozen=True, eq=False, slots=True)
class ErrorModel:
    """Autocorrelation of the errors of a track.

    ``moving`` (n,) is true where the body moves: the encoder copies a resting body from frame to frame, with its
    errors. ``autocorrelation`` is None where it could not be measured; the errors then count as independent.
    """

    moving: Mask
    autocorrelation: ErrorAutocorrelation | None = None

    @property
    def partial(self) -> tuple[float, ...]:
        """Partial autocorrelations at lags of 1, 2, ... frames; empty for independent errors."""
        return () if self.autocorrelation is None else self.autocorrelation.partial


def with_scatter(t_s: Array, values: Array, sigma: Array, errors: ErrorModel) -> Array:
    """Standard errors (n,) raised, all by one factor, to the scatter of the values about smooth motion.

    Local polynomials of degree 4, weighted by 1/sigma^2, are fitted to windows of several lengths. The scatter at each
    length is the median of the squared residuals over sigma^2 (a median, so that impacts do not count; over all windows
    in which the body moves), divided by its expectation for errors of size sigma and of that autocorrelation, which a
    polynomial partly follows. Short windows miss errors that last over more frames. Long ones show the curvature of
    the motion itself, which grows with a high power of their length: the longest length counts up to which the scatter
    grows by less than a tenth at a time. A factor that chance explains, below 1 + 1/sqrt(n), is ignored.

    Parameters
    ----------
    t_s
        Times (n,), s.
    values, sigma
        Measured values (n,) and their standard errors (n,), in one unit; NaN in gaps.
    errors
        Where the body moves, and how long its errors last.
    """
    seen = np.isfinite(values) & np.isfinite(sigma) & (sigma > 0)
    moves = errors.moving[seen]
    counted = moves if np.count_nonzero(moves) >= WINDOWS[0] + FEWEST_WINDOWS else np.ones_like(moves)
    samples = t_s[seen], values[seen], sigma[seen], counted
    squares = {window: _median_squares(*samples, window) for window in WINDOWS}
    scatters = [
        np.sqrt(square / _expected_median(window, errors.partial))
        for window, square in squares.items()
        if square is not None
    ]
    if not scatters:
        return sigma
    factor = scatters[0]
    for longer in scatters[1:]:
        if longer > GROWTH * factor:
            break
        factor = longer
    significant = factor > 1 + 1 / np.sqrt(np.count_nonzero(counted))
    return np.asarray(sigma * factor) if significant else sigma


def _median_squares(t_s: Array, values: Array, sigma: Array, counted: Mask, window: int) -> float | None:
    """Median over all windows of that many samples of the sum of squared residuals over sigma^2.

    Only windows count in which every sample is ``counted``. None when there are too few windows without gaps.
    """
    if t_s.size < window + FEWEST_WINDOWS - 1:
        return None
    t, y, s = (sliding_window_view(samples, window) for samples in (t_s, values, sigma))
    length = t[:, -1] - t[:, 0]
    even = length <= EVEN * (window - 1) * np.median(np.diff(t_s))
    even &= sliding_window_view(counted, window).all(axis=1)
    if np.count_nonzero(even) < FEWEST_WINDOWS:
        return None
    u = 2 * (t - t.mean(axis=1, keepdims=True))[even] / length[even, np.newaxis]
    weighted = u[..., np.newaxis] ** np.arange(DEGREE + 1) / s[even][..., np.newaxis]
    level = y - y.mean(axis=1, keepdims=True)
    target = (level / s)[even]
    basis = np.linalg.qr(weighted)[0]
    residual = target - (basis @ (basis.transpose(0, 2, 1) @ target[..., np.newaxis]))[..., 0]
    return float(np.median((residual**2).sum(axis=1)))


def _expected_median(window: int, partial: tuple[float, ...]) -> float:
    """The median of that sum of squares for errors of standard deviation 1 and those partial autocorrelations.

    For correlated errors the sum is a weighted sum of chi^2, approximated by a scaled chi^2 of the same mean and
    variance (Satterthwaite 1946), whose median is that of Wilson and Hilferty (1931).
    """
    powers = np.vander(np.linspace(-1, 1, window), DEGREE + 1)
    residual_of = np.eye(window) - powers @ np.linalg.pinv(powers)
    covariance = residual_of @ toeplitz(_autocorrelation(window, partial)) @ residual_of
    mean, squares = float(np.trace(covariance)), float((covariance**2).sum())
    freedom = mean**2 / squares
    return mean * (1 - 2 / (9 * freedom)) ** 3


def _autocorrelation(count: int, partial: tuple[float, ...]) -> Array:
    """Autocorrelation at lags 0 to ``count`` - 1 of a process of order 2 with those partial autocorrelations."""
    first, second = (*partial, 0.0, 0.0)[:2]
    correlation = np.ones(count)
    correlation[1] = first
    for lag in range(2, count):
        correlation[lag] = first * (1 - second) * correlation[lag - 1] + second * correlation[lag - 2]
    return correlation
