"""Connected parts of a mask that hold given pixels, and their holes (numba): only these are looked at."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from trackers._frames.arrays import Bytes

Labels = NDArray[np.int32]
EMPTY, UNSEEN, KEPT, OUTSIDE, SIDE = range(5)  # what is known of a pixel


def connected_parts(mask: Bytes, seeds: Bytes) -> tuple[Labels, Labels]:
    """Parts of a mask, connected by sides or corners, that hold pixels of ``seeds``, by flood fill.

    Parameters
    ----------
    mask, seeds
        Pixels (h, w); every seed is of the mask.

    Returns
    -------
    labels, boxes : Labels
        Number of each pixel's part (h, w), from 1, and of each part left, top, right, bottom (exclusive), number of
        seeds (k, 5).
    """
    return _flooded(np.ascontiguousarray(mask), np.flatnonzero(seeds))


@kernel(nogil=True)
def _flooded(mask: Bytes, seeds: NDArray[np.int64]) -> tuple[Labels, Labels]:
    height, width = mask.shape
    labels = np.zeros((height, width), dtype=np.int32)
    boxes = np.empty((seeds.size, 5), dtype=np.int32)
    stack = np.empty(mask.size, dtype=np.int32)
    count = 0
    for seed in seeds:
        y, x = seed // width, seed % width
        if labels[y, x]:
            boxes[labels[y, x] - 1, 4] += 1
            continue
        box = boxes[count]
        box[0], box[1], box[2], box[3], box[4] = x, y, x + 1, y + 1, 1
        count += 1
        labels[y, x] = count
        stack[0], waiting = seed, 1
        while waiting:
            waiting -= 1
            y, x = stack[waiting] // width, stack[waiting] % width
            box[0], box[1] = min(box[0], x), min(box[1], y)
            box[2], box[3] = max(box[2], x + 1), max(box[3], y + 1)
            for row in range(max(0, y - 1), min(height, y + 2)):
                for column in range(max(0, x - 1), min(width, x + 2)):
                    if mask[row, column] and not labels[row, column]:
                        labels[row, column] = count
                        stack[waiting] = row * width + column
                        waiting += 1
    return labels, boxes[:count]


def filled_round(mask: Bytes, seed: Bytes) -> Bytes:
    """The parts of ``mask`` (h, w), connected by sides, that overlap ``seed`` (h, w), their holes filled."""
    return np.asarray(_filled(np.ascontiguousarray(mask), np.ascontiguousarray(seed)))


@kernel(nogil=True)
def _filled(mask: Bytes, seed: Bytes) -> Bytes:
    height, width = mask.shape
    across = width + 4
    state = np.full((height + 4) * across, SIDE, dtype=np.uint8)  # two more px on every side, of which one is outside
    for y in range(height + 2):
        for x in range(width + 2):
            inside = 0 < y <= height and 0 < x <= width and mask[y - 1, x - 1]
            state[(y + 1) * across + x + 1] = UNSEEN if inside else EMPTY
    stack = np.empty(state.size, dtype=np.int32)
    for y in range(height):
        for x in range(width):
            if mask[y, x] and seed[y, x]:
                _flood(state, across, (y + 2) * across + x + 2, UNSEEN, KEPT, stack)
    _flood(state, across, across + 1, EMPTY, OUTSIDE, stack)
    filled = np.empty((height, width), dtype=np.uint8)
    for y in range(height):
        for x in range(width):
            filled[y, x] = state[(y + 2) * across + x + 2] != OUTSIDE
    return filled


@kernel(nogil=True)
def _flood(state: Bytes, across: int, start: int, least: int, mark: int, stack: Labels) -> None:
    """Mark what is connected by sides with a pixel of ``state``, of which a row has so many, and is ``least`` or so."""
    if state[start] > UNSEEN or state[start] < least:
        return
    state[start], stack[0], waiting = mark, start, 1
    while waiting:
        waiting -= 1
        place = stack[waiting]
        for step in (-1, 1, -across, across):
            if least <= state[place + step] <= UNSEEN:
                state[place + step] = mark
                stack[waiting] = place + step
                waiting += 1
