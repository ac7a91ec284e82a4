"""The outline of one body: signed distance of each pixel to it, and half its width (numba), from their coverage."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from trackers._detection.connected import filled_round
from trackers._detection.image_operations import as_bytes, rough_depth
from trackers._frames.arrays import Bytes, Flags, Image

FINER_SMALL, FINER_LARGE = 4, 2  # how much finer than the pixels the half-way contour is drawn
SMALL_WINDOW = 64  # px
CORD_SHARE = 0.2  # of the inscribed radius: a thinner part is a cord
MIN_STREAK_DEPTH = 5.0  # px, half the thickness of a body whose outline may be wide in some directions
MAX_HALF_WIDTH = 0.6  # of half the thickness of a body: half the width of the most blurred outline
FARTHER = 2.0  # px beyond the widest outline: coverage farther out does not count
TAIL = 0.03  # mean coverage, or fall of it, at which the outline has ended
STEPS_APART = 6  # quarters of a px over which the coverage falls, or no longer does
MIN_HALF_WIDTH = 0.75  # px, half the width of the sharpest outline: half a pixel's diagonal
QUARTER = 0.25  # px from one ring about the outline to the next
RING_QUARTERS = 3  # of a px, width of a ring
HALF = 0.5  # coverage on the outline
# largest half widths, and px, from the outline: the half width is computed only for nearer pixels
FAR_WIDTHS, FAR = 1.5, 4.0


def outline(share: Image, heart: Flags, axes: int) -> tuple[Image, Image]:
    """Distance (h, w) of each pixel to the outline, px, positive inside, and half the width (h, w) of the outline, px.

    The width is the distance outside of it at which the mean coverage falls no more. What it has fallen to is not the
    outline: a soft shadow, or nothing. A body that moves during the exposure has a wide outline before and behind and a
    sharp one on its sides: with several ``axes`` it is a number for each direction, opposite directions taken together.

    Parameters
    ----------
    share
        Coverage (h, w) of each pixel.
    heart
        Pixels (h, w) well inside of the body.
    axes
        Number of directions.
    """
    distance = _signed_distance(share, heart)
    return distance, _half_width(share, distance, axes)


def _signed_distance(share: Image, heart: Flags) -> Image:
    """Distance in px of each pixel's centre to the half-way contour round the heart, positive inside."""
    height, width = share.shape
    finer = FINER_SMALL if max(height, width) < SMALL_WINDOW else FINER_LARGE
    size = (width * finer, height * finer)
    fine = as_bytes(cv2.resize(np.maximum(share, heart), size, interpolation=cv2.INTER_LINEAR) > HALF)
    left, top, columns, rows = cv2.boundingRect(fine)
    part = slice(max(0, top - 1), top + rows + 1), slice(max(0, left - 1), left + columns + 1)
    seed = cv2.resize(as_bytes(heart), size, interpolation=cv2.INTER_NEAREST)[part]
    body, inside = _without_cords(filled_round(fine[part], seed))
    free = np.ones_like(fine)
    free[part] -= body
    signed = np.float32(0.5) - rough_depth(free, outside=False)
    np.copyto(signed[part], inside - np.float32(0.5), where=inside > 0)
    distance = cv2.resize(signed, (width, height), interpolation=cv2.INTER_AREA) / np.float32(finer)
    return np.asarray(distance, dtype=np.float32)


def _without_cords(mask: Bytes) -> tuple[Bytes, Image]:
    """The mask without parts thinner than a share of its thickness, its outline elsewhere as it was; its depth, px."""
    depth = rough_depth(mask, outside=False)
    cord = np.float32(CORD_SHARE * depth.max())
    away = rough_depth(depth < cord, outside=False)
    thin = (mask > 0) & (away >= cord + 1)
    if not thin.any():
        return mask, depth
    stout = np.where(thin, 0, mask)
    return stout, rough_depth(stout, outside=False)


@kernel(nogil=True)
def _half_width(share: Image, distance: Image, axes: int) -> Image:
    """Half the width (h, w) of the outline, px; see :func:`outline`."""
    height, width = share.shape
    thickness = distance.max()
    if axes == 1 or thickness < MIN_STREAK_DEPTH:
        away, beside, _ = _outside(share, distance, 1, (0.0, 0.0))
        alike = _reach(away, beside, max(1.0, MAX_HALF_WIDTH * thickness), True)
        return np.full((height, width), alike, dtype=np.float32)
    middle = _middle(distance)
    away, beside, axis = _outside(share, distance, axes, middle)
    reaches = np.empty(axes + 1)
    for k in range(axes):
        of_axis = axis % axes == k
        reaches[k] = _reach(away[of_axis], beside[of_axis], max(1.0, MAX_HALF_WIDTH * thickness), False)
    reaches[axes] = reaches[0]
    widest = reaches.max()
    half_width = np.full((height, width), widest, dtype=np.float32)
    for row in range(height):
        for column in range(width):
            if abs(distance[row, column]) < FAR_WIDTHS * widest + FAR:
                turn = _turn(row, column, middle, axes)
                first = min(int(turn), axes - 1)
                half_width[row, column] = reaches[first] + (turn - first) * (reaches[first + 1] - reaches[first])
    return half_width


