"""Coverage of pixels by a disc that moves during the exposure, with derivatives by its outline (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._disc.edge_coverage import BLUR_REACH, edge_coverage

PIXEL_VARIANCE = 1.0 / 12.0  # px^2, of a pixel in any direction
HALF_DIAGONAL = math.sqrt(0.5)  # px
SMALLEST_RHO = 1e-9  # px: the centre of a disc has no direction


@kernel(nogil=True)
def disc_coverage(x: Array, y: Array, outline: Array, way: Array, count: int, share: Array, slopes: Array) -> None:
    """Mean share of pixels that a disc covers while it moves evenly accelerated through an exposure.

    The coverage is that of a straight edge, its distance corrected for the curvature of the circle over the pixel
    and the blur, d = r - rho - (v + 1/12) / (2 rho). It is averaged over ``count`` equal parts of the exposure;
    within each the edge moves evenly, which blurs it by a twelfth of its squared distance.

    Parameters
    ----------
    x, y
        Centres (n,) of the pixels, px.
    outline
        (6,): x, y, radius, variance of the blur, and the parts of the radius that vary as cos 2 phi and sin 2 phi,
        all at the middle of the exposure.
    way
        (5,): by how much x, y and radius change over the exposure, px, and the second derivative of x and y,
        px per exposure squared.
    count
        Number of parts of the exposure.
    share, slopes
        Set to the share (n,) and its derivatives (n, 6) by the outline.
    """
    steps = _steps(outline, way, count)
    travel = math.hypot(way[0], way[1]) / 2 + math.hypot(way[3], way[4]) / 8 + abs(way[2]) / 2
    widest = steps[:, 6].max() + travel
    for k in range(x.size):
        slopes[k] = 0.0
        off = outline[2] - math.sqrt((x[k] - outline[0]) ** 2 + (y[k] - outline[1]) ** 2)
        if abs(off) > widest:  # wholly inside or outside throughout
            share[k] = off > 0
            continue
        total = 0.0
        for step in steps:
            total += _covered(x[k] - step[0], y[k] - step[1], outline, step, slopes[k])
        share[k] = total / count
        slopes[k] /= count


@kernel(nogil=True)
def _steps(outline: Array, way: Array, count: int) -> Array:
    """Of each part of the exposure x, y, radius, their change, and how far from the outline a pixel may show it."""
    steps = np.empty((count, 7))
    oval = math.hypot(outline[4], outline[5])
    for part in range(count):
        t = (part + 0.5) / count - 0.5
        step = steps[part]
        step[0] = outline[0] + t * way[0] + t**2 / 2 * way[3]
        step[1] = outline[1] + t * way[1] + t**2 / 2 * way[4]
        step[2] = outline[2] + t * way[2]
        step[3], step[4], step[5] = (way[0] + t * way[3]) / count, (way[1] + t * way[4]) / count, way[2] / count
        longest = math.hypot(step[3], step[4]) + abs(step[5])
        step[6] = HALF_DIAGONAL + BLUR_REACH * math.sqrt(outline[3]) + longest / 2 + step[2] * oval + 0.5
    return steps


@kernel(nogil=True)
def _covered(dx: float, dy: float, outline: Array, step: Array, slopes: Array) -> float:
    """Share of a pixel at (dx, dy) from the centre in one part of the exposure; its derivatives are added to slopes."""
    radius, blur = step[2], outline[3]
    rho = max(math.sqrt(dx**2 + dy**2), SMALLEST_RHO)  # several times as fast as math.hypot
    if abs(radius - rho) > step[6]:
        return 1.0 if rho < radius else 0.0
    inverse = 1.0 / rho
    cos, sin = dx * inverse, dy * inverse
    twice_cos, twice_sin = cos**2 - sin**2, 2 * cos * sin
    bend = 0.5 * min(inverse, 2.0 / radius)
    edge = radius * (1 + twice_cos * outline[4] + twice_sin * outline[5])
    distance = edge - rho - bend * (blur + PIXEL_VARIANCE)
    across = step[3] * cos + step[4] * sin + step[5]
    covered, slope, spread = edge_coverage(distance, cos, sin, blur + across**2 / 12)
    slopes[0] += slope * cos
    slopes[1] += slope * sin
    slopes[2] += slope
    slopes[3] += spread - slope * bend
    slopes[4] += slope * radius * twice_cos
    slopes[5] += slope * radius * twice_sin
    return covered
