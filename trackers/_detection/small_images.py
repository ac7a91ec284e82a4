"""Operations on small images, as those of OpenCV, for kernels that must not wait for the interpreter (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from trackers._frames.arrays import Bytes, Image

COARSE = 3.0  # px of the reduced image: the standard deviation of a blur that is made at a reduced size
BEYOND = 4.0  # standard deviations up to which a blur reaches
# 1e-4 px, steps of a distance: to the next pixel, along a diagonal, like a knight's (G. Borgefors 1986, Comput. Vis.
# Graph. Image Process. 34, 344)
STRAIGHT, DIAGONAL, KNIGHT = np.int32(10000), np.int32(14000), np.int32(21969)
UNREACHED = 2**29  # distance of a pixel that no path has reached yet


@kernel(nogil=True)
def chamfer(mask: Bytes, outside: bool) -> Image:
    """Distance (h, w), px, of each pixel to the nearest that is 0, within 2 %; as by a mask of 5 x 5 in OpenCV.

    ``outside`` says that pixels outside of the mask are 0; if not, they do not count.
    """
    height, width = mask.shape
    steps = np.full((height + 4, width + 4), 0 if outside else UNREACHED, dtype=np.int32)
    by_rows, depth = np.empty(width, dtype=np.int32), np.empty((height, width), dtype=np.float32)
    for y in range(2, height + 2):
        _by_rows(by_rows, steps[y - 2], steps[y - 1], mask[y - 2])
        here, least = steps[y, 2 : width + 2], steps[y, 1]
        for x in range(width):
            least = min(least + STRAIGHT, by_rows[x])
            here[x] = least
    for y in range(height + 1, 1, -1):
        _by_rows(by_rows, steps[y + 2], steps[y + 1], mask[y - 2])
        here, least = steps[y, 2 : width + 2], steps[y, width + 2]
        for x in range(width - 1, -1, -1):
            least = min(least + STRAIGHT, min(by_rows[x], here[x]))
            here[x] = least
            depth[y - 2, x] = np.float32(1e-4) * np.float32(least)
    return depth


@kernel(nogil=True)
def _by_rows(least: np.ndarray, two: np.ndarray, one: np.ndarray, mask: Bytes) -> None:
    """Set the least distances (n,) by way of the next two rows (n + 4), from two pixels before; off the mask 0."""
    width = least.size
    knights = two[1 : width + 1], two[3 : width + 3], one[:width], one[4 : width + 4]
    before, beside, after = one[1 : width + 1], one[2 : width + 2], one[3 : width + 3]
    for x in range(width):
        knight = min(min(knights[0][x], knights[1][x]), min(knights[2][x], knights[3][x])) + KNIGHT
        step = min(min(before[x], after[x]) + DIAGONAL, beside[x] + STRAIGHT)
        least[x] = min(knight, step) if mask[x] else 0


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
def _add(into: Image, weight: np.float32, of: Image) -> None:
    """Add a multiple of one row (n,) to another."""
    for x in range(into.size):
        into[x] += weight * of[x]


@kernel(nogil=True)
def _add_both(into: Image, weight: np.float32, of: Image, other: Image) -> None:
    """Add a multiple of two rows (n,) to another."""
    for x in range(into.size):
        into[x] += weight * (of[x] + other[x])


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
    """Image (h, w, channels) after a Gaussian blur of that standard deviation, px; a wide one at a reduced size."""
    height, width, _ = image.shape
    factor = max(1, int(sigma / COARSE))
    if factor == 1:
        return gaussian(image, sigma, sigma)
    rows, columns = -(-height // factor), -(-width // factor)
    small = shrunk(image, rows, columns)
    return stretched(gaussian(small, sigma * columns / width, sigma * rows / height), height, width)


@kernel(nogil=True)
def gaussian(image: Image, across: float, down: float) -> Image:
    """Image (h, w, channels) after a Gaussian blur of those standard deviations, px, its borders mirrored."""
    height, width, channels = image.shape
    weights = _bell(across)
    reach = weights.size // 2
    size = width * channels
    wide = np.zeros((height, size), dtype=np.float32)
    row = np.empty((width + 2 * reach) * channels, dtype=np.float32)
    for y in range(height):
        for x in range(-reach, width + reach):
            for c in range(channels):
                row[(x + reach) * channels + c] = image[y, mirrored(x, width), c]
        for k in range(reach):
            before, after = k * channels, (2 * reach - k) * channels
            _add_both(wide[y], weights[k], row[before : before + size], row[after : after + size])
        _add(wide[y], weights[reach], row[reach * channels : reach * channels + size])
    weights = _bell(down)
    reach = weights.size // 2
    soft = np.zeros((height, size), dtype=np.float32)
    for y in range(height):
        for k in range(reach):
            above, below = mirrored(y + k - reach, height), mirrored(y + reach - k, height)
            _add_both(soft[y], weights[k], wide[above], wide[below])
        _add(soft[y], weights[reach], wide[y])
    return soft.reshape((height, width, channels))


@kernel(nogil=True)
def _bell(sigma: float) -> Image:
    """Weights (n,) of a Gaussian blur of that standard deviation, px."""
    reach = int(np.rint(BEYOND * sigma * 2 + 1)) // 2
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return (weights / weights.sum()).astype(np.float32)


@kernel(nogil=True)
def shrunk(image: Image, rows: int, columns: int) -> Image:
    """A smaller image (rows, columns, channels), each pixel the mean of what it stands for."""
    height, width, channels = image.shape
    low = np.zeros((rows, width * channels), dtype=np.float32)
    flat = image.reshape((height, width * channels))
    for y in range(rows):
        first, stop = y * height / rows, (y + 1) * height / rows
        for row in range(int(first), min(height, math.ceil(stop - 1e-3))):
            weight = np.float32((min(stop, row + 1) - max(first, row)) * rows / height)
            _add(low[y], weight, flat[row])
    small = np.zeros((rows, columns, channels), dtype=np.float32)
    for x in range(columns):
        first, stop = x * width / columns, (x + 1) * width / columns
        for column in range(int(first), min(width, math.ceil(stop - 1e-3))):
            weight = np.float32((min(stop, column + 1) - max(first, column)) * columns / width)
            for y in range(rows):
                for c in range(channels):
                    small[y, x, c] += weight * low[y, column * channels + c]
    return small


@kernel(nogil=True)
def stretched(image: Image, rows: int, columns: int) -> Image:
    """A larger image (rows, columns, channels), between the pixels linear."""
    height, width, channels = image.shape
    wide = np.empty((height, columns * channels), dtype=np.float32)
    for x in range(columns):
        left, part = _between(x, columns, width)
        for y in range(height):
            for c in range(channels):
                first, second = image[y, left, c], image[y, min(left + 1, width - 1), c]
                wide[y, x * channels + c] = first + part * (second - first)
    large = np.zeros((rows, columns * channels), dtype=np.float32)
    for y in range(rows):
        upper, part = _between(y, rows, height)
        _add(large[y], np.float32(1) - part, wide[upper])
        _add(large[y], part, wide[min(upper + 1, height - 1)])
    return large.reshape((rows, columns, channels))


@kernel(nogil=True)
def _between(place: int, size: int, smaller: int) -> tuple[int, np.float32]:
    """The pixel of a smaller row left of the middle of one in a larger, and how far on it is to the next, 0 to 1."""
    at = min(max((place + 0.5) * smaller / size - 0.5, 0.0), smaller - 1.0)
    return int(at), np.float32(at - int(at))


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
