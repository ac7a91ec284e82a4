"""The window of one body made ready: the background's level about it, its mask to the pixel, its shadow off (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._detection.connected import filled_about
from trackers._detection.coverage_kernels import Planes
from trackers._detection.foreground import CONTRAST_SHARES, WEAK_SIGMAS
from trackers._detection.small_images import chamfer, dilated, mirrored, opened, quantile
from trackers._frames.arrays import Bytes, Image

RING = 4  # px from the body to the ring in which the background's level is compared
MIN_SHADE = 0.6  # of the light remains in a shadow
GREY = 128.0  # level of a colour plane where the image is grey
COLOUR_SIGMAS, COLOUR_FLOOR = 3.0, 3.0  # floor in grey levels: largest change of colour in a shadow
CORE_DEPTH = 0.5  # of the inscribed radius: deeper pixels are of the body
ROUNDER = 1.15  # times: least gain in roundness when a possible shadow is removed
STEEP = 0.9  # of the pixels of an outline are less steep


@kernel(nogil=True)
def paste(into: Bytes, left: int, top: int, mask: Bytes, x0: int, y0: int, finer: int) -> None:
    """Set the pixels of a window (h, w) at (left, top) that a mask covers.

    The mask is at (x0, y0), in pixels ``finer`` times larger than those of the window.
    """
    for y in range(max(0, y0 * finer - top), min(into.shape[0], (y0 + mask.shape[0]) * finer - top)):
        for x in range(max(0, x0 * finer - left), min(into.shape[1], (x0 + mask.shape[1]) * finer - left)):
            into[y, x] |= mask[(y + top) // finer - y0, (x + left) // finer - x0]


@kernel(nogil=True)
def made_ready(planes: Planes, mask: Bytes, other: Bytes, finer: int) -> tuple[Image, Bytes, Bytes]:
    """The background (h, w, channels) at its level about a body, the body's mask, and that of other objects (h, w).

    Parameters
    ----------
    planes
        Frame, background and noise (h, w, channels), grey levels.
    mask, other
        1 where the body was found (h, w), and where other objects are.
    finer
        How much larger the pixels were in which they were found.
    """
    image, background, noise = planes
    level = _at_level(image, background, mask, other)
    if finer > 1:
        mask = _sharpened(mask, _largest_difference(image, level), noise, finer)
    shaded = _shaded(image, level, noise, mask | other)
    mask = _without(mask, shaded)
    left_over = np.zeros(mask.shape, dtype=np.uint8)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            left_over[y, x] = other[y, x] and not shaded[y, x] and not mask[y, x]
    return level, mask, left_over


@kernel(nogil=True)
def _at_level(image: Image, background: Image, mask: Bytes, other: Bytes) -> Image:
    """The background as bright as it is now round a body: flicker, soft shade."""
    height, width, channels = image.shape
    near, ring = dilated(mask | other, RING), np.empty(mask.size, dtype=np.float32)
    level = background.copy()
    for c in range(channels):
        count = 0
        for y in range(height):
            for x in range(width):
                if not near[y, x]:
                    ring[count] = image[y, x, c] - background[y, x, c]
                    count += 1
        level[..., c] += np.float32(quantile(ring[:count], 0.5))
    return level


@kernel(nogil=True)
def _largest_difference(image: Image, background: Image) -> Image:
    """Largest difference (h, w) of the channels of two images."""
    height, width, channels = image.shape
    most = np.zeros((height, width), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            for c in range(channels):
                most[y, x] = max(most[y, x], abs(image[y, x, c] - background[y, x, c]))
    return most


@kernel(nogil=True)
def _of_mask(image: Image, mask: Bytes) -> Image:
    """The pixels (n,) of an image (h, w) that are in a mask."""
    found, count = np.empty(mask.size, dtype=np.float32), 0
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x]:
                found[count] = image[y, x]
                count += 1
    return found[:count]


@kernel(nogil=True)
def _sharpened(mask: Bytes, level: Image, noise: Image, step: int) -> Bytes:
    """A mask found at reduced size, made right to the pixel by the difference (h, w) from the background."""
    near = dilated(mask, step)
    faint = CONTRAST_SHARES[0] * quantile(_of_mask(level, mask), 0.9)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if near[y, x]:
                noisy = noise[y, x, 0]
                for c in range(1, noise.shape[2]):
                    noisy = max(noisy, noise[y, x, c])
                near[y, x] = level[y, x] > max(faint, WEAK_SIGMAS * noisy)
    return filled_about(near, mask)


@kernel(nogil=True)
def _shaded(image: Image, background: Image, noise: Image, among: Bytes) -> Bytes:
    """1 where an image (h, w, channels) shows the background with less light: all its colours scaled by one factor.

    Only pixels ``among`` (h, w) are looked at; the others are 0. Without colour a shadow cannot be distinguished from a
    dark body: 0.
    """
    height, width, channels = image.shape
    shaded = np.zeros((height, width), dtype=np.uint8)
    if channels < 3:
        return shaded
    for y in range(height):
        for x in range(width):
            if not among[y, x]:
                continue
            light = _mean_about(image, y, x, 0) / max(background[y, x, 0], np.float32(1))
            dark = MIN_SHADE < light < 1
            for c in range(1, channels):
                if dark:
                    off = _mean_about(image, y, x, c) - (GREY + (background[y, x, c] - GREY) * light)
                    dark = abs(off) <= max(COLOUR_SIGMAS * noise[y, x, c], COLOUR_FLOOR)
            shaded[y, x] = dark
    return shaded


@kernel(nogil=True)
def _mean_about(image: Image, y: int, x: int, channel: int) -> np.float32:
    """Mean over 3 x 3 px of a channel of an image, its borders mirrored."""
    total, inside = np.float32(0), 0 < y < image.shape[0] - 1 and 0 < x < image.shape[1] - 1
    for row in range(y - 1, y + 2):
        for column in range(x - 1, x + 2):
            if inside:
                total += image[row, column, channel]
            else:
                total += image[mirrored(row, image.shape[0]), mirrored(column, image.shape[1]), channel]
    return total / np.float32(9)


@kernel(nogil=True)
def _without(mask: Bytes, shaded: Bytes) -> Bytes:
    """A mask without the shadow that hangs on the body; as it is where that makes it no rounder: a grey body."""
    body = opened(mask & (1 - shaded))
    depth = chamfer(body, True)
    body = filled_about(body, (depth > CORE_DEPTH * depth.max()).astype(np.uint8))
    return body if _roundness(body) > ROUNDER * _roundness(mask) else mask


@kernel(nogil=True)
def _roundness(mask: Bytes) -> float:
    """Share of a mask that its largest inscribed disc covers; 0 when it is empty."""
    return math.pi * chamfer(mask, True).max() ** 2 / max(1, mask.sum())


@kernel(nogil=True)
def looks_of(planes: Planes, mask: Bytes) -> tuple[float, float]:
    """Mean difference in luma within a mask (h, w), grey levels, and steepness of its outline, grey levels a px.

    That is the 90th percentile of the gradient (Sobel) of the difference.
    """
    image, background, _ = planes
    level, near = _largest_difference(image, background), dilated(mask, 1)
    height, width = mask.shape
    slopes, count = np.empty(mask.size, dtype=np.float32), 0
    brightening = 0.0
    for y in range(height):
        above, below = mirrored(y - 1, height), mirrored(y + 1, height)
        for x in range(width):
            if not near[y, x]:
                continue
            left, right = mirrored(x - 1, width), mirrored(x + 1, width)
            across = level[above, right] - level[above, left] + level[below, right] - level[below, left]
            across += 2 * (level[y, right] - level[y, left])
            down = level[below, left] - level[above, left] + level[below, right] - level[above, right]
            down += 2 * (level[below, x] - level[above, x])
            slopes[count] = math.hypot(across, down) / 8
            count += 1
            if mask[y, x]:
                brightening += image[y, x, 0] - background[y, x, 0]
    return brightening / max(1, mask.sum()), quantile(slopes[:count], STEEP)


@kernel(nogil=True)
def moments_of_difference(planes: Planes, mask: Bytes, other: Bytes, reach: int) -> Array:
    """Mean column and row of a body, px, their variances and covariance, px^2: (5,).

    Pixels within ``reach`` px of the mask (h, w), where nothing ``other`` is, weigh as their largest difference from
    the background in units of the noise, at most the median of it within the mask.
    """
    image, background, noise = planes
    level = np.zeros(mask.shape, dtype=np.float32)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            for k in range(image.shape[2]):
                off = image[y, x, k] / noise[y, x, k] - background[y, x, k] / noise[y, x, k]
                level[y, x] = max(level[y, x], abs(off))
    usual = max(quantile(_of_mask(level, mask), 0.5), 1e-6)
    near = dilated(mask, reach)
    weights = np.zeros(mask.shape)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if near[y, x] and not other[y, x]:
                weights[y, x] = min(level[y, x] / usual, 1.0)
    return _moments_of(weights)


@kernel(nogil=True)
def _moments_of(weights: Array) -> Array:
    """Mean column and row, variances and covariance (5,) of the pixels of a window with ``weights`` (h, w)."""
    total = squares = middle = height = 0.0
    for row in range(weights.shape[0]):
        for column in range(weights.shape[1]):
            weight = weights[row, column]
            total, squares = total + weight, squares + weight * weight
            middle, height = middle + weight * column, height + weight * row
    middle, height = middle / total, height / total
    across = down = shared = 0.0
    for row in range(weights.shape[0]):
        for column in range(weights.shape[1]):
            weight = weights[row, column]
            across += weight * (column - middle) ** 2
            down += weight * (row - height) ** 2
            shared += weight * (column - middle) * (row - height)
    free = total - squares / total  # weighted, unbiased
    return np.array([middle, height, across / free, down / free, shared / free])
