"""Normal equations of the model of a corner, blurred and averaged over each pixel, summed over pixels (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

COUNT = 10  # x0, y0, two angles, two blurs, m, c, gx, gy
ENDED = 6.0  # times sqrt 2 standard deviations from an edge: its error function is 1 to rounding
HALF_PX = 0.5
ROOT_PI = math.sqrt(math.pi)


@kernel()
def corner_equations(pixels: Array, levels: Array, params: Array, normal: Array, gradient: Array) -> float:
    """Sum of squares of the residual of ``m + c E(d1, s1) E(d2, s2) + g (x - x0)``, and its normal equations.

    ``E(d, s)`` is the step at a distance d px, blurred by a Gaussian of standard deviation s and averaged over a pixel:
    a square pixel, seen along the normal of any edge, has the variance of a box 1 px wide.

    Parameters
    ----------
    pixels, levels
        Positions (n, 2) px and grey levels (n,).
    params
        (10,) x0, y0, the angles of the edges, their blurs, m, c and g.
    normal, gradient
        Set to J'J (10, 10) and J'r (10,).
    """
    normal[:], gradient[:] = 0.0, 0.0
    squares, row = 0.0, gradient.copy()
    sin_1, cos_1, sin_2, cos_2 = math.sin(params[2]), math.cos(params[2]), math.sin(params[3]), math.cos(params[3])
    row[6] = 1.0
    for k in range(levels.size):
        x, y = pixels[k, 0] - params[0], pixels[k, 1] - params[1]
        first, second = x * sin_1 - y * cos_1, x * sin_2 - y * cos_2
        step_1, slope_1, wider_1 = _edge(first, params[4])
        step_2, slope_2, wider_2 = _edge(second, params[5])
        by_1, by_2 = params[7] * step_2 * slope_1, params[7] * step_1 * slope_2
        row[0], row[1] = -(by_1 * sin_1 + by_2 * sin_2) - params[8], by_1 * cos_1 + by_2 * cos_2 - params[9]
        row[2], row[3] = by_1 * (x * cos_1 + y * sin_1), by_2 * (x * cos_2 + y * sin_2)
        row[4], row[5] = params[7] * step_2 * wider_1, params[7] * step_1 * wider_2
        row[7], row[8], row[9] = step_1 * step_2, x, y
        residual = levels[k] - (params[6] + params[7] * row[7] + x * params[8] + y * params[9])
        squares += residual * residual
        for i in range(COUNT):
            gradient[i] += row[i] * residual
            for j in range(i + 1):
                normal[i, j] += row[i] * row[j]
    for i in range(COUNT):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return squares


@kernel(inline="always")
def _edge(distance: float, blur: float) -> tuple[float, float, float]:
    """Step of height 2 from -1 to 1 px averaged over a pixel, and its derivatives by the distance and by the blur."""
    wide = math.sqrt(2.0) * blur
    if abs(distance) > ENDED * wide + HALF_PX:
        return math.copysign(1.0, distance), 0.0, 0.0
    near, far = (distance - HALF_PX) / wide, (distance + HALF_PX) / wide
    erf_near, erf_far = math.erf(near), math.erf(far)
    bell_near, bell_far = math.exp(-near * near) / ROOT_PI, math.exp(-far * far) / ROOT_PI
    step = wide * (far * erf_far + bell_far - near * erf_near - bell_near)
    return step, erf_far - erf_near, math.sqrt(2.0) * (bell_far - bell_near)
