"""A component cut into compact parts, at one level of contrast."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import cv2
import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._detection.connected import Labels, connected_parts, filled_round
from trackers._detection.depth import depth_of, exact_depth
from trackers._frames.arrays import Bytes, Image

MIN_INSCRIBED = 2.5  # px: a component with a smaller inscribed circle is not taken apart
BLOB_SHARE = 0.5  # of the inscribed radius: thinner parts are cords, arms of clamps, fingers
LEFT, TOP, RIGHT, BOTTOM, INSCRIBED, WHOLE, SEED, COLUMNS = 0, 1, 2, 3, 4, 5, 10, 12


def peak_of(mask: Bytes, level: Bytes) -> float:
    """Largest mean of 3 x 3 px of a difference (h, w), grey levels, within a mask, rounded."""
    return float(cv2.blur(level, (3, 3))[mask > 0].max(initial=0))


def cut_at(mask: Bytes, level: Bytes, faintest: float, smallest: int) -> tuple[Labels, Image, Array, float]:
    """Cut the pixels of a mask that differ enough where they form thin parts: opening by half the thickness.

    Parameters
    ----------
    mask, level
        The component and its difference (h, w), grey levels.
    faintest
        Least difference, grey levels.
    smallest
        Fewest pixels of a part.

    Returns
    -------
    owner : Labels
        Number of the part that a pixel (h, w) belongs to, from 1.
    depth : Image
        Distance (h, w), px, to the next pixel that is of no part of the component.
    table : Array
        Of each part (n, 12) left, top, right, bottom (exclusive), inscribed radius; of the whole that it was cut from
        left, top, right, bottom, inscribed radius; column and row of a pixel in its depth. All px.
    clearness : float
        How compact the parts are, times how sharp their outlines are by the gradient, grey levels a px.
    """
    bright = mask * (level >= faintest)
    solid = filled_round(bright, bright)
    wholes, boxes = connected_parts(solid, solid)
    depth = depth_of(solid)
    thickest = _worth_cutting(wholes, boxes, depth, smallest)
    deep = _deep(wholes, thickest, depth)
    seeds, seed_boxes = connected_parts(deep, deep)
    owner, table = _owned(wholes, boxes, thickest, depth, seeds, seed_boxes)
    return owner, depth, table, _clearness(owner, table, level)


@kernel(nogil=True)
def _worth_cutting(wholes: Labels, boxes: Labels, depth: Image, smallest: int) -> Image:
    """Inscribed radius (n + 1,), px, of each of the parts ``wholes`` (h, w), by its number; 0 of one too small."""
    thickest = np.zeros(len(boxes) + 1, dtype=np.float32)
    for y in range(wholes.shape[0]):
        for x in range(wholes.shape[1]):
            if wholes[y, x]:
                thickest[wholes[y, x]] = max(thickest[wholes[y, x]], depth[y, x])
    for k in range(len(boxes)):
        if boxes[k, 4] < smallest:
            thickest[k + 1] = 0
    return thickest


@kernel(nogil=True)
def _deep(wholes: Labels, thickest: Image, depth: Image) -> Bytes:
    """1 where the pixels (h, w) of a part are deep inside, by the inscribed radius (n + 1,) of each."""
    deep = np.zeros(wholes.shape, dtype=np.uint8)
    for y in range(wholes.shape[0]):
        for x in range(wholes.shape[1]):
            thick = thickest[wholes[y, x]]
            deep[y, x] = thick > 0 and depth[y, x] > (BLOB_SHARE * thick if thick >= MIN_INSCRIBED else 0.0)
    return deep


@kernel(nogil=True)
def _owned(
    wholes: Labels, boxes: Labels, thickest: Image, depth: Image, seeds: Labels, seed_boxes: Labels
) -> tuple[Labels, Array]:
    """The part that each pixel belongs to, and the table of parts: what is about several seeds is of the nearest."""
    owner, nearest = np.zeros(wholes.shape, dtype=np.int32), np.full(wholes.shape, np.inf, dtype=np.float32)
    table = np.zeros((len(seed_boxes), COLUMNS))
    for k in range(len(seed_boxes)):
        left, top, right, bottom = seed_boxes[k, 0], seed_boxes[k, 1], seed_boxes[k, 2], seed_boxes[k, 3]
        x = left
        while seeds[top, x] != k + 1:
            x += 1
        number, row = wholes[top, x], table[k]
        row[SEED], row[SEED + 1], row[WHOLE + 4] = x, top, thickest[number]
        for side in range(4):
            row[WHOLE + side] = boxes[number - 1, side]
        cut = BLOB_SHARE * thickest[number] if thickest[number] >= MIN_INSCRIBED else 0.0
        reach = int(cut) + 2
        top, left = max(0, top - reach), max(0, left - reach)
        bottom, right = min(wholes.shape[0], bottom + reach), min(wholes.shape[1], right + reach)
        free = np.ones((bottom - top, right - left), dtype=np.uint8)
        for y in range(top, bottom):
            for x in range(left, right):
                if seeds[y, x] == k + 1:
                    row[INSCRIBED], free[y - top, x - left] = max(row[INSCRIBED], depth[y, x]), 0
        away = exact_depth(free, False)
        for y in range(top, bottom):
            for x in range(left, right):
                off = away[y - top, x - left]
                if wholes[y, x] == number and off <= cut + 1.0 and off < nearest[y, x]:
                    owner[y, x], nearest[y, x] = k + 1, off
    _fill_boxes(owner, table)
    return owner, table


@kernel(nogil=True)
def _fill_boxes(owner: Labels, table: Array) -> None:
    """Set the boxes of the parts in their table."""
    for k in range(len(table)):
        table[k, LEFT], table[k, TOP] = owner.shape[1], owner.shape[0]
    for y in range(owner.shape[0]):
        for x in range(owner.shape[1]):
            if owner[y, x]:
                row = table[owner[y, x] - 1]
                row[LEFT], row[TOP] = min(row[LEFT], x), min(row[TOP], y)
                row[RIGHT], row[BOTTOM] = max(row[RIGHT], x + 1), max(row[BOTTOM], y + 1)


@kernel(nogil=True)
def _clearness(owner: Labels, table: Array, level: Bytes) -> float:
    """See :func:`cut_at`; 0 where there are no parts. Gradients are Sobel's, mirrored at the border."""
    height, width = owner.shape
    area = rim = 0
    steepness = thickness = 0.0
    for y in range(height):
        for x in range(width):
            if not owner[y, x]:
                continue
            area += 1
            if 0 < y < height - 1 and 0 < x < width - 1 and _alike(owner, y, x):
                continue
            rim += 1
            above, below = _mirrored(y - 1, height), _mirrored(y + 1, height)
            before, after = _mirrored(x - 1, width), _mirrored(x + 1, width)
            across = down = 0
            for row, weight in ((above, 1), (y, 2), (below, 1)):
                across += weight * (int(level[row, after]) - int(level[row, before]))
            for column, weight in ((before, 1), (x, 2), (after, 1)):
                down += weight * (int(level[below, column]) - int(level[above, column]))
            steepness += math.sqrt(float(across * across + down * down))
    for k in range(len(table)):
        thickness += table[k, INSCRIBED] ** 2
    return thickness / max(1, area) * (steepness / 8) / max(1, rim)


@kernel(nogil=True)
def _alike(owner: Labels, y: int, x: int) -> bool:
    """Whether the eight pixels about one inside the window are of the same part."""
    for row in range(y - 1, y + 2):
        for column in range(x - 1, x + 2):
            if owner[row, column] != owner[y, x]:
                return False
    return True


@kernel(nogil=True)
def _mirrored(place: int, size: int) -> int:
    """A place beside an image of that size, or in it, as the place in it that it shows: mirrored about the last."""
    place = abs(place)
    return place if place < size else max(2 * size - 2 - place, 0)
