"""Sub-pixel position of a checkerboard corner: a model of the blurred corner, fitted to the grey levels around it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.corner_equations import corner_equations
from iris_sysid.types import Array

# The next corner begins at 1 square, so this much of a square on each side belongs to one corner alone.
REACH_SQUARES = 0.42
MAX_REACH_PX = 24
STEPS = 25
WINDOW_ENDS = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 30, 0.1)  # steps, and px of a step
SETTLED_PX = 1e-4
SHARPEST_PX = 0.05  # blur of the lens: an edge as sharp as this changes no pixel but those that it crosses
PIXEL_VARIANCE = 1 / 12  # px^2, of a pixel's own width


@dataclass(frozen=True, eq=False, slots=True)
class Saddles:
    """Fitted corners: ``xy_px`` (n, 2), and (n,) each ``stderr_px`` of one coordinate, ``blur_px``, ``contrast``.

    ``blur_px`` is the standard deviation of the wider of a corner's two edges; ``contrast`` half the step between
    dark and light, positive where the square on the side of +a and +b is light. NaN: no corner was found there.
    """

    xy_px: Array
    stderr_px: Array
    blur_px: Array
    contrast: Array


def refine_by_window(grey: NDArray[np.uint8], xy_px: Array, half_px: int) -> Array:
    """Move corners (n, 2), px, to where the grey levels' gradients point away from, as OpenCV's classical method does.

    ``grey`` (h, w) is the image, ``half_px`` half the side of the window: one that holds a second corner pulls the
    result towards it.
    """
    start = np.ascontiguousarray(xy_px, dtype=np.float32).reshape(-1, 1, 2)
    return np.asarray(cv2.cornerSubPix(grey, start, (half_px, half_px), (-1, -1), WINDOW_ENDS), float).reshape(-1, 2)


def refine_by_model(grey: NDArray[np.uint8], xy_px: Array, squares_px: Array, clear: float = 0.5) -> Saddles:
    """Fit to the grey levels around each corner ``m + c E(d1/s1) E(d2/s2) + g (x - x0)``, by Levenberg-Marquardt.

    d1 and d2 are distances from the corner's two edges, E the error function: a step blurred by a Gaussian of
    standard deviation s. The edges' directions, blurs, the levels m and c, and a slope g of the light are fitted with
    the position. Unlike the classical window, the fit uses no pixel of another corner, and gives the standard error.

    Parameters
    ----------
    grey
        Image (h, w).
    xy_px
        Corners to start from (n, 2).
    squares_px
        The board's two sides of a square at each corner, in px (n, 2, 2): columns are the steps along a and b.
    clear
        Squares on each side of an edge that are free of markers; pixels beyond it are not used.

    Returns
    -------
    Saddles
        NaN where no corner was found within 0.3 squares of the start.
    """
    rows = [_refine_one(grey, start, sides, clear) for start, sides in zip(xy_px, squares_px, strict=True)]
    table = np.array(rows, dtype=np.float64).reshape(-1, 5)
    return Saddles(table[:, :2], table[:, 2], table[:, 3], table[:, 4])


NOTHING = (np.nan,) * 5


@dataclass(frozen=True, eq=False, slots=True)
class _Equations:
    """Sum of squares of the residual, and its normal equations: J'J (10, 10) and J'r (10,)."""

    squares: float
    normal: Array
    gradient: Array


def _refine_one(
    grey: NDArray[np.uint8], start: Array, sides: Array, clear: float
) -> tuple[float, float, float, float, float]:
    pixels, levels = _patch(grey, start, sides, clear)
    if len(levels) < 25:  # ten unknowns need more pixels
        return NOTHING
    params, covariance = _fit(pixels, levels, _guess(pixels, levels, sides))
    moved = np.linalg.solve(sides, params[:2])
    if not (np.all(np.isfinite(params)) and np.abs(moved).max() < 0.3 and np.all(np.isfinite(covariance))):
        return NOTHING
    stderr = float(np.sqrt(np.trace(covariance[:2, :2]) / 2))
    # E(d1) E(d2) is positive where a and b have opposite signs seen from the directions of the edges
    contrast = -params[7] * np.sign(np.sin(params[3] - params[2]))
    x, y = start + params[:2]
    return x, y, stderr, float(np.hypot(params[4:6].max(), PIXEL_VARIANCE**0.5)), float(contrast)


def _patch(grey: NDArray[np.uint8], start: Array, sides: Array, clear: float) -> tuple[Array, Array]:
    """Positions of the pixels near a corner (n, 2), relative to it, and their levels (n,)."""
    reach = int(min(np.ceil(REACH_SQUARES * np.abs(sides).sum(axis=1).max()), MAX_REACH_PX))
    column, row = np.round(start).astype(int)
    x = np.arange(max(column - reach, 0), min(column + reach + 1, grey.shape[1]))
    y = np.arange(max(row - reach, 0), min(row + reach + 1, grey.shape[0]))
    positions = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    squares = np.abs((positions - start) @ np.linalg.inv(sides).T)
    near = (squares.max(axis=1) < REACH_SQUARES) & (squares.min(axis=1) < clear)
    positions = positions[near]
    return positions - start, grey[positions[:, 1], positions[:, 0]].astype(np.float64)


def _guess(pixels: Array, levels: Array, sides: Array) -> Array:
    """x0, y0, two angles, two blurs, m, c, gx, gy to start from."""
    angle_1, angle_2 = np.arctan2(sides[1], sides[0])
    params = np.array([0, 0, angle_1, angle_2, 1, 1, levels.mean(), 0, 0, 0], dtype=np.float64)
    linear = _equations(pixels, levels, params)
    params[7] = linear.gradient[7] / max(float(linear.normal[7, 7]), 1e-12)
    return params


def _fit(pixels: Array, levels: Array, params: Array) -> tuple[Array, Array]:
    """Parameters of least squares, and their covariance (10, 10) from the residual scatter."""
    now, damping = _equations(pixels, levels, params), 1e-3
    for _ in range(STEPS):
        step = _step(params, now, damping)
        trial = params + step
        trial[4:6] = np.clip(trial[4:6], SHARPEST_PX, MAX_REACH_PX)
        then = _equations(pixels, levels, trial)
        if then.squares < now.squares:
            params, now, damping = trial, then, damping / 5
            if np.abs(step[:2]).max() < SETTLED_PX:
                break
        else:
            damping *= 10
    return params, _covariance(now, len(levels))


def _equations(pixels: Array, levels: Array, params: Array) -> _Equations:
    normal, gradient = np.empty((params.size, params.size)), np.empty(params.size)
    return _Equations(corner_equations(pixels, levels, params, normal, gradient), normal, gradient)


def _step(params: Array, now: _Equations, damping: float) -> Array:
    """A damped step; a blur below the sharpest goes to that value, and the others allow for it."""
    damped = now.normal + damping * np.diag(np.diag(now.normal) + 1e-9)
    step = np.linalg.solve(damped, now.gradient)
    held = np.zeros(params.size, dtype=np.bool_)
    held[4:6] = params[4:6] + step[4:6] < SHARPEST_PX
    if held.any():
        step[held] = SHARPEST_PX - params[held]
        left = now.gradient - damped[:, held] @ step[held]
        step[~held] = np.linalg.solve(damped[~held][:, ~held], left[~held])
    return np.asarray(step)


def _covariance(found: _Equations, count: int) -> Array:
    size = np.sqrt(np.diag(found.normal)) + 1e-12
    scaled = found.normal / np.outer(size, size)
    if not np.linalg.cond(scaled) < 1e12:  # a flat patch does not determine the corner
        return np.full(scaled.shape, np.nan)
    variance = found.squares / max(count - size.size, 1)
    return variance * np.linalg.inv(scaled) / np.outer(size, size)
