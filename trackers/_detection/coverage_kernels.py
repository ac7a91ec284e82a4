"""Loops over the pixels round a body, for its coverage, its moments and a swept disc (numba).

The windows are small: array operations of NumPy would mostly cost their calls.
"""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._detection.shading import cholesky_solved
from trackers._frames.arrays import MAD_TO_SD, Bytes, Image

TELLING = 4.0  # contrast over noise: below it brightness leaves the coverage open
ONE_SIDED = (0.3, 0.7)  # |f| over s: below it a body is both brighter and darker, above it one of them
SHADOW, RIDGE = 4, 1e-9  # first term of the shadow; of the squares of a term, added for each pixel
SWEEP_STEP, SWEEP_DAMPING, SWEEP_RIDGE = 1e-4, 1e-3, 1e-12  # relative, of derivatives; at first; of a flat direction
SHARE_RANGE = (-0.3, 1.3)  # coverage beyond this shows another object, not noise


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
    """Share (h, w) of each pixel that a body covers, and its variance; by the mask where brightness leaves it open.

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


@kernel(nogil=True)
def off_background(image: Image, background: Image, free: Bytes) -> Image:
    """Difference from the background where it is ``free`` (h, w), 0 elsewhere, and where that is: one channel more."""
    height, width, channels = image.shape
    off = np.zeros((height, width, channels + 1), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            if free[y, x]:
                off[y, x, channels] = 1
                for c in range(channels):
                    off[y, x, c] = image[y, x, c] - background[y, x, c]
    return off


@kernel(nogil=True)
def levelled(background: Image, soft: Image, least: float) -> Image:
    """The background plus the mean of :func:`off_background`, blurred: ``soft``, with the weight ``least`` added."""
    height, width, channels = background.shape
    level = np.empty((height, width, channels), dtype=np.float32)
    for y in range(height):
        for x in range(width):
            weight = max(soft[y, x, channels], np.float32(least))
            for c in range(channels):
                level[y, x, c] = background[y, x, c] + soft[y, x, c] / weight
    return level


@kernel(nogil=True)
def liveliness(share: Image, variance: Image, beyond: Image, fewest: int) -> float:
    """Variance of the coverage just outside of the band, where it should be 0, over that expected; at least 1.

    The median keeps out the cord or whatever else is there. ``beyond`` (h, w), px, is negative outside of the band.
    """
    found, count = np.empty(share.size, dtype=np.float32), 0
    for y in range(share.shape[0]):
        for x in range(share.shape[1]):
            if beyond[y, x] < 0 and variance[y, x] > 0:
                found[count] = abs(share[y, x]) / np.sqrt(variance[y, x])
                count += 1
    if count < fewest:
        return 1.0
    return max(1.0, (MAD_TO_SD * float(np.median(found[:count]))) ** 2)


@kernel(nogil=True)
def texture_variance(share: Image, variance: Image, within: Image, deepest: float) -> float:
    """Variance of the coverage just inside of the band, where it should be 1, beyond its noise.

    ``within`` (h, w), px, is above 0 inside of the band; up to ``deepest`` counts.
    """
    total, count = 0.0, 0
    for y in range(share.shape[0]):
        for x in range(share.shape[1]):
            if 0 < within[y, x] < deepest:
                total += (share[y, x] - 1.0) ** 2 - variance[y, x]
                count += 1
    return max(0.0, total / max(count, 1))


@kernel(nogil=True)
def moments(share: Array, variance: Array) -> Array:
    """Area, x, y, their standard errors, and the largest share at the border: (7,), px.

    ``share`` and ``variance`` (h, w) are the coverage of each pixel and its variance.
    """
    height, width = share.shape
    columns, rows, noisy_columns, noisy_rows = np.zeros(width), np.zeros(height), np.zeros(width), np.zeros(height)
    border = 0.0
    for y in range(height):
        for x in range(width):
            columns[x] += share[y, x]
            rows[y] += share[y, x]
            noisy_columns[x] += variance[y, x]
            noisy_rows[y] += variance[y, x]
            if y == 0 or x == 0 or y == height - 1 or x == width - 1:
                border = max(border, share[y, x])
    area = max(columns.sum(), 1e-9)
    x, y = (columns * np.arange(width)).sum() / area, (rows * np.arange(height)).sum() / area
    sigma_x = math.sqrt((noisy_columns * (np.arange(width) - x) ** 2).sum()) / area
    sigma_y = math.sqrt((noisy_rows * (np.arange(height) - y) ** 2).sum()) / area
    return np.array([area, x, y, math.sqrt(noisy_rows.sum()), sigma_x, sigma_y, border])


@kernel(nogil=True)
def seen_inside(planes: Planes, mask: Bytes) -> tuple[float, float, float, int]:
    """Means over a mask (h, w): the largest difference of the channels, first channel and its noise; its pixels."""
    image, background, noise = planes
    contrast = intensity = noisy = 0.0
    count = 0
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if mask[y, x]:
                most = 0.0
                for c in range(image.shape[2]):
                    most = max(most, abs(float(image[y, x, c] - background[y, x, c])))
                contrast += most
                intensity += image[y, x, 0]
                noisy += noise[y, x, 0]
                count += 1
    return contrast / max(count, 1), intensity / max(count, 1), noisy / max(count, 1), count


@kernel(nogil=True)
def seen_roughly(
    image: Image, background: Image, mask: Bytes
) -> tuple[float, float, float, float, float, float, float]:
    """Area, column and row of the middle of a mask (h, w), px, and what its pixels show.

    That are means of the largest difference of the channels, of the difference and the level of the first, grey
    levels, and the steepness of that difference which a tenth of the pixels have or exceed, grey levels a px.
    """
    height, width, channels = image.shape
    level, slopes = np.zeros((height, width)), np.empty(height * width)
    area = across = down = contrast = brightening = intensity = 0.0
    for y in range(height):
        for x in range(width):
            for c in range(channels):
                level[y, x] = max(level[y, x], abs(image[y, x, c] - background[y, x, c]))
    for y in range(height):
        for x in range(width):
            if mask[y, x]:
                along = level[y, min(x + 1, width - 1)] - level[y, max(x - 1, 0)]
                beside = level[min(y + 1, height - 1), x] - level[max(y - 1, 0), x]
                slopes[int(area)] = math.hypot(along, beside) / 2
                area, across, down, contrast = area + 1, across + x, down + y, contrast + level[y, x]
                brightening += image[y, x, 0] - background[y, x, 0]
                intensity += image[y, x, 0]
    steep = np.partition(slopes[: int(area)], int(0.9 * area))[int(0.9 * area)]
    return area, across / area, down / area, contrast / area, brightening / area, intensity / area, steep


@kernel(nogil=True)
def sweep_terms(columns: Array, rows: Array, sweep: Array) -> Array:
    """Coverage of pixels (n,) by a swept disc, its shading, and a shadow's terms on the background (n, 7).

    The share of the exposure for which each is covered, and, summed over that time, u, v and u^2 + v^2: the position on
    the disc that it sees, along the way and across it, in radii. ``sweep`` (5,) is its middle, way and radius, px; see
    ``motion_blur.Sweep``.
    """
    x0, y0, across, down, radius = sweep
    length = max(math.hypot(across, down), 1e-6)
    ahead_x, ahead_y = across / length, down / length
    farthest = (length / 2 + radius + 1) ** 2
    terms = np.zeros((columns.size, 7))
    for k in range(columns.size):
        x, y = columns[k] - x0, rows[k] - y0
        row, free = terms[k], 1.0
        v = y * ahead_x - x * ahead_y
        if abs(v) < radius + 0.5 and x * x + y * y < farthest:
            along = x * ahead_x + y * ahead_y
            half = _area(v + 0.5, radius) - _area(v - 0.5, radius)  # of the chord, mean over a pixel
            first = min(max(along - half, -length / 2), length / 2)
            last = min(max(along + half, -length / 2), length / 2)
            u, w, share = (along - first) / radius, (along - last) / radius, (last - first) / length
            v = v / radius
            free = 1.0 - share
            row[0], row[1], row[2] = share, share * (u + w) / 2, share * v
            row[3] = share * ((u * u + u * w + w * w) / 3 + v * v)
        row[4], row[5], row[6] = free, free * x / radius, free * y / radius
    return terms


@kernel(nogil=True)
def swept_left_over(columns: Array, rows: Array, difference: Array, background: Array, sweep: Array) -> Array:
    """What the best brightness and shadow of a swept disc leave of ``difference`` (n, channels).

    ``background`` (n, channels) is in the same unit; the others are as for :func:`sweep_terms`.
    """
    terms = sweep_terms(columns, rows, sweep)
    count, channels, size = columns.size, difference.shape[1], terms.shape[1]
    gram, moments = np.zeros((size, size)), np.zeros((size, channels))
    left = np.empty((count, channels))
    for k in range(count):
        for c in range(channels):
            left[k, c] = difference[k, c] + background[k, c] * terms[k, 0]
        for i in range(0 if terms[k, 0] > 0 else SHADOW, size):
            for j in range(0 if terms[k, 0] > 0 else SHADOW, i + 1):
                gram[i, j] += terms[k, i] * terms[k, j]
            for c in range(channels):
                moments[i, c] += terms[k, i] * left[k, c]
    for i in range(size):
        gram[i, i] += RIDGE * count
    solved = cholesky_solved(gram, moments, size)
    for k in range(count):
        for i in range(0 if terms[k, 0] > 0 else SHADOW, size):
            for c in range(channels):
                left[k, c] -= terms[k, i] * solved[i, c]
    return left


@kernel(nogil=True)
def swept_slopes(columns: Array, rows: Array, difference: Array, background: Array, sweep: Array, left: Array) -> Array:
    """Derivatives (n * channels, 5) by the sweep of what is ``left`` (n, channels), by differences.

    The other arguments are as for :func:`swept_left_over`, which gives what is left.
    """
    slopes = np.empty((left.size, sweep.size))
    for j in range(sweep.size):
        moved = sweep.copy()
        moved[j] += SWEEP_STEP * (sweep[j] if sweep[j] != 0.0 else 1.0)
        off = swept_left_over(columns, rows, difference, background, moved)
        slopes[:, j] = (off - left).ravel() / (moved[j] - sweep[j])
    return slopes


@kernel(nogil=True)
def swept(
    columns: Array, rows: Array, difference: Array, background: Array, sweep: Array, enough: float, steps: int
) -> tuple[Array, Array]:
    """The sweep (5,) that leaves least, and what it leaves (n, channels), by the method of Levenberg and Marquardt.

    It begins at ``sweep``, and ends after ``steps`` steps, or where a step lessens the sum of squares by less than
    the share ``enough``. The other arguments are as for :func:`swept_left_over`.
    """
    damping = SWEEP_DAMPING
    left = swept_left_over(columns, rows, difference, background, sweep)
    cost, size, step = (left * left).sum(), sweep.size, 0
    while step < steps:
        slopes = swept_slopes(columns, rows, difference, background, sweep, left)
        gram, moments = slopes.T @ slopes, np.zeros((size, 1))
        moments[:, 0] = slopes.T @ left.ravel()
        better = False
        while not better and step < steps:
            step += 1
            damped = gram.copy()
            for j in range(size):
                damped[j, j] += damping * gram[j, j] + SWEEP_RIDGE
            tried = sweep - cholesky_solved(damped, moments, size)[:, 0]
            off = swept_left_over(columns, rows, difference, background, tried)
            lower = (off * off).sum()
            better = lower < cost
            if better and cost - lower > enough * cost:
                damping *= 0.1
            elif better or damping > 1e6:
                return (tried, off) if better else (sweep, left)
            else:
                damping *= 10.0
        if better:
            sweep, left, cost = tried, off, lower
    return sweep, left


@kernel(nogil=True)
def _area(v: float, radius: float) -> float:
    """Area between a half circle, its diameter, and the lines at 0 and v."""
    inside = min(max(v, -radius), radius)
    return 0.5 * (inside * math.sqrt(max(radius**2 - inside**2, 0.0)) + radius**2 * math.asin(inside / radius))
