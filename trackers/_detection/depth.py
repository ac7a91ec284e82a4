"""Exact distance of pixels to the nearest that is 0 (numba): the same on every run and every machine.

``cv2.distanceTransform`` with the precise mask differs from run to run in the seventh digit.
"""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from trackers._detection.image_operations import as_bytes
from trackers._frames.arrays import Bytes, Flags, Image


def depth_of(mask: Bytes | Flags, *, outside: bool = True) -> Image:
    """Distance (h, w), px, of each pixel of a mask to the nearest that is 0; 0 there.

    Parameters
    ----------
    mask
        Pixels (h, w).
    outside
        Whether pixels outside of the mask are 0; if not, they do not count.
    """
    return np.asarray(exact_depth(as_bytes(mask), outside))


@kernel(nogil=True)
def exact_depth(mask: Bytes, outside: bool) -> Image:
    """As :func:`depth_of`, for kernels.

    By A. Meijster, J. Roerdink and W. Hesselink, in Mathematical Morphology (2000) 331, only where mask is not 0.
    """
    height, width = mask.shape
    down = _columns(mask, 0 if outside else height + width)
    depth = np.zeros((height, width), dtype=np.float32)
    sites, starts = np.empty(width + 2, dtype=np.int64), np.empty(width + 2, dtype=np.int64)
    squares = np.empty(width + 2, dtype=np.int64)
    for y in range(height):
        x = 0
        while x < width:
            if mask[y, x] == 0:
                x += 1
                continue
            first = x
            while x < width and mask[y, x]:
                x += 1
            _row(down[y], depth[y], first, x, outside, sites, squares, starts)
    return depth


@kernel(nogil=True)
def _columns(mask: Bytes, far: int) -> NDArray[np.int32]:
    """Distance (h, w) of each pixel to the nearest of its column that is 0; those outside are ``far``."""
    height, width = mask.shape
    down = np.empty((height, width), dtype=np.int32)
    for x in range(width):
        down[0, x] = 1 + far if mask[0, x] else 0
    for y in range(1, height):
        for x in range(width):
            down[y, x] = down[y - 1, x] + 1 if mask[y, x] else 0
    for x in range(width):
        down[height - 1, x] = min(down[height - 1, x], 1 + far)
    for y in range(height - 2, -1, -1):
        for x in range(width):
            down[y, x] = min(down[y, x], down[y + 1, x] + 1)
    return down


@kernel(nogil=True)
def _row(
    down: np.ndarray,
    depth: np.ndarray,
    first: int,
    stop: int,
    outside: bool,
    sites: np.ndarray,
    squares: np.ndarray,
    starts: np.ndarray,
) -> None:
    """The lower envelope of the parabolas over a run of pixels of one row, and the zeros at its ends."""
    width, last = down.size, -1
    for site in range(first - 1, stop + 1):
        beyond = site < 0 or site >= width
        if beyond and not outside:
            continue
        square = 0 if site < first or site >= stop else np.int64(down[site]) ** 2
        start = first
        while last >= 0:
            # right of this place the new parabola is below the last
            before = sites[last]
            start = math.floor((site**2 - before**2 + square - squares[last]) / (2 * (site - before))) + 1
            if start > starts[last]:
                break
            last -= 1
        if last < 0:
            start = first
        if start < stop:
            last += 1
            sites[last], squares[last], starts[last] = site, square, start
    for x in range(stop - 1, first - 1, -1):
        while starts[last] > x:
            last -= 1
        depth[x] = np.sqrt(np.float32((x - sites[last]) ** 2 + squares[last]))
