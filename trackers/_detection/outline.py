"""The outline of one body: signed distance of each pixel to it, and half its width (numba), from their coverage."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
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
RING_LISTS = 5  # of pixels in a ring: three quarters of a px wide, and two places between them
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
    known = np.maximum(share, heart.astype(np.float32))  # NumPy converts slowly while it compares
    fine = as_bytes(cv2.resize(known, size, interpolation=cv2.INTER_LINEAR) > HALF)
    left, top, columns, rows = cv2.boundingRect(fine)
    part = slice(max(0, top - 1), top + rows + 1), slice(max(0, left - 1), left + columns + 1)
    seed = cv2.resize(as_bytes(heart), size, interpolation=cv2.INTER_NEAREST)[part]
    body, inside = _without_cords(filled_round(fine[part], seed))
    free = np.ones_like(fine)
    free[part] -= body
    signed = rough_depth(free, outside=False)
    signed[part] -= inside  # of a pixel one of them is 0
    signed = (free - np.float32(0.5)) - signed
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


def _half_width(share: Image, distance: Image, axes: int) -> Image:
    """Half the width (h, w) of the outline, px; see :func:`outline`."""
    thickness = float(distance.max())
    widest = max(1.0, MAX_HALF_WIDTH * thickness)
    if axes == 1 or thickness < MIN_STREAK_DEPTH:
        (alike,) = _reaches(distance, share, np.zeros((1, 1)), widest)
        return np.full(share.shape, alike, dtype=np.float32)
    inside = cv2.moments(as_bytes(distance > 0), binaryImage=True)
    x = np.arange(share.shape[1]) - inside["m10"] / inside["m00"]
    y = np.arange(share.shape[0]) - inside["m01"] / inside["m00"]
    turn = np.arctan2(y[:, np.newaxis], x) * (axes / np.pi)  # direction from the middle, over half a turn
    turn += axes * (turn < 0)
    reaches = _reaches(distance, share, turn, widest, axes)
    half_width = np.interp(turn, np.arange(axes + 1), [*reaches, reaches[0]])
    half_width[np.abs(distance) >= FAR_WIDTHS * max(reaches) + FAR] = max(reaches)
    return half_width.astype(np.float32)


def _reaches(distance: Image, share: Image, turn: Array, widest: float, axes: int | None = None) -> list[float]:
    """The distance, px, outside of an outline at which the mean coverage falls no more, by the axis.

    Parameters
    ----------
    distance, share, turn
        Signed distance (h, w) of pixels to the outline, px, their coverage, and their direction, whose nearest whole
        number is that of their axis; (1, 1) for one axis.
    widest
        Largest distance, px.
    axes
        Number of axes, whose medians count; None for the mean of all without the largest and the smallest tenth.
    """
    half_widths = np.arange(MIN_HALF_WIDTH, widest + 1.0, QUARTER)
    farthest = np.float32(widest + FARTHER)
    ended = _ends(distance, share, turn, farthest, half_widths.size, axes or 1, axes is None).tolist()
    return [min(float(half_widths[number]), widest) if number < half_widths.size else widest for number in ended]


@kernel(nogil=True)
def _ends(
    distance: Image, share: Image, turn: Array, farthest: np.float32, rings: int, axes: int, trimmed: bool
) -> NDArray[np.int64]:
    """Number of the ring at which the outline has ended, by the axis; the number of ``rings`` where it has not.

    The pixels outside are sorted into places: quarters of a px, and the lines between them, where no ring ends.
    """
    height, width = distance.shape
    places, least = 2 * rings + RING_LISTS, np.float32(MIN_HALF_WIDTH)
    place = np.full((height, width), -1, dtype=np.int32)
    starts = np.zeros(axes * places + 1, dtype=np.int64)
    for y in range(height):
        for x in range(width):
            outside = -distance[y, x]
            if least < outside < farthest:
                quarters = (outside - least) / np.float32(QUARTER)
                place[y, x] = min(int(math.floor(quarters) + math.ceil(quarters)), places - 1)
                if axes > 1:
                    place[y, x] += places * (int(np.rint(turn[y, x])) % axes)
                starts[place[y, x] + 1] += 1
    for k in range(axes * places):
        starts[k + 1] += starts[k]
    beside, heads = np.empty(starts[-1], dtype=np.float32), starts.copy()
    for y in range(height):
        for x in range(width):
            if place[y, x] >= 0:
                beside[heads[place[y, x]]] = share[y, x]
                heads[place[y, x]] += 1
    ended = np.empty(axes, dtype=np.int64)
    for axis in range(axes):
        ended[axis] = _ended(beside, starts[axis * places : (axis + 1) * places], rings, trimmed)
    return ended


@kernel(nogil=True)
def _ended(beside: Image, starts: NDArray[np.int64], rings: int, trimmed: bool) -> int:
    """Number of the ring at which the outline has ended on one axis; see :func:`_ends`.

    ``starts`` are where the places begin in ``beside`` (n,); each is put in order when it is first needed.
    """
    heads, levels = starts.copy(), np.empty(rings)
    for part in range(1, RING_LISTS - 1):
        _put_in_order(beside, starts[part], starts[part + 1])
    for count in range(rings):
        for part in range(2 * count + RING_LISTS - 1, 2 * count + RING_LISTS + 1):
            _put_in_order(beside, starts[part], starts[part + 1])
        levels[count] = _level(beside, starts, heads, 2 * count + 1, trimmed)
        if levels[count] < TAIL:
            return count
        if count >= STEPS_APART and levels[count - STEPS_APART] - levels[count] < TAIL:
            return count - STEPS_APART
    return rings


@kernel(nogil=True)
def _put_in_order(beside: Image, start: int, stop: int) -> None:
    """Sort a part of ``beside`` (n,), by insertion: it holds a few pixels."""
    for k in range(start + 1, stop):
        value, place = beside[k], k
        while place > start and beside[place - 1] > value:
            beside[place] = beside[place - 1]
            place -= 1
        beside[place] = value


@kernel(nogil=True)
def _level(beside: Image, starts: NDArray[np.int64], heads: NDArray[np.int64], first: int, trimmed: bool) -> float:
    """Mean without the largest and smallest tenth, or median, of the lists of a ring, each in order; 0 of none."""
    size, level, stop = starts[first + RING_LISTS] - starts[first], 0.0, first + RING_LISTS
    cut = size // 10 if trimmed else max(0, size - 1) // 2
    for part in range(first, stop):
        heads[part] = starts[part]
    for k in range(size - cut):
        least, of = np.inf, first
        for part in range(first, stop):
            if heads[part] < starts[part + 1] and beside[heads[part]] < least:
                least, of = beside[heads[part]], part
        heads[of] += 1
        if k >= cut:
            level += least / (size - 2 * cut)
    return level
