"""The outline of one body: signed distance of each pixel to it, and half its width, from the coverage of pixels."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from trackers._detection.masks import as_bytes, depth_of, filled
from trackers._detection.strong_windows import grown
from trackers._frames.arrays import Bytes, Flags, Image

FINER_SMALL, FINER_LARGE = 4, 2  # how much finer than the pixels the half-way contour is drawn
SMALL_WINDOW = 64  # px
CORD_SHARE = 0.2  # of the inscribed radius: a thinner part is a cord
SMALLEST_STREAK = 5.0  # px, half the thickness of a body whose outline may be wide in some directions
WIDEST = 0.6  # of half the thickness of a body: half the width of the most blurred outline
FARTHER = 2.0  # px beyond the widest outline up to which its coverage is looked at
TAIL = 0.03  # mean coverage, or fall of it, at which the outline has ended
STEPS_APART = 6  # quarters of a px over which the coverage falls, or no longer does
NARROWEST = 0.75  # px, half the width of the sharpest outline: half a pixel's diagonal
QUARTER = 0.25  # px from one ring about the outline to the next
RING_QUARTERS = 3  # of a px, width of a ring
LOWEST, FINEST, LEVELS = -0.3025, 0.005, 322  # of coverage: the least, step and number of steps of its histogram
HALF = np.float32(0.5)  # coverage on the outline
# widest half widths and px off the outline, beyond which half its width is not asked for
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
    return distance, half_width_of(share, distance, axes)


def _signed_distance(share: Image, heart: Flags) -> Image:
    """Distance in px of each pixel's centre to the half-way contour round the heart, positive inside."""
    height, width = share.shape
    finer = FINER_SMALL if max(height, width) < SMALL_WINDOW else FINER_LARGE
    size = (width * finer, height * finer)
    fine = cv2.resize(np.maximum(share, heart), size, interpolation=cv2.INTER_LINEAR)
    left, top, columns, rows = cv2.boundingRect(as_bytes(fine > HALF))
    part = grown((left, top, left + columns, top + rows), 1, size)
    window = slice(part[1], part[3]), slice(part[0], part[2])
    seed = cv2.resize(as_bytes(heart), size, interpolation=cv2.INTER_NEAREST)[window]
    body, inside = _without_cords(filled(fine[window] > HALF, seed))
    free = np.ones(size[::-1], dtype=np.uint8)
    free[window] -= body
    signed = np.float32(0.5) - depth_of(free, outside=False)
    np.copyto(signed[window], inside - np.float32(0.5), where=body.view(np.bool_))
    mean = cv2.resize(signed, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(mean * np.float32(1 / finer), dtype=np.float32)


def _without_cords(mask: Bytes) -> tuple[Bytes, Image]:
    """The mask without parts thinner than a share of its thickness, its outline elsewhere as it was; its depth, px."""
    depth = depth_of(mask, outside=False)
    cord = CORD_SHARE * float(depth.max())
    away = depth_of(depth < cord, outside=False)
    stout = as_bytes((mask > 0) & (away < cord + 1))
    if np.array_equal(stout, mask):
        return mask, depth
    return stout, depth_of(stout, outside=False)


@kernel(nogil=True)
def half_width_of(share: Image, distance: Image, axes: int) -> Image:
    """Half the width (h, w) of the outline, px; see :func:`outline` (numba: a third of the time of NumPy's arrays)."""
    height, width = share.shape
    thickness = distance.max()
    widest = max(1.0, WIDEST * thickness)
    if thickness < SMALLEST_STREAK:
        axes = 1
    x, y = _middle(distance)
    rings = int((widest + 1.0 - NARROWEST) / QUARTER) + 1
    count = np.zeros((axes, rings + RING_QUARTERS, LEVELS), dtype=np.int32)
    for row in range(height):
        for column in range(width):
            away = -distance[row, column]
            if NARROWEST < away < widest + FARTHER:
                axis = 0 if axes == 1 else int(np.rint(_turn(column - x, row - y, axes))) % axes
                quarter = min(int((away - NARROWEST) / QUARTER), rings + RING_QUARTERS - 1)
                level = int((share[row, column] - LOWEST) / FINEST)
                count[axis, quarter, min(max(level, 0), LEVELS - 1)] += 1
    reaches = np.empty(axes)
    for axis in range(axes):
        reaches[axis] = _reach(count[axis], rings, widest, axes == 1)
    half_width = np.full((height, width), reaches.max(), dtype=np.float32)
    if axes == 1:
        return half_width
    farthest = FAR_WIDTHS * reaches.max() + FAR
    for row in range(height):
        for column in range(width):
            if abs(distance[row, column]) < farthest:
                turn = _turn(column - x, row - y, axes)
                first = int(turn) % axes
                step = reaches[(first + 1) % axes] - reaches[first]
                half_width[row, column] = reaches[first] + (turn - math.floor(turn)) * step
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
def _turn(x: float, y: float, axes: int) -> float:
    """A direction as a number from 0 to ``axes`` over half a turn."""
    turn = math.atan2(y, x) / math.pi * axes
    return turn - axes * math.floor(turn / axes)


@kernel(nogil=True)
def _reach(count: NDArray[np.int32], rings: int, widest: float, trimmed: bool) -> float:
    """The distance, px, outside of an outline at which the mean coverage of rings of pixels falls no more.

    Parameters
    ----------
    count
        Number (quarters, levels) of pixels by quarters of a px off the outline, and by their coverage.
    rings, widest
        Number of rings, and largest distance, px.
    trimmed
        Whether the mean is that without the largest and the smallest tenth; else it is the median.
    """
    means = np.zeros(rings)
    for ring in range(rings):
        total = count[ring : ring + RING_QUARTERS].sum()
        cut = total // 10 if trimmed else (total - 1) // 2
        below = 0
        for level in range(LEVELS):
            here = count[ring, level] + count[ring + 1, level] + count[ring + 2, level]
            kept = min(below + here, total - cut) - max(below, cut)
            if kept > 0:
                means[ring] += kept * (LOWEST + FINEST * (level + 0.5)) / (total - 2 * cut)
            below += here
        if means[ring] < TAIL:
            return min(NARROWEST + QUARTER * ring, widest)
        if ring >= STEPS_APART and means[ring - STEPS_APART] - means[ring] < TAIL:
            return NARROWEST + QUARTER * (ring - STEPS_APART)
    return widest