@kernel(nogil=True)
def _middle(distance: Image) -> tuple[float, float]:
    """Mean column and row of the pixels inside of the outline."""
    count = across = down = 0
    for row in range(distance.shape[0]):
        for column in range(distance.shape[1]):
            if distance[row, column] > 0:
                count, across, down = count + 1, across + column, down + row
    return across / count, down / count


@kernel(nogil=True)
def _turn(row: int, column: int, middle: tuple[float, float], axes: int) -> float:
    """Direction in which a pixel is seen from a place, from 0 to ``axes`` over half a turn."""
    turn = math.atan2(row - middle[1], column - middle[0]) / math.pi * axes
    return turn - axes * math.floor(turn / axes)


@kernel(nogil=True)
def _outside(
    share: Image, distance: Image, axes: int, middle: tuple[float, float]
) -> tuple[Image, Image, NDArray[np.int64]]:
    """How far pixels (n,) just outside of an outline are off it, px, their coverage, and in which direction they are.

    With one of the ``axes`` it is 0; else that nearest to the direction from the ``middle``.
    """
    farthest = max(1.0, MAX_HALF_WIDTH * distance.max()) + FARTHER
    away = np.empty(share.size, dtype=np.float32)
    beside = np.empty(share.size, dtype=np.float32)
    axis, count = np.zeros(share.size, dtype=np.int64), 0
    for row in range(share.shape[0]):
        for column in range(share.shape[1]):
            if -farthest < distance[row, column] < -MIN_HALF_WIDTH:
                away[count], beside[count] = -distance[row, column], share[row, column]
                if axes > 1:
                    axis[count] = int(np.rint(_turn(row, column, middle, axes)))
                count += 1
    return away[:count], beside[:count], axis[:count]


@kernel(nogil=True)
def _reach(away: Image, beside: Image, widest: float, trimmed: bool) -> float:
    """The distance, px, outside of an outline at which the mean coverage falls no more.

    Parameters
    ----------
    away, beside
        Distance (n,) of pixels outside of the outline, px, and their coverage.
    widest
        Largest distance, px.
    trimmed
        Whether the mean is that without the largest and the smallest tenth; else it is the median.
    """
    levels, count = np.empty(int((widest + 1.0) / QUARTER) + 4), 0
    order, starts = _by_quarters(away, levels.size + RING_QUARTERS)
    ring = np.empty(away.size + 1, dtype=np.float32)
    half_width = MIN_HALF_WIDTH
    while half_width < widest + 1.0:
        size = 0
        for k in order[starts[count] : starts[count + RING_QUARTERS]]:
            ring[size] = beside[k]
            size += away[k] > half_width
        level = _level_of(np.sort(ring[:size]), trimmed)
        levels[count] = level
        if level < TAIL:
            return min(half_width, widest)
        if count >= STEPS_APART and levels[count - STEPS_APART] - level < TAIL:
            return half_width - STEPS_APART / 4
        count += 1
        half_width = MIN_HALF_WIDTH + QUARTER * count
    return widest


@kernel(nogil=True)
def _by_quarters(away: Image, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Numbers of the pixels by how many quarters of a px they are off, and where each quarter begins among them.

    ``away`` (n,), px, is above ``MIN_HALF_WIDTH``, where the first of ``count`` quarters begins.
    """
    quarter, starts = np.empty(away.size, dtype=np.int64), np.zeros(count + 1, dtype=np.int64)
    for k in range(away.size):
        quarter[k] = min(int((away[k] - MIN_HALF_WIDTH) / QUARTER), count - 1)
        starts[quarter[k] + 1] += 1
    for k in range(count):
        starts[k + 1] += starts[k]
    order, free = np.empty(away.size, dtype=np.int64), starts[:-1].copy()
    for k in range(away.size):
        order[free[quarter[k]]] = k
        free[quarter[k]] += 1
    return order, starts


@kernel(nogil=True)
def _level_of(ring: Image, trimmed: bool) -> float:
    """Mean without the largest and smallest tenth, or median, of values in order; 0 of none."""
    if not ring.size:
        return 0.0
    if trimmed:
        cut = ring.size // 10
        return ring[cut : ring.size - cut].mean()
    return (ring[(ring.size - 1) // 2] + ring[ring.size // 2]) / 2
