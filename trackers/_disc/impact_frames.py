"""Additional position error in frames whose exposure contains an impact."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from iris_sysid.types import Array

SIDE = 3  # samples before, and after: a parabola leads from them to the exposure between
CLEAR = 6.0  # standard errors: a larger change of velocity is an impact
FOREMOST = 0.5  # of the largest change nearby: a smaller change beside an impact is its echo
RARE = 3.0  # times the median change of the track: a fast circle bends throughout, which does not make it an impact
EVEN = 1.5  # times its even length in time that both sides may take: gaps


def impact_exposure_error(t_s: Array, xy: Array, sigma: Array, shutter: float) -> Array:
    """Additional standard error (n, 2) of positions in whose exposure the velocity changes at once; 0 elsewhere.

    Parabolas through three samples on either side lead to where the motions before and after meet. Where that is
    within the exposure, of length T, the mean position of the body is off the one at its middle by up to dv T / 8.

    Parameters
    ----------
    t_s
        Times (n,) of the middles of the exposures, s.
    xy, sigma
        Positions and standard errors (n, 2), px; NaN in gaps.
    shutter
        Exposure over the time between frames.
    """
    added = np.zeros_like(xy)
    known = np.flatnonzero(np.isfinite(xy).all(axis=1) & np.isfinite(sigma).all(axis=1))
    if known.size < 2 * SIDE + 1 or shutter <= 0:
        return added
    t, x, y = (sliding_window_view(samples[known], 2 * SIDE + 1) for samples in (t_s, *xy.T))
    middle = known[SIDE:-SIDE]
    frame_s = float(np.median(np.diff(t_s)))
    u = (t - t[:, SIDE, np.newaxis]) / frame_s
    both = np.stack([x, y], axis=-1)
    (position, velocity, doubt), (position_after, velocity_after, doubt_after) = (
        _led_to(u[:, side], both[:, side]) for side in (slice(SIDE), slice(SIDE + 1, None))
    )
    change = velocity_after - velocity
    size = np.maximum(np.hypot(*change.T), 1e-6)
    near = sliding_window_view(np.pad(size, SIDE, mode="edge"), 2 * SIDE + 1)
    foremost = size > FOREMOST * near.max(axis=1)
    foremost &= size > RARE * np.median(size)
    meets = ((position - position_after) * change).sum(axis=1) / size**2
    error = np.hypot(doubt, doubt_after) * np.median(sigma[known], axis=0).max()
    even = u[:, -1] - u[:, 0] <= EVEN * 2 * SIDE
    struck = even & foremost & (size > CLEAR * error) & (np.abs(meets) < shutter / 2 + error / size)
    added[middle[struck]] = np.abs(change[struck]) * shutter / 8
    return added


def _led_to(u: Array, values: Array) -> tuple[Array, Array, Array]:
    """Position and velocity at u = 0 by parabolas through samples (n, 3), (n, 3, 2), and that of errors of 1."""
    inverse = np.linalg.inv(u[..., np.newaxis] ** np.arange(SIDE))
    coefficients = inverse @ values
    return coefficients[:, 0], coefficients[:, 1], np.linalg.norm(inverse[:, 1], axis=1)
