"""The squares of a checkerboard: the extent of the board and its orientation."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.homography import apply_homography, fit_homography
from iris_sysid.types import Array, Mask

Grey = NDArray[np.uint8]

SIDES = ("start of its rows", "end of its rows", "start of its columns", "end of its columns")
IMAGE_SIDES = ("left edge", "right edge", "top edge", "bottom edge")
# Of an inner corner's contrast. A corner where the board ends has three light quarters: below zero.
CONTRAST_OF_CORNER = 0.3
FAINTEST_STEP = 3.0  # grey levels
MAJORITY = 0.6  # of the squares of a side
INNER = np.linspace(-0.2, 0.2, 5)  # the sampled part of a square, in squares from its centre
QUARTERS = np.array([[1, 1], [-1, -1], [1, -1], [-1, 1]]) * 0.27  # squares from a corner


def numbered(rows: int, columns: int, beyond: float = 0.0) -> Array:
    """Corners of a grid (rows * columns, 2) in squares; ``beyond`` 1 adds one more ring of them around it.

    In units of one square.
    """
    more = int(np.ceil(beyond))
    return np.mgrid[-more : columns + more, -more : rows + more].T.reshape(-1, 2).astype(np.float64)


def _homography(grid_px: Array) -> Array:
    rows, columns = grid_px.shape[:2]
    return fit_homography(numbered(rows, columns), grid_px.reshape(-1, 2))[0]


# --------------------------------------------------------------------------- where the board ends


def goes_on(grey: Grey, grid_px: Array) -> dict[str, bool]:
    """Whether there are more inner corners beyond a grid of them, by side of the board.

    ``grid_px`` (rows, columns, 2) are the corners in the ``grey`` image.
    """
    real = _real_corners(grey, grid_px)
    rings = (real[1:-1, 0], real[1:-1, -1], real[0, 1:-1], real[-1, 1:-1])
    return {side: bool(ring.mean() > MAJORITY) for side, ring in zip(SIDES, rings, strict=True)}


def _real_corners(grey: Grey, grid_px: Array) -> Mask:
    """True for corners of the grid and a ring around it (rows + 2, columns + 2) that alternate as inner corners do."""
    rows, columns = grid_px.shape[:2]
    positions = numbered(rows, columns, beyond=1)[:, None, None] + QUARTERS[:, None] + _spots(0.1)
    quarters = _levels(grey, apply_homography(_homography(grid_px), positions.reshape(-1, 2)).reshape(*positions.shape))
    sign = 1 - 2 * (np.indices((rows + 2, columns + 2)).sum(axis=0).ravel() % 2)
    first, second = sign[:, None] * quarters[:, :2], sign[:, None] * quarters[:, 2:]
    light = (first.min(axis=1) - second.max(axis=1)).reshape(rows + 2, columns + 2)
    dark = (second.min(axis=1) - first.max(axis=1)).reshape(rows + 2, columns + 2)
    step = max(light, dark, key=lambda steps: float(np.median(steps[1:-1, 1:-1])))
    typical = float(np.median(step[1:-1, 1:-1]))
    return np.asarray(step > max(CONTRAST_OF_CORNER * typical, FAINTEST_STEP))


def _spots(reach: float) -> Array:
    """A square of 5x5 positions (25, 2) that extends so far to each side."""
    return np.stack(np.meshgrid(INNER, INNER), axis=-1).reshape(-1, 2) * reach / INNER[-1]


def _levels(grey: Grey, places_px: Array) -> Array:
    """Mean grey level over the second-last axis of positions (..., k, 2); 0 outside the image."""
    x, y = np.moveaxis(places_px.astype(np.float32), -1, 0).reshape(2, -1, places_px.shape[-2])
    levels = cv2.remap(grey, np.ascontiguousarray(x), np.ascontiguousarray(y), cv2.INTER_LINEAR)
    return levels.mean(axis=1, dtype=np.float64).reshape(places_px.shape[:-2])


def is_board(grey: Grey, grid_px: Array) -> bool:
    """Whether nearly all corners of a grid ``grid_px`` (rows, columns, 2) in a ``grey`` image are inner corners."""
    return bool(_real_corners(grey, grid_px)[1:-1, 1:-1].mean() > 0.9)


def whole_grid(grey: Grey, grid_px: Array) -> Array:
    """The whole grid of inner corners (rows, columns, 2) that ``grid_px`` is a part of, in the image ``grey``.

    False lines of corners at the ends of the part are dropped.
    """
    for _ in range(60):
        real = _real_corners(grey, grid_px)
        false = [line.mean() < MAJORITY for line in (real[1:-1, 1], real[1:-1, -2], real[1, 1:-1], real[-2, 1:-1])]
        first_column, last_column, first_row, last_row = false
        more = [ring.mean() > MAJORITY for ring in (real[1:-1, 0], real[1:-1, -1], real[0, 1:-1], real[-1, 1:-1])]
        if any(false) and min(grid_px.shape[:2]) > 3:
            rows, columns = grid_px.shape[:2]
            grid_px = grid_px[int(first_row) : rows - int(last_row), int(first_column) : columns - int(last_column)]
        elif any(more):
            grid_px = _with_side(grid_px, more.index(True))
        else:
            break
    return grid_px


def _with_side(grid_px: Array, side: int) -> Array:
    """The grid with one more line of corners at that side, extrapolated by the homography."""
    rows, columns = grid_px.shape[:2]
    ring = apply_homography(_homography(grid_px), numbered(rows, columns, beyond=1)).reshape(rows + 2, columns + 2, 2)
    line = (ring[1:-1, :1], ring[1:-1, -1:], ring[:1, 1:-1], ring[-1:, 1:-1])[side]
    pair = (line, grid_px) if side % 2 == 0 else (grid_px, line)
    return np.concatenate(pair, axis=1 if side < 2 else 0)


def sides_outside(grid_px: Array, shape: tuple[int, ...]) -> list[str]:
    """Sides of the image of that ``shape`` (h, w) beyond which the board's next corners would be.

    ``grid_px`` (rows, columns, 2) are the corners that are seen.
    """
    rows, columns = grid_px.shape[:2]
    ring = apply_homography(_homography(grid_px), numbered(rows, columns, beyond=1))
    side_px = np.linalg.norm(np.diff(grid_px, axis=1), axis=2).mean() / 2  # a corner this near the edge is not found
    x, y = ring.T
    across = (x.min() < side_px, x.max() > shape[1] - side_px, y.min() < side_px, y.max() > shape[0] - side_px)
    return [side for side, light in zip(IMAGE_SIDES, across, strict=True) if light]


# --------------------------------------------------------------------------- which way round it is


def oriented_grid(grey: Grey, grid_px: Array) -> tuple[Array, bool]:
    """The corners (rows, columns, 2) in the board's own order, the same in every view, and whether that is certain.

    Corners are in px, ``grey`` (h, w) in grey levels.

    Seen from the front, the columns run clockwise of the rows, and the square outside the first corner is dark. Where
    the board looks the same turned, the turn is taken in which its rows run most to the right in the image.
    """
    if _handedness(grid_px) < 0:
        grid_px = grid_px[:, ::-1]
    rows, columns = grid_px.shape[:2]
    turns = (0, 1, 2, 3) if rows == columns else (0, 2)
    turned = [np.rot90(grid_px, turn) for turn in turns]
    dark = [grid for grid in turned if _first_square_contrast(grey, grid) < 0]
    choices = dark or turned
    rightward = [float(np.diff(grid[..., 0], axis=1).mean()) for grid in choices]
    return np.ascontiguousarray(choices[int(np.argmax(rightward))]), len(choices) == 1


def _handedness(grid_px: Array) -> float:
    along, down = np.diff(grid_px, axis=1)[:-1], np.diff(grid_px, axis=0)[:, :-1]
    return float(np.mean(along[..., 0] * down[..., 1] - along[..., 1] * down[..., 0]))


def _first_square_contrast(grey: Grey, grid_px: Array) -> float:
    """How much lighter the squares are that have the colour of the one between the first corners, grey levels."""
    rows, columns = grid_px.shape[:2]
    centres = numbered(rows - 1, columns - 1) + 0.5
    positions = apply_homography(_homography(grid_px), (centres[:, None] + _spots(0.2)).reshape(-1, 2))
    levels = _levels(grey, positions.reshape(len(centres), -1, 2))
    even = (centres - 0.5).sum(axis=1) % 2 == 0
    return float(levels[even].mean() - levels[~even].mean())
