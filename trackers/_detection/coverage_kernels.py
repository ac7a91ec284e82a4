"""Loops over the pixels round a body, for coverage, the width of its outline and a swept disc (numba).

The windows are small: array operations of NumPy would mostly cost their calls.
"""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._frames.arrays import Bytes, Image

TELLING = 4.0  # contrast over noise from which brightness tells coverage
ONE_SIDED = (0.3, 0.7)  # |f| over s: below it a body is both brighter and darker, above it one of them
SHARE_RANGE = (-0.3, 1.3)  # coverage beyond this is another thing, not noise
TAIL = 0.03  # mean coverage, or fall of it, at which the outline has ended
STEPS_APART = 6  # quarters of a px over which the coverage falls, or no longer does
NARROWEST = 0.75  # px, half the width of the sharpest outline: half a pixel's diagonal
QUARTER = 0.25  # px from one ring about the outline to the next


@kernel(nogil=True)
def strength_of(image: Image, background: Image, noise: Image) -> Image:
    """How far an image (h, w, channels) is off the background, in units of the noise (h, w)."""
    height, width, channels = image.shape
    strength = np.empty((height, width), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            squared = np.float32(0)
            for c in range(channels):
                off = (image[y, x, c] - background[y, x, c]) / noise[y, x, c]
                squared += off * off
            strength[y, x] = math.sqrt(squared)
    return strength


@kernel(nogil=True)
def shares(planes: tuple[Image, Image, Image, Image], strength: Image, mask: Bytes, near: Bytes) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that a body covers, and its variance; by the mask where brightness does not tell.

    ``planes`` are the body's own brightness, image, background and noise (h, w, channels); see ``coverage_centre``.
    """
    foreground, image, background, noise = planes
    height, width, channels = image.shape
    share, variance = np.zeros((2, height, width), dtype=np.float32)
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
                contrast = (foreground[y, x, c] - background[y, x, c]) / noise[y, x, c]
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


@kernel(nogil=True)
def reach_of(away: Image, beside: Image, widest: float, trimmed: bool) -> float:
    """The distance, px, outside of an outline at which the mean coverage falls no more.

    Parameters
    ----------
    away, beside
        Distance (n,) of pixels outside of the outline, px, and their coverage.
    widest
        Largest distance, px.
    trimmed
        Whether the mean is that without the largest and the smallest tenth; else it is the median.
    """
    order = np.argsort(away)
    ordered, levels, count = away[order], np.empty(int((widest + 1.0) / QUARTER) + 4), 0
    first = stop = 0
    half_width = NARROWEST
    while half_width < widest + 1.0:
        while first < ordered.size and ordered[first] <= half_width:
            first += 1
        stop = max(first, stop)
        while stop < ordered.size and ordered[stop] < half_width + 0.75:
            stop += 1
        ring = np.sort(beside[order[first:stop]])
        cut = ring.size // 10
        level = 0.0
        if ring.size and trimmed:
            level = ring[cut : ring.size - cut].mean()
        elif ring.size:
            level = (ring[(ring.size - 1) // 2] + ring[ring.size // 2]) / 2
        levels[count] = level
        if level < TAIL:
            return min(half_width, widest)
        if count >= STEPS_APART and levels[count - STEPS_APART] - level < TAIL:
            return half_width - STEPS_APART / 4
        count += 1
        half_width = NARROWEST + QUARTER * count
    return widest


@kernel(nogil=True)
def sweep_terms(columns: Array, rows: Array, sweep: Array) -> Array:
    """Coverage of pixels (n,) by a swept disc, its shading, and a shadow's terms on the background (n, 7).

    ``sweep`` (5,) is its middle, way and radius, px; see ``motion_blur.Sweep``.
    """
    x0, y0, across, down, radius = sweep
    length = max(math.hypot(across, down), 1e-6)
    ahead_x, ahead_y = across / length, down / length
    terms = np.empty((columns.size, 7))
    for k in range(columns.size):
        x, y = columns[k] - x0, rows[k] - y0
        along, v = x * ahead_x + y * ahead_y, y * ahead_x - x * ahead_y
        half = _area(v + 0.5, radius) - _area(v - 0.5, radius)  # of the chord, mean over a pixel
        first = min(max(along - half, -length / 2), length / 2)
        last = min(max(along + half, -length / 2), length / 2)
        u, w, share = (along - first) / radius, (along - last) / radius, (last - first) / length
        v = v / radius
        free = 1.0 - share
        row = terms[k]
        row[0], row[1], row[2] = share, share * (u + w) / 2, share * v
        row[3] = share * ((u * u + u * w + w * w) / 3 + v * v)
        row[4], row[5], row[6] = free, free * x / radius, free * y / radius
    return terms


@kernel(nogil=True)
def _area(v: float, radius: float) -> float:
    """Area between a half circle, its diameter, and the lines at 0 and v."""
    inside = min(max(v, -radius), radius)
    return 0.5 * (inside * math.sqrt(max(radius**2 - inside**2, 0.0)) + radius**2 * math.asin(inside / radius))
