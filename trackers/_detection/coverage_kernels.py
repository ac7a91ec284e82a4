"""Loops over the pixels round a body: its own brightness, and how much of each pixel it covers (numba).

The windows are small: array operations of NumPy would mostly cost their calls.
"""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from trackers._frames.arrays import Bytes, Flags, Image

Planes = tuple[Image, Image, Image]  # image, background and noise (channels, h, w), grey levels

TELLING = 4.0  # contrast over noise: below it brightness leaves the coverage open
ONE_SIDED = (0.3, 0.7)  # |f| over s: below it a body is both brighter and darker, above it one of them
SHARE_RANGE = (-0.3, 1.3)  # coverage beyond this shows another object, not noise
MIN_WEIGHT = np.float32(1e-6)  # of a blur far from all that it is a mean of


@kernel(nogil=True)
def unexplained(image: Image, shade: Image, depth: Image) -> Image:
    """What the ``shade`` leaves of the image (channels, h, w), times a weight, and that: (h, w, channels + 1).

    The weight is 1 a px inside of the body, by its ``depth`` (h, w), px, and 0 outside.
    """
    channels, height, width = image.shape
    rest = np.zeros((height, width, channels + 1), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            weight = min(depth[y, x], np.float32(1))
            if weight > 0:
                for c in range(channels):
                    rest[y, x, c] = (image[c, y, x] - shade[c, y, x]) * weight
                rest[y, x, channels] = weight
    return rest


@kernel(nogil=True)
def own_brightness(planes: Planes, shade: Image, soft: Image, rest: Image, near: Flags) -> tuple[Image, Image]:
    """How far the body's own brightness, continued outwards, is off the background, and what it misses of that seen.

    In units of the noise, over the channels: sums of squares of the body's own (h, w, 3), of its products with what is
    seen, and of squares of that; and by how much (h, w) the root of the last exceeds that of the first, times the
    weight. ``soft`` (h, w, channels + 1) is the ``rest`` by :func:`unexplained`, blurred; its ratio to the weight is
    added to the shade. What is neither inside nor ``near`` (h, w) is left out: 0.
    """
    image, background, noise = planes
    channels, height, width = image.shape
    sums = np.zeros((height, width, 3), dtype=np.float32)
    missed = np.zeros((height, width), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            weight = rest[y, x, channels]
            if not near[y, x] and weight <= 0:
                continue
            squared = product = difference = np.float32(0)
            for c in range(channels):
                own = shade[c, y, x] + soft[y, x, c] / max(soft[y, x, channels], MIN_WEIGHT)
                contrast = (own - background[c, y, x]) / noise[c, y, x]
                off = (image[c, y, x] - background[c, y, x]) / noise[c, y, x]
                squared += contrast * contrast
                product += contrast * off
                difference += off * off
            sums[y, x, 0], sums[y, x, 1], sums[y, x, 2] = squared, product, difference
            missed[y, x] = (np.float32(math.sqrt(difference)) - np.float32(math.sqrt(squared))) * weight
    return sums, missed


@kernel(nogil=True)
def shares(sums: Image, missed: Image, soft: Image, mask: Bytes, near: Flags) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that a body covers, and its variance; by the mask where brightness leaves it open.

    ``sums`` are those of :func:`own_brightness`, ``missed`` (h, w) what it misses, blurred as ``soft`` is; see
    ``coverage_centre``.
    """
    height, width = mask.shape
    share = np.zeros((height, width), dtype=np.float32)
    variance = np.zeros((height, width), dtype=np.float32)
    low, high = ONE_SIDED
    for y in range(height):
        for x in range(width):
            if not near[y, x]:
                continue
            squared, product, difference = sums[y, x]
            strength = np.float32(math.sqrt(squared)) + missed[y, x] / max(soft[y, x, -1], MIN_WEIGHT)
            if strength <= TELLING:
                share[y, x], variance[y, x] = mask[y, x], 1.0 / 12.0
                continue
            squared = max(squared, np.float32(1e-6))
            mixed = min(max((math.sqrt(squared) / strength - low) / (high - low), 0.0), 1.0)
            signed = min(max(product / squared, SHARE_RANGE[0]), SHARE_RANGE[1])
            unsigned = min(max(math.sqrt(difference) / strength, SHARE_RANGE[0]), SHARE_RANGE[1])
            share[y, x] = mixed * signed + (1 - mixed) * unsigned
            variance[y, x] = (1 + (1 - mixed) ** 2) / strength**2
    return share, variance
