"""Centroid of a motion-blurred round body: a disc swept along a line, fitted to the pixels.

The outline of such a body is as wide as its path within the exposure, so that only the shape, the swept disc,
separates its own brightness from that of the background. Each frame is fitted by itself; the tracker ``disc`` knows
the motion from the frames before and after, and is more precise where every body is a disc.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.types import Array
from trackers._detection.image_operations import dilated
from trackers._detection.subpixel_centroid import Centre, Window
from trackers._detection.swept_disc import sweep_terms, swept_left_over, swept_slopes
from trackers._detection.window_setup import moments_of_difference
from trackers._frames.arrays import MAD_TO_SD, Flags

MIN_WAY = 0.5  # of the radius: after a shorter distance the outline still shows the body
MAX_RADIUS_RATIO = 1.5  # fitted radius over the radius by the moments: a larger disc fits an outline without streak
MIN_RADIUS = 15.0  # px, radius: of a smaller disc too few pixels tell shading, shadow and sweep apart
FRINGE = 5  # px round the body that are compared
THINNED = 4  # every fourth pixel determines the sweep well enough to find the outliers
OUTLIER = 4.0  # standard deviations: a cord, a mark, another body
# of the sum of squares: a body that is not a disc, or that turned back within the exposure, leaves more; a disc 0.01
UNEXPLAINED = 0.02
HOPELESS, DOUBTFUL = 0.15, 0.03  # the same of a fourth of the pixels, by the guess and by the first fit
STEPS = 100  # at most
FIRST, SOON = 2, 0.35  # steps of the fit; after them a way below this share of the radius is not a streak
ROUGH, PRECISE = 1e-3, 1e-5  # relative change of the sum of squares at which a fit ends
BLOCK = 16  # px: a coder moves and rounds squares of this size as one


@dataclass(frozen=True, slots=True)
class Sweep:
    """A disc whose centre moves evenly by ``way`` (across, down) about (x, y) during the exposure, all px."""

    x: float
    y: float
    across: float
    down: float
    radius: float

    @property
    def values(self) -> Array:
        """The five numbers. Shape (5,), in px."""
        return np.array([self.x, self.y, self.across, self.down, self.radius])

    @property
    def length(self) -> float:
        """Of the way, px."""
        return float(np.hypot(self.across, self.down))

    @property
    def is_streak(self) -> bool:
        """Whether the outline is too wide to be seen as such, of a disc large enough to show its shading beside it."""
        return self.radius > MIN_RADIUS and self.length > MIN_WAY * self.radius


def streak_centre(window: Window, centre: Centre) -> Centre:
    """The centre of a swept disc where the window shows one; the centre that is known otherwise.

    A pixel shows I = B (1 - a) + sum_k c_k t_k + (1 - a) (d_0 + d_1 x + d_2 y), where a is the share of the exposure
    for which the disc covers it, t_k are :func:`sweep_terms`, c_k the disc's brightness and shading, and d a soft
    shadow on the background B. For each sweep of the disc c and d follow by linear least squares, each colour for
    itself; the sweep by non-linear ones (variable projection, Golub and Pereyra 1973, SIAM J. Numer. Anal. 10, 413).

    Parameters
    ----------
    window
        The pixels round the body.
    centre
        From the body's outline.
    """
    guess = _guess(window)
    if not guess.is_streak:
        return centre
    pixels = _pixels(window, guess)
    few = pixels.only((pixels.columns + pixels.rows) % THINNED == 0)
    if few.unexplained(guess) > HOPELESS:
        return centre
    sweep = few.swept(guess, ROUGH, FIRST)[0]
    if sweep.length < SOON * sweep.radius or sweep.radius > MAX_RADIUS_RATIO * guess.radius:
        return centre
    sweep = few.swept(sweep, ROUGH)[0]
    if not sweep.is_streak or sweep.radius > MAX_RADIUS_RATIO * guess.radius or few.unexplained(sweep) > DOUBTFUL:
        return centre
    kept = pixels.only(_plain(pixels.left_over(sweep.values)))
    sweep, left = kept.swept(sweep, PRECISE)
    if not sweep.is_streak or pixels.unexplained(sweep) > UNEXPLAINED:
        return centre
    errors = np.sqrt(np.diag(_covariance(kept, sweep, left)))
    return replace(
        centre,
        x=sweep.x,
        y=sweep.y,
        sigma_x=float(errors[0]),
        sigma_y=float(errors[1]),
        area=float(np.pi * sweep.radius**2),
        sigma_area=float(2 * np.pi * sweep.radius * errors[4]),
    )


def _guess(window: Window) -> Sweep:
    """The sweep with the moments of the difference from the background."""
    moments = moments_of_difference(window.planes, window.mask, window.other, FRINGE)
    x, y, across, down, shared = (float(value) for value in moments)
    (narrow, wide), axes = np.linalg.eigh([[across, shared], [shared, down]])
    way = np.sqrt(12.0 * max(wide - narrow, 0.0)) * axes[:, 1]
    return Sweep(x, y, float(way[0]), float(way[1]), float(2.0 * np.sqrt(max(narrow, 0.25))))


@dataclass(frozen=True, eq=False, slots=True)
class _Pixels:
    """The pixels that are compared: positions (n,), px, and values (n, channels) in units of the noise."""

    columns: Array
    rows: Array
    difference: Array
    background: Array

    def only(self, which: Flags) -> _Pixels:
        return _Pixels(self.columns[which], self.rows[which], self.difference[which], self.background[which])

    @property
    def _data(self) -> tuple[Array, Array, Array, Array]:
        return self.columns, self.rows, self.difference, self.background

    def left_over(self, sweep: Array) -> Array:
        """Residual of the best brightness and shadow (n, channels) of a sweep by its five numbers (5,)."""
        return swept_left_over(*self._data, sweep)

    def slopes(self, sweep: Array, left: Array) -> Array:
        """Derivatives (n * channels, 5) of the residual (n, channels) of a sweep by its five numbers (5,)."""
        return np.asarray(swept_slopes(*self._data, sweep, left))

    def swept(self, start: Sweep, enough: float, steps: int = STEPS) -> tuple[Sweep, Array]:
        """The sweep that leaves least over, and what it leaves (n, channels), by the method of Levenberg and Marquardt.

        It ends where a step lessens the sum of squares by less than the share ``enough``, or after some steps.
        """
        from scipy.optimize import least_squares  # takes half a second; few clips need it

        known: dict[bytes, Array] = {}  # residuals by sweep: slopes are computed where the residual is known

        def left_over(values: Array) -> Array:
            known[values.tobytes()] = self.left_over(values)
            return known[values.tobytes()].ravel()

        def slopes(values: Array) -> Array:
            return self.slopes(values, known[values.tobytes()])

        found = least_squares(left_over, start.values, slopes, method="lm", ftol=enough, max_nfev=steps + 1)
        return _sweep(found.x), np.asarray(found.fun.reshape(self.difference.shape))

    def unexplained(self, sweep: Sweep) -> float:
        """Residual share of the sum of squares of the difference."""
        return float((self.left_over(sweep.values) ** 2).sum() / (self.difference**2).sum())


def _pixels(window: Window, sweep: Sweep) -> _Pixels:
    """Those near a sweep on which there is nothing else."""
    rows, columns = np.indices(window.mask.shape, dtype=np.float64).reshape(2, -1)
    covered = (sweep_terms(columns, rows, sweep.values)[:, 0] > 0).reshape(window.mask.shape)
    use = dilated(covered, FRINGE) > dilated(window.other, 1)
    noise = window.noise[:, use].mean(axis=1, dtype=np.float64)
    image, background = (plane[:, use].T / noise for plane in (window.image, window.background))
    y, x = (places.astype(np.float64) for places in np.nonzero(use))
    return _Pixels(x, y, image - background, background)


def _plain(left_over: Array) -> Flags:
    """Pixels (n,) that are not outliers in any channel."""
    spread = MAD_TO_SD * np.median(np.abs(left_over), axis=0)
    return np.asarray((np.abs(left_over) < OUTLIER * spread).all(axis=1))


def _covariance(pixels: _Pixels, sweep: Sweep, left: Array) -> Array:
    """Of the five numbers of a sweep that was found, and leaves that (n, channels): (5, 5).

    The residual is correlated within the blocks of a coder: the covariance is the one that is robust to clusters (Liang
    and Zeger 1986, Biometrika 73, 13), H^-1 (sum over blocks of s s') H^-1 with H = J'J and s = J'r of a block.
    """
    jacobian, count = pixels.slopes(sweep.values, left), sweep.values.size
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    across, down = ((places // BLOCK).astype(np.int64) for places in (pixels.columns, pixels.rows))
    _, block = np.unique(across * (int(down.max()) + 1) + down, return_inverse=True)
    moved = (left.reshape(-1, 1) * jacobian).reshape(block.size, -1, count).sum(axis=1) @ inverse
    of_blocks = np.zeros((int(block.max()) + 1, count))
    np.add.at(of_blocks, block, moved)
    return of_blocks.T @ of_blocks


def _sweep(values: Array) -> Sweep:
    x, y, across, down, radius = (float(value) for value in values)
    return Sweep(x, y, across, down, max(abs(radius), 1.0))
