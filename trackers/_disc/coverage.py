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
MIN_RHO = 1e-9  # px: the centre of a disc has no direction


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
    whole = _squared_limits(outline[2], steps[:, 6].max() + travel)
    for k in range(x.size):
        x_k, y_k, total = x[k], y[k], 0.0
        dx, dy, radial, blurred, even, odd = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        squared = (x_k - outline[0]) ** 2 + (y_k - outline[1]) ** 2
        if whole[0] <= squared <= whole[1]:
            for part in range(count):
                off_x, off_y = x_k - steps[part, 0], y_k - steps[part, 1]
                squared = off_x * off_x + off_y * off_y
                if squared < steps[part, 7]:
                    total += 1.0
                elif squared <= steps[part, 8]:
                    covered, slope, by_blur, cos, sin = _covered(off_x, off_y, squared, outline, steps, part)
                    total += covered
                    dx += slope * cos
                    dy += slope * sin
                    radial += slope
                    blurred += by_blur
                    even += slope * steps[part, 2] * (cos * cos - sin * sin)
                    odd += slope * steps[part, 2] * (2 * cos * sin)
        elif squared < whole[0]:  # inside throughout
            total = float(count)
        share[k] = total / count
        slopes[k, 0], slopes[k, 1], slopes[k, 2] = dx / count, dy / count, radial / count
        slopes[k, 3], slopes[k, 4], slopes[k, 5] = blurred / count, even / count, odd / count


@kernel(nogil=True)
def _squared_limits(radius: float, reach: float) -> tuple[float, float]:
    """Squared distances from the centre, px^2, below which a pixel is wholly inside and above which it is outside."""
    return (radius - reach) ** 2 if radius > reach else 0.0, (radius + reach) ** 2


@kernel(nogil=True)
def _steps(outline: Array, way: Array, count: int) -> Array:
    """Of each part of the exposure x, y, radius, their change, and how far from the outline a pixel may show it.

    The last two are the squared distances from the centre, px^2, between which it may.
    """
    steps = np.empty((count, 9))
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
        step[7], step[8] = _squared_limits(step[2], step[6])
    return steps


@kernel(nogil=True)
def _covered(
    dx: float, dy: float, squared: float, outline: Array, steps: Array, part: int
) -> tuple[float, float, float, float, float]:
    """Share of a pixel at (dx, dy) from the centre in one part of the exposure, and what its derivatives are made of.

    These are the derivatives by the distance from the edge and by the blur, and the direction of the pixel.
    """
    radius = steps[part, 2]
    rho = max(math.sqrt(squared), MIN_RHO)  # several times as fast as math.hypot
    inverse = 1.0 / rho
    cos, sin = dx * inverse, dy * inverse
    bend = 0.5 * min(inverse, 2.0 / radius)
    oval = 1 + (cos**2 - sin**2) * outline[4] + 2 * cos * sin * outline[5]
    distance = radius * oval - rho - bend * (outline[3] + PIXEL_VARIANCE)
    across = steps[part, 3] * cos + steps[part, 4] * sin + steps[part, 5]
    covered, slope, spread = edge_coverage(distance, cos, sin, outline[3] + across**2 / 12)
    return covered, slope, spread - slope * bend, cos, sin
