"""Loops over the pixels round a body, for their coverage (numba: a third of the time of NumPy's whole arrays)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from trackers._frames.arrays import Bytes, Image

TELLING = 4.0  # contrast over noise from which brightness tells coverage
ONE_SIDED = (0.3, 0.7)  # |f| over s: below it a body is both brighter and darker, above it one of them
SHARE_RANGE = (-0.3, 1.3)  # coverage beyond this is another thing, not noise

Planes = tuple[Image, Image, Image]  # image, background and noise (h, w, channels), grey levels


@kernel(nogil=True)
def beyond_shade(image: Image, shade: Image, depth: Image) -> Image:
    """What a body's shading leaves of an image, and the weight, 0 to 1, of each pixel (h, w, channels + 1).

    ``depth`` (h, w), px, is above 0 where a pixel is of the body alone.
    """
    height, width, channels = image.shape
    left = np.empty((height, width, channels + 1), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            weight = np.float32(min(max(depth[y, x], 0.0), 1.0))
            left[y, x, channels] = weight
            for c in range(channels):
                left[y, x, c] = (image[y, x, c] - shade[y, x, c]) * weight
    return left


@kernel(nogil=True)
def own_brightness(planes: Planes, shade: Image, soft: Image, depth: Image, near: Bytes) -> tuple[Image, Image, Image]:
    """The body's own brightness, continued outwards, its strength (h, w), and what it misses of the strength seen.

    The strength is how far the channels are off the background, in units of the noise. ``soft`` is
    :func:`beyond_shade`, blurred; its mean is added to the ``shade``. What is neither inside nor ``near`` (h, w)
    is left out: 0.
    """
    image, background, noise = planes
    height, width, channels = image.shape
    own = np.zeros((height, width, channels), dtype=np.float32)
    strength = np.zeros((height, width), dtype=np.float32)
    missed = np.zeros((height, width), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            if not near[y, x] and depth[y, x] <= 0:
                continue
            weight = max(soft[y, x, channels], np.float32(1e-6))
            of_own = of_seen = np.float32(0)
            for c in range(channels):
                own[y, x, c] = shade[y, x, c] + soft[y, x, c] / weight
                off = (own[y, x, c] - background[y, x, c]) / noise[y, x, c]
                seen = (image[y, x, c] - background[y, x, c]) / noise[y, x, c]
                of_own += off * off
                of_seen += seen * seen
            strength[y, x] = math.sqrt(of_own)
            if depth[y, x] > 0:
                missed[y, x] = (np.float32(math.sqrt(of_seen)) - strength[y, x]) * np.float32(min(depth[y, x], 1.0))
    return own, strength, missed


@kernel(nogil=True)
def shares(planes: Planes, own: Image, strength: Image, mask: Bytes, near: Bytes) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that a body covers, and its variance; by the mask where brightness does not tell.

    ``own`` is the body's own brightness, ``strength`` (h, w) how far it is off the background; see
    ``coverage_centre``.
    """
    image, background, noise = planes
    height, width, channels = image.shape
    share = np.zeros((height, width), dtype=np.float32)
    variance = np.zeros((height, width), dtype=np.float32)
    low, high = ONE_SIDED
    for y in range(height):
        for x in range(width):
            if not near[y, x]:
                continue
            if strength[y, x] <= TELLING:
                share[y, x], variance[y, x] = mask[y, x], 1.0 / 12.0
                continue
            squared = product = difference = np.float32(0)
            for c in range(channels):
                contrast = (own[y, x, c] - background[y, x, c]) / noise[y, x, c]
                off = (image[y, x, c] - background[y, x, c]) / noise[y, x, c]
                squared += contrast * contrast
                product += contrast * off
                difference += off * off
            squared = max(squared, np.float32(1e-6))
            mixed = min(max((math.sqrt(squared) / strength[y, x] - low) / (high - low), 0.0), 1.0)
            signed = min(max(product / squared, SHARE_RANGE[0]), SHARE_RANGE[1])
            unsigned = min(max(math.sqrt(difference) / strength[y, x], SHARE_RANGE[0]), SHARE_RANGE[1])
            share[y, x] = mixed * signed + (1 - mixed) * unsigned
            variance[y, x] = (1 + (1 - mixed) ** 2) / strength[y, x] ** 2
    return share, variance
