"""Operations on small images, as those of OpenCV, for kernels that must not wait for the interpreter (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from trackers._frames.arrays import Bytes, Image

# 1e-4 px, steps of a distance: to the next pixel, along a diagonal, like a knight's (G. Borgefors 1986, Comput. Vis.
# Graph. Image Process. 34, 344)
STRAIGHT, DIAGONAL, KNIGHT = np.int32(10000), np.int32(14000), np.int32(21969)
UNREACHED = 2**29  # distance of a pixel that no path has reached yet


@kernel(nogil=True)
def depth_within(mask: Bytes, outside: bool) -> Image:
    """Distance (h, w), px, of each pixel to the nearest that is 0, within 2 %; as by a mask of 5 x 5 in OpenCV.

    ``outside`` says that pixels outside of the mask are 0; if not, they do not count.
    """
    start = np.zeros(mask.shape, dtype=np.int32)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x]:
                start[y, x] = UNREACHED
    return chamfer(start, outside)


@kernel(nogil=True)
def chamfer(start: NDArray[np.int32], outside: bool) -> Image:
    """The least of each pixel's own distance and those of the others by way of them: (h, w), px, within 2 %.

    ``start`` (h, w), 1e-4 px, are their own distances; those outside are 0 or do not count.
    """
    height, width = start.shape
    steps = np.full((height + 4, width + 4), 0 if outside else UNREACHED, dtype=np.int32)
    by_rows, depth = np.empty(width, dtype=np.int32), np.empty((height, width), dtype=np.float32)
    for y in range(2, height + 2):
        _by_rows(by_rows, steps[y - 2], steps[y - 1], start[y - 2])
        here, least = steps[y, 2 : width + 2], steps[y, 1]
        for x in range(width):
            least = min(least + STRAIGHT, by_rows[x])
            here[x] = least
    for y in range(height + 1, 1, -1):
        _by_rows(by_rows, steps[y + 2], steps[y + 1], steps[y, 2 : width + 2])
        here, least = steps[y, 2 : width + 2], steps[y, width + 2]
        for x in range(width - 1, -1, -1):
            least = min(least + STRAIGHT, by_rows[x])
            here[x] = least
            depth[y - 2, x] = np.float32(1e-4) * np.float32(least)
    return depth


@kernel(nogil=True)
def _by_rows(least: np.ndarray, two: np.ndarray, one: np.ndarray, known: np.ndarray) -> None:
    """Set the least of the ``known`` distances (n,) and those by way of the next two rows (n + 4)."""
    width = least.size
    knights = two[1 : width + 1], two[3 : width + 3], one[:width], one[4 : width + 4]
    before, beside, after = one[1 : width + 1], one[2 : width + 2], one[3 : width + 3]
    for x in range(width):
        knight = min(min(knights[0][x], knights[1][x]), min(knights[2][x], knights[3][x])) + KNIGHT
        step = min(min(before[x], after[x]) + DIAGONAL, beside[x] + STRAIGHT)
        least[x] = min(known[x], min(knight, step))


@kernel(nogil=True)
def dilated(mask: Bytes, by: int) -> Bytes:
    """Dilation of a mask (h, w) by a square that reaches ``by`` px on every side; outside the mask is 0."""
    height, width = mask.shape
    wide = np.zeros((height, width), dtype=np.uint8)
    high = np.zeros((height, width), dtype=np.uint8)
    for y in range(height):
        for step in range(min(by, width - 1) + 1):
            _join(wide[y, step:], mask[y, : width - step])
            _join(wide[y, : width - step], mask[y, step:])
        for row in range(max(0, y - by), min(height, y + by + 1)):
            _join(high[row], wide[y])
    return high


@kernel(nogil=True)
def _join(into: Bytes, of: Bytes) -> None:
    """Set the pixels of one row (n,) that are set in another."""
    for x in range(into.size):
        into[x] |= of[x]


@kernel(nogil=True)
def opened(mask: Bytes) -> Bytes:
    """A mask (h, w) without parts thinner than 3 px; pixels outside of it do not count."""
    return dilated(1 - dilated(1 - mask, 1), 1)


@kernel(nogil=True)
def mirrored(place: int, size: int) -> int:
    """A place in a row of that size for one outside of it, which mirrors the row at its first and last pixel."""
    if size == 1:
        return 0
    while place < 0 or place >= size:
        place = -place if place < 0 else 2 * (size - 1) - place
    return place


@kernel(nogil=True)
def blurred(image: Image, sigma: float) -> Image:
    """Image (h, w, channels) after a blur of about that standard deviation, px; outside of it is 0.

    It is three sliding means each way, nearly a Gaussian (W. M. Wells, IEEE Trans. Pattern Anal. Mach. Intell. 8 (1986)
    234): their time does not grow with ``sigma``.
    """
    height, width, channels = image.shape
    reach = max(1, int(np.rint((math.sqrt(4 * sigma**2 + 1) - 1) / 2)))
    down = _slid(image.reshape((height, width * channels)), reach).reshape((height, width, channels))
    turned = np.ascontiguousarray(down.transpose((1, 0, 2))).reshape((width, height * channels))
    across = _slid(turned, reach).reshape((width, height, channels))
    return np.ascontiguousarray(across.transpose((1, 0, 2)))


@kernel(nogil=True)
def _slid(image: Image, reach: int) -> Image:
    """Image (h, n) after three means over ``reach`` rows on either side."""
    height, size = image.shape
    scale, none = np.float32(1 / (2 * reach + 1)), np.zeros(size, dtype=np.float32)
    for _ in range(3):
        soft, total = np.empty((height, size), dtype=np.float32), np.zeros(size, dtype=np.float32)
        for y in range(-reach, height):
            enter = image[y + reach] if y + reach < height else none
            leave = image[y - reach - 1] if y > reach else none
            mean = soft[max(y, 0)]
            for k in range(size):
                total[k] += enter[k] - leave[k]
                mean[k] = total[k] * scale
        image = soft
    return image


@kernel(nogil=True)
def quantile(values: Image, share: float) -> float:
    """The value (of n) that such a share of them is below, linear between two; 0 of none."""
    if not values.size:
        return 0.0
    place = share * (values.size - 1)
    below = min(int(place), values.size - 2) if values.size > 1 else 0
    ordered = np.partition(values, below)
    above = ordered[below + 1 :].min() if values.size > 1 else ordered[below]
    return ordered[below] + (place - below) * (above - ordered[below])
