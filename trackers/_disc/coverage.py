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
def disc_coverage(x: Array, y: Array, outline: Array, way: Array, count: int) -> tuple[Array, Array]:
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

    Returns
    -------
    share, slopes : Array
        Share (n,) and its derivatives (n, 6) by the outline.
    """
    share, slopes = np.zeros(x.size), np.zeros((x.size, 6))
    blur, oval = outline[3], math.hypot(outline[4], outline[5])
    for part in range(count):
        t = (part + 0.5) / count - 0.5
        centre_x = outline[0] + t * way[0] + t**2 / 2 * way[3]
        centre_y = outline[1] + t * way[1] + t**2 / 2 * way[4]
        radius = outline[2] + t * way[2]
        step_x, step_y, step_r = (way[0] + t * way[3]) / count, (way[1] + t * way[4]) / count, way[2] / count
        longest = math.hypot(step_x, step_y) + abs(step_r)
        widest = HALF_DIAGONAL + BLUR_REACH * math.sqrt(blur) + longest / 2 + radius * oval + 0.5
        for k in range(x.size):
            dx, dy = x[k] - centre_x, y[k] - centre_y
            rho = max(math.hypot(dx, dy), SMALLEST_RHO)
            if abs(radius - rho) > widest:
                share[k] += rho < radius
                continue
            cos, sin = dx / rho, dy / rho
            twice_cos, twice_sin = cos**2 - sin**2, 2 * cos * sin
            bend = 1 / (2 * max(rho, radius / 2))
            edge = radius * (1 + twice_cos * outline[4] + twice_sin * outline[5])
            distance = edge - rho - bend * (blur + PIXEL_VARIANCE)
            across = step_x * cos + step_y * sin + step_r
            covered, slope, spread = edge_coverage(distance, cos, sin, blur + across**2 / 12)
            share[k] += covered
            slopes[k, 0] += slope * cos
            slopes[k, 1] += slope * sin
            slopes[k, 2] += slope
            slopes[k, 3] += spread - slope * bend
            slopes[k, 4] += slope * radius * twice_cos
            slopes[k, 5] += slope * radius * twice_sin
    return share / count, slopes / count
