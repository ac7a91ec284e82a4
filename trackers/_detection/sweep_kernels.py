"""A disc swept along a line, fitted to pixels (numba: half the time of NumPy's whole arrays)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._detection.shading import cholesky_solved

SHADOW, RIDGE = 4, 1e-9  # first term of the shadow; of the squares of a term, added for each pixel
SWEEP_STEP, SWEEP_DAMPING, SWEEP_RIDGE = 1e-4, 1e-3, 1e-12  # relative, of derivatives; at first; of a flat direction


@kernel(nogil=True)
def sweep_terms(columns: Array, rows: Array, sweep: Array) -> Array:
    """Coverage of pixels (n,) by a swept disc, its shading, and a shadow's terms on the background (n, 7).

    ``sweep`` (5,) is its middle, way and radius, px; see ``motion_blur.Sweep``.
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
