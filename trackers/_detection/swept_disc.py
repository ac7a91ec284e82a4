"""The image of a disc that moves evenly during an exposure, and what it leaves of the pixels (numba: its terms)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

RIDGE = 1e-9  # of the squares of a term, added for each pixel
STEP = 1e-4  # relative, of derivatives
SURELY = 1e-6  # px: rounding is less


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
            half = _half_chord(v, abs(along), length / 2, radius)
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
def _half_chord(v: float, along: float, half_way: float, radius: float) -> float:
    """Half the chord at v, mean over a pixel; only as exact as it counts where a pixel is covered always or never."""
    shortest = math.sqrt(max(radius**2 - (abs(v) + 0.5) ** 2, 0.0))
    longest = math.sqrt(radius**2 - max(abs(v) - 0.5, 0.0) ** 2)
    if shortest > along + half_way + SURELY:
        return shortest
    if longest < along - half_way - SURELY:
        return longest
    return _area(v + 0.5, radius) - _area(v - 0.5, radius)


@kernel(nogil=True)
def _area(v: float, radius: float) -> float:
    """Area between a half circle, its diameter, and the lines at 0 and v."""
    inside = min(max(v, -radius), radius)
    return 0.5 * (inside * math.sqrt(max(radius**2 - inside**2, 0.0)) + radius**2 * math.asin(inside / radius))


def swept_left_over(columns: Array, rows: Array, difference: Array, background: Array, sweep: Array) -> Array:
    """What the best brightness and shadow of a swept disc leave of ``difference`` (n, channels).

    ``background`` (n, channels) is in the same unit; the others are as for :func:`sweep_terms`.
    """
    terms = sweep_terms(columns, rows, sweep)
    left = difference + background * terms[:, :1]
    gram = terms.T @ terms + RIDGE * len(terms) * np.eye(terms.shape[1])
    return np.asarray(left - terms @ np.linalg.solve(gram, terms.T @ left))


def swept_slopes(columns: Array, rows: Array, difference: Array, background: Array, sweep: Array, left: Array) -> Array:
    """Derivatives (n * channels, 5) of :func:`swept_left_over` by the sweep, by differences; its arguments.

    ``left`` (n, channels) is the residual at the sweep itself.
    """
    steps = STEP * np.where(sweep == 0, 1.0, sweep)
    moved = (swept_left_over(columns, rows, difference, background, sweep + step) for step in np.diag(steps))
    return np.column_stack([(off - left).ravel() / step for off, step in zip(moved, steps, strict=True)])
