"""How far a track scatters about smooth motion, beside what its standard errors say: no frame shows it by itself.

A compressed frame is made of parts of the frames before it, moved by whole blocks. What a body as a whole is moved by
looks right in each frame; only from frame to frame does it show.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import toeplitz

from iris_sysid.types import Array, Mask

DEGREE = 4  # of the local polynomials
WINDOWS = (7, 11, 15, 21, 31)  # frames that one of them follows
FEWEST_WINDOWS = 4
GROWTH = 1.1  # of the scatter from one window to the next: where it grows by more, the window bends with the motion
EVEN = 1.5  # times its even length in time that a window may take: gaps


@dataclass(frozen=True, eq=False, slots=True)
class Steadiness:
    """What is known of the errors of a track beside their size.

    ``moving`` (n,) says where the body moves: what rests is copied from frame to frame, and its errors with it.
    ``memory`` are their partial autocorrelations at one and two frames; () where nothing says them.
    """

    moving: Mask
    memory: tuple[float, ...] = ()


def with_scatter(t_s: Array, values: Array, sigma: Array, known: Steadiness) -> Array:
    """Standard errors (n,) raised, all by one factor, to what the values scatter about smooth motion.

    The values are followed by local polynomials of degree 4, weighted by 1/sigma^2. The scatter of a length of window
    is that of the residuals over sigma, by the median over all windows in which the body moves, so that impacts do not
    count, over what it is for errors of size sigma and that memory: a polynomial follows errors that last. Short
    windows miss errors that persist over more frames, long ones bend with the motion, which goes by a high power of
    their length: the longest one counts up to which the scatter grows by less than a tenth at a time. A factor that
    chance explains, below 1 + 1/sqrt(n), is left out.

    Parameters
    ----------
    t_s
        Times (n,), s.
    values, sigma
        Measured values (n,) and their standard errors (n,), in one unit; NaN in gaps.
    known
        Where the body moves (n,), and how long its errors last.
    """
    seen = np.isfinite(values) & np.isfinite(sigma) & (sigma > 0)
    moves = known.moving[seen]
    counted = moves if np.count_nonzero(moves) >= WINDOWS[0] + FEWEST_WINDOWS else np.ones_like(moves)
    samples = t_s[seen], values[seen], sigma[seen], counted
    squares = {window: _median_squares(*samples, window) for window in WINDOWS}
    found = [np.sqrt(one / _expected(window, known.memory)) for window, one in squares.items() if one is not None]
    if not found:
        return sigma
    factor = found[0]
    for longer in found[1:]:
        if longer > GROWTH * factor:
            break
        factor = longer
    significant = factor > 1 + 1 / np.sqrt(np.count_nonzero(counted))
    return np.asarray(sigma * factor) if significant else sigma


def _median_squares(t_s: Array, values: Array, sigma: Array, counted: Mask, window: int) -> float | None:
    """Median, over windows of so many samples that all count, of the sum of squares over sigma that is left over.

    None when there are too few windows without gaps.
    """
    if t_s.size < window + FEWEST_WINDOWS - 1:
        return None
    t, y, s = (sliding_window_view(one, window) for one in (t_s, values, sigma))
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


def _expected(window: int, memory: tuple[float, ...]) -> float:
    """The median of that for errors of size 1.

    Of correlated errors it is a weighted sum of chi^2, taken as one of as much mean and variance (Satterthwaite 1946),
    whose median is by Wilson and Hilferty (1931).
    """
    powers = np.vander(np.linspace(-1, 1, window), DEGREE + 1)
    left = np.eye(window) - powers @ np.linalg.pinv(powers)
    covariance = left @ toeplitz(_autocorrelation(window, memory)) @ left
    mean, squares = float(np.trace(covariance)), float((covariance**2).sum())
    freedom = mean**2 / squares
    return mean * (1 - 2 / (9 * freedom)) ** 3


def _autocorrelation(count: int, memory: tuple[float, ...]) -> Array:
    """Of errors with those partial autocorrelations at one and two frames, 0 to ``count`` - 1 frames apart."""
    first, second = (*memory, 0.0, 0.0)[:2]
    found = np.ones(count)
    found[1] = first
    for apart in range(2, count):
        found[apart] = first * (1 - second) * found[apart - 1] + second * found[apart - 2]
    return found
