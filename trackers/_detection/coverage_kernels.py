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
def own_brightness(planes: Planes, shade: Image, soft: Image, weight: Image, near: Flags) -> tuple[Image, Image, Image]:
    """The body's own brightness, continued outwards, its strength (h, w), and what it misses of the strength seen.

    The strength is how far the channels are off the background, in units of the noise. ``soft`` (h, w, channels + 1) is
    what the ``shade`` leaves of the image, times the ``weight``, and that, blurred; their ratio is added to the shade.
    What is neither inside nor ``near`` (h, w) is left out: 0.
    """
    image, background, noise = planes
    channels, height, width = image.shape
    own = np.zeros((channels, height, width), dtype=np.float32)
    strength = np.zeros((height, width), dtype=np.float32)
    missed = np.zeros((height, width), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            if not near[y, x] and weight[y, x] <= 0:
                continue
            of_own = of_seen = np.float32(0)
            for c in range(channels):
                own[c, y, x] = shade[c, y, x] + soft[y, x, c] / max(soft[y, x, channels], MIN_WEIGHT)
                off = (own[c, y, x] - background[c, y, x]) / noise[c, y, x]
                seen = (image[c, y, x] - background[c, y, x]) / noise[c, y, x]
                of_own += off * off
                of_seen += seen * seen
            strength[y, x] = math.sqrt(of_own)
            missed[y, x] = (np.float32(math.sqrt(of_seen)) - strength[y, x]) * weight[y, x]
    return own, strength, missed


@kernel(nogil=True)
def shares(planes: Planes, own: Image, strength: Image, mask: Bytes, near: Flags) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that a body covers, and its variance; by the mask where brightness leaves it open.

    ``own`` is the body's own brightness, ``strength`` (h, w) how far it is off the background; see
    ``coverage_centre``.
    """
    image, background, noise = planes
    channels, height, width = image.shape
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
                contrast = (own[c, y, x] - background[c, y, x]) / noise[c, y, x]
                off = (image[c, y, x] - background[c, y, x]) / noise[c, y, x]
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
