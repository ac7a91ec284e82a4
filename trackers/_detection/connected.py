"""Connected parts of a mask that hold given pixels, and their holes (numba); other parts are not labelled."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from trackers._detection.image_operations import as_bytes
from trackers._frames.arrays import Bytes, Flags

Labels = NDArray[np.int32]
ROW, FIRST, STOP = range(3)  # of a run of pixels in a row


def connected_parts(mask: Bytes | Flags, seeds: Bytes | Flags) -> tuple[Labels, Labels]:
    """Parts of a mask, connected by sides or corners, that hold pixels of ``seeds``.

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
    return parts_with(as_bytes(mask), as_bytes(seeds))


@kernel(nogil=True)
def parts_with(mask: Bytes, seeds: Bytes) -> tuple[Labels, Labels]:
    """As :func:`connected_parts`, for kernels."""
    runs, part = _joined(mask, 1)
    number, boxes = np.zeros(len(runs), dtype=np.int32), np.zeros((len(runs), 5), dtype=np.int32)
    count = 0
    for k in range(len(runs)):
        box, y, first, stop = boxes[part[k]], runs[k, ROW], runs[k, FIRST], runs[k, STOP]
        if part[k] == k:
            box[0], box[1] = first, y
        box[0], box[2], box[3] = min(box[0], first), max(box[2], stop), y + 1
        for x in range(first, stop):
            box[4] += seeds[y, x] != 0
        if box[4] and not number[part[k]]:
            count += 1
            number[part[k]] = count
    labels, chosen = np.zeros(mask.shape, dtype=np.int32), np.empty((count, 5), dtype=np.int32)
    for k in range(len(runs)):
        if number[part[k]]:
            for x in range(runs[k, FIRST], runs[k, STOP]):
                labels[runs[k, ROW], x] = number[part[k]]
            for x in range(5):
                chosen[number[part[k]] - 1, x] = boxes[part[k], x]
    return labels, chosen


@kernel(nogil=True)
def _joined(mask: Bytes, reach: int) -> tuple[Labels, Labels]:
    """Row, first column and end (n, 3) of the runs of a mask (h, w), and the first run (n,) of the part of each.

    Runs are connected whose columns overlap, or by a ``reach`` of 1 touch at a corner.
    """
    runs = np.empty((mask.shape[0] * ((mask.shape[1] + 1) // 2), 3), dtype=np.int32)
    part = np.empty(len(runs), dtype=np.int32)
    count = above = 0
    for y in range(mask.shape[0]):
        begin, x, line = count, 0, mask[y]
        while x < line.size:
            if not line[x]:
                x += 1
                continue
            first = x
            while x < line.size and line[x]:
                x += 1
            runs[count, ROW], runs[count, FIRST], runs[count, STOP], part[count] = y, first, x, count
            while above < begin and runs[above, STOP] + reach <= first:
                above += 1
            other = above
            while other < begin and runs[other, FIRST] < x + reach:
                _join(part, other, count)
                other += 1
            count += 1
        above = begin
    for k in range(count):
        part[k] = part[part[k]]
    return runs[:count], part[:count]


@kernel(nogil=True)
def _join(part: Labels, run: int, other: int) -> None:
    """Note that two runs are of one part, which is named by its first."""
    while part[run] != run:
        run = part[run]
    while part[other] != other:
        other = part[other]
    part[max(run, other)] = min(run, other)


def filled_round(mask: Bytes | Flags, seed: Bytes | Flags) -> Bytes:
    """The parts of ``mask`` (h, w), connected by sides, that overlap ``seed`` (h, w), their holes filled."""
    return np.asarray(filled_about(as_bytes(mask), as_bytes(seed)))


@kernel(nogil=True)
def filled_about(mask: Bytes, seed: Bytes) -> Bytes:
    """As :func:`filled_round`, for kernels."""
    height, width = mask.shape
    runs, part = _joined(mask, 0)
    kept = np.zeros(len(runs), dtype=np.bool_)
    for k in range(len(runs)):
        for x in range(runs[k, FIRST], runs[k, STOP]):
            kept[part[k]] |= seed[runs[k, ROW], x] != 0
    free = np.ones((height + 2, width + 2), dtype=np.uint8)  # another px on every side, all connected
    for k in range(len(runs)):
        if kept[part[k]]:
            for x in range(runs[k, FIRST], runs[k, STOP]):
                free[runs[k, ROW] + 1, x + 1] = 0
    filled = np.ones((height, width), dtype=np.uint8)
    runs, part = _joined(free, 0)
    for k in range(len(runs)):
        if not part[k] and 0 < runs[k, ROW] <= height:
            for x in range(max(0, runs[k, FIRST] - 1), min(width, runs[k, STOP] - 1)):
                filled[runs[k, ROW] - 1, x] = 0
    return filled
