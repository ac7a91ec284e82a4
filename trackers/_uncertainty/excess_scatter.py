"""Standard errors of a track raised to what its outline and its scatter show.

A compressed frame consists of motion-compensated blocks of the frames before it. A shift of the whole body looks right
in each frame. Its size shows in the errors of the outline other than a shift, and in the scatter from frame to frame
about local polynomials. Neither is the motion itself: a body may circle, swing, stop and bounce.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import gammaincinv

from iris_sysid.types import Array, ErrorAutocorrelation, Mask
from trackers._frames.arrays import MAD_TO_SD

DEGREE = 4  # of the local polynomials
WINDOWS = (7, 11, 15, 21, 31)  # frames that one of them follows
# windows and degrees that follow faster motion, as a circle of 12 frames a turn; their scatter is less well determined
CLOSER = ((9, 6), (11, 8))
FAST = 1.5  # times the scatter of a closer polynomial: the motion is too fast for one of degree 4
MIN_WINDOWS = 4
# times their median: the squares of windows in which the velocity changes at once; of 10 to 1000 the one whose pulls
# were nearest to 1 on three synthetic drops (seed 4101, first clips); on six others (1280x720 seed 8102, 640x360 seeds
# 8170, 8220, 8270; without the errors of impacts) 1000 to 10,000 are alike, and with 30 to 300 the vertical errors of
# three are stated 2 to 2.3 times too small
KINK = 1000.0
CLEAN = 0.25  # of the windows, at least, hold no such change
FROZEN = 0.3  # of the stated errors: a resting body that scatters less is a copy of one frame
GROWTH = 1.1  # of the scatter from one window to the next: more is the curvature of the motion itself
EVEN = 1.5  # times its length at even frames: a longer window holds gaps
WINDOWS_AT_ONCE = 2_000  # of a long track: the memory for all of them would grow with it


@dataclass(frozen=True, eq=False, slots=True)
class ErrorModel:
    """Autocorrelation of the errors of a track.

    ``moving`` (n,) is true where the body moves: the encoder copies a resting body from frame to frame, with its
    errors. ``autocorrelation`` is None where it could not be measured; the errors then count as independent.
    ``outline_px`` is the standard deviation of the outline's errors other than a shift, px, None where unknown; from
    white noise of the pixels it is ``outline_of_white`` times that of the position.
    """

    moving: Mask
    autocorrelation: ErrorAutocorrelation | None = None
    outline_px: float | None = None
    outline_of_white: float = 1.0

    @property
    def partial(self) -> tuple[float, ...]:
        """Partial autocorrelations at lags of 1, 2, ... frames; empty for independent errors."""
        return () if self.autocorrelation is None else self.autocorrelation.partial

    def by_outline(self, sigma: float) -> float:
        """By how much the errors of the outline beyond white noise raise a standard error of that size; 1 or more."""
        excess = ((self.outline_px or 0.0) / sigma) ** 2 - self.outline_of_white**2
        return float(np.sqrt(1 + max(excess, 0.0)))


def with_scatter(t_s: Array, values: Array, sigma: Array, errors: ErrorModel) -> Array:
    """Standard errors (n,) raised by one factor to the scatter of the values, and to the errors of the outline.

    Local polynomials of degree 4, weighted by 1/sigma^2, are fitted to windows of several lengths. The scatter at each
    length is the median of the squared residuals over sigma^2 (over the windows in which the body moves and its
    velocity does not change at once), divided by its expectation for errors of size sigma and of that autocorrelation,
    which a polynomial partly follows. Short windows miss errors that last over more frames. Long ones show the
    curvature of the motion itself, which grows with a high power of their length: the longest length counts up to which
    the scatter grows by less than a tenth at a time, and a higher degree where that shows that the shortest is too
    long. A factor that chance explains, below 1 + 1/sqrt(n), is ignored.
    The variance of the outline's errors beyond that of pixel noise is part of each error. Those of a resting body that
    does not scatter are at least the typical one while it moved: the encoder copies the frame in which it came to rest.

    Parameters
    ----------
    t_s
        Times (n,), s.
    values, sigma
        Measured values (n,) and their standard errors (n,), in one unit; NaN in gaps.
    errors
        Where the body moves, how long its errors last, and what the outline shows.
    """
    seen = np.isfinite(values) & np.isfinite(sigma) & (sigma > 0)
    moves = errors.moving[seen]
    counted = moves if np.count_nonzero(moves) >= WINDOWS[0] + MIN_WINDOWS else np.ones_like(moves)
    if not counted.any():
        return sigma
    factor = _scatter((t_s[seen], values[seen], sigma[seen], counted), errors.partial)
    significant = factor > 1 + 1 / np.sqrt(np.count_nonzero(counted))
    by_outline = errors.by_outline(float(np.median(sigma[seen][counted])))
    factor = max(factor if significant else 1.0, by_outline)
    raised = np.asarray(sigma * factor)
    return _without_frozen(values, raised, seen & ~errors.moving, seen & errors.moving)


def _scatter(samples: tuple[Array, Array, Array, Mask], partial: tuple[float, ...]) -> float:
    """Scatter over the standard errors; 1 where there are too few samples."""
    scatters = [scatter for window in WINDOWS if (scatter := _scatter_at(samples, partial, window, DEGREE)) is not None]
    if not scatters:
        return 1.0
    closer = [_scatter_at(samples, partial, *lengths) for lengths in CLOSER]
    closest = min((scatter for scatter in closer if scatter is not None), default=scatters[0])
    if scatters[0] > FAST * closest:
        return closest
    factor = scatters[0]
    for longer in scatters[1:]:
        if longer > GROWTH * factor:
            break
        factor = longer
    return factor


def _scatter_at(
    samples: tuple[Array, Array, Array, Mask], partial: tuple[float, ...], window: int, degree: int
) -> float | None:
    """Scatter over the standard errors by polynomials through a window; None where too few windows are whole."""
    square = _median_squares(*samples, window, degree)
    return None if square is None else float(np.sqrt(square / _expected_median(window, degree, partial)))


def _without_frozen(values: Array, sigma: Array, resting: Mask, moving: Mask) -> Array:
    """Standard errors (n,), those of a resting body that does not scatter at least the typical one while it moved."""
    follows = resting[1:] & resting[:-1]
    if not follows.any() or not moving.any():
        return sigma
    step = np.abs(np.diff(values))[follows]
    if MAD_TO_SD * np.median(step) / np.sqrt(2) > FROZEN * np.median(sigma[resting]):
        return sigma
    return np.where(resting, np.maximum(sigma, np.median(sigma[moving])), sigma)


def _median_squares(t_s: Array, values: Array, sigma: Array, counted: Mask, window: int, degree: int) -> float | None:
    """Median over all windows of that many samples of the sum of squared residuals over sigma^2.

    Only windows count in which every sample is ``counted``, and those without a kink: a quarter of the windows is taken
    to have none. None when there are too few windows without gaps.
    """
    if t_s.size < window + MIN_WINDOWS - 1:
        return None
    squares, even = _window_squares(t_s, values, sigma, counted, window, degree)
    if np.count_nonzero(even) < MIN_WINDOWS:
        return None
    squares = squares[even]
    half_freedom = (window - degree - 1) / 2
    of_all = float(gammaincinv(half_freedom, 0.5) / gammaincinv(half_freedom, CLEAN / 2))  # quantiles of chi^2
    typical = of_all * float(np.quantile(squares, CLEAN / 2))
    return float(np.median(squares[squares <= KINK * typical]))


def _window_squares(
    t_s: Array, values: Array, sigma: Array, counted: Mask, window: int, degree: int
) -> tuple[Array, Mask]:
    """Sums (k,) of squared residuals over sigma^2 in each window, and which windows (k,) count: whole and even."""
    longest = EVEN * (window - 1) * float(np.median(np.diff(t_s)))
    squares, even = [], []
    for start in range(0, t_s.size - window + 1, WINDOWS_AT_ONCE):
        part = slice(start, start + WINDOWS_AT_ONCE + window - 1)
        t, y, s = (sliding_window_view(samples[part], window) for samples in (t_s, values, sigma))
        length = t[:, -1] - t[:, 0]
        even.append((length <= longest) & sliding_window_view(counted[part], window).all(axis=1))
        u = 2 * (t - t.mean(axis=1, keepdims=True)) / length[:, np.newaxis]
        weighted = u[..., np.newaxis] ** np.arange(degree + 1) / s[..., np.newaxis]
        target = (y - y.mean(axis=1, keepdims=True)) / s
        basis = np.linalg.qr(weighted)[0]
        residual = target - (basis @ (basis.transpose(0, 2, 1) @ target[..., np.newaxis]))[..., 0]
        squares.append((residual**2).sum(axis=1))
    return np.concatenate(squares), np.concatenate(even)


def _expected_median(window: int, degree: int, partial: tuple[float, ...]) -> float:
    """The median of that sum of squares for errors of standard deviation 1 and those partial autocorrelations.

    For correlated errors the sum is a weighted sum of chi^2, approximated by a scaled chi^2 of the same mean and
    variance (Satterthwaite 1946), whose median is that of Wilson and Hilferty (1931).
    """
    powers = np.vander(np.linspace(-1, 1, window), degree + 1)
    residual_of = np.eye(window) - powers @ np.linalg.pinv(powers)
    lags = np.abs(np.subtract.outer(np.arange(window), np.arange(window)))
    covariance = residual_of @ _autocorrelation(window, partial)[lags] @ residual_of
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
