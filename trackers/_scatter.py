"""How far a track scatters about smooth motion, beside what its standard errors say: no frame shows it by itself.

A compressed frame is made of parts of the frames before it, moved by whole blocks. What a body as a whole is moved by
looks right in each frame; only from frame to frame does it show.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from iris_sysid.types import Array

DEGREE = 4  # of the local polynomials
WINDOWS = (7, 11, 15, 21, 31)  # frames that one of them follows
FEWEST_WINDOWS = 4
GROWTH = 1.1  # of the scatter from one window to the next: where it grows by more, the window bends with the motion
EVEN = 1.5  # times its even length in time that a window may take: gaps


def with_scatter(t_s: Array, values: Array, sigma: Array) -> Array:
    """Standard errors (n,) raised, all by one factor, to what the values scatter about smooth motion.

    The values are followed by local polynomials of degree 4, weighted by 1/sigma^2. The scatter of a window of w
    samples is the rms of its residuals over sigma, by its w - 5 degrees of freedom; that of a length of window the
    median over all windows, so that impacts do not count. Short windows miss errors that persist over some frames,
    long ones bend with the motion, which goes by a high power of their length: the longest one counts up to which
    the scatter grows by less than a tenth at a time. A factor that chance explains, below 1 + 1/sqrt(n), is left out.

    Parameters
    ----------
    t_s
        Times (n,), s.
    values, sigma
        Measured values (n,) and their standard errors (n,), in one unit; NaN in gaps.
    """
    known = np.isfinite(values) & np.isfinite(sigma) & (sigma > 0)
    scatter = [_scatter(t_s[known], values[known], sigma[known], window) for window in WINDOWS]
    seen = [one for one in scatter if one is not None]
    if not seen:
        return sigma
    factor = seen[0]
    for longer in seen[1:]:
        if longer > GROWTH * factor:
            break
        factor = longer
    significant = factor > 1 + 1 / np.sqrt(np.count_nonzero(known))
    return np.asarray(sigma * factor) if significant else sigma


def _scatter(t_s: Array, values: Array, sigma: Array, window: int) -> float | None:
    """Scatter over sigma in windows of that many samples; None when there are too few windows without gaps."""
    if t_s.size < window + FEWEST_WINDOWS - 1:
        return None
    t, y, s = (sliding_window_view(one, window) for one in (t_s, values, sigma))
    length = t[:, -1] - t[:, 0]
    even = length <= EVEN * (window - 1) * np.median(np.diff(t_s))
    if np.count_nonzero(even) < FEWEST_WINDOWS:
        return None
    u = 2 * (t - t.mean(axis=1, keepdims=True))[even] / length[even, np.newaxis]
    weighted = u[..., np.newaxis] ** np.arange(DEGREE + 1) / s[even][..., np.newaxis]
    level = y - y.mean(axis=1, keepdims=True)
    target = (level / s)[even]
    basis = np.linalg.qr(weighted)[0]
    residual = target - (basis @ (basis.transpose(0, 2, 1) @ target[..., np.newaxis]))[..., 0]
    freedom = window - DEGREE - 1
    median_of_chi2 = freedom * (1 - 2 / (9 * freedom)) ** 3  # Wilson and Hilferty, 1931
    return float(np.sqrt(np.median((residual**2).sum(axis=1)) / median_of_chi2))
