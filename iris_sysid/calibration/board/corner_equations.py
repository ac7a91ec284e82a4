"""Normal equations of the model of a blurred corner, summed over pixels (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

COUNT = 10  # x0, y0, two angles, two blurs, m, c, gx, gy
ENDED = 6.0  # times sqrt 2 standard deviations from an edge: its error function is 1 to rounding


@kernel()
def corner_equations(pixels: Array, levels: Array, params: Array, normal: Array, gradient: Array) -> float:
    """Sum of squares of the residual of ``m + c E(d1/s1) E(d2/s2) + g (x - x0)``, and its normal equations.

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
    wide_1, wide_2 = math.sqrt(2.0) * params[4], math.sqrt(2.0) * params[5]
    row[6] = 1.0
    for k in range(levels.size):
        x, y = pixels[k, 0] - params[0], pixels[k, 1] - params[1]
        first, second = x * sin_1 - y * cos_1, x * sin_2 - y * cos_2
        step_1, bell_1 = _edge(first / wide_1)
        step_2, bell_2 = _edge(second / wide_2)
        by_1, by_2 = params[7] * step_2 * bell_1 / wide_1, params[7] * step_1 * bell_2 / wide_2
        row[0], row[1] = -(by_1 * sin_1 + by_2 * sin_2) - params[8], by_1 * cos_1 + by_2 * cos_2 - params[9]
        row[2], row[3] = by_1 * (x * cos_1 + y * sin_1), by_2 * (x * cos_2 + y * sin_2)
        row[4], row[5] = -by_1 * first / params[4], -by_2 * second / params[5]
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
def _edge(distance: float) -> tuple[float, float]:
    """Error function and its derivative."""
    if abs(distance) > ENDED:
        return math.copysign(1.0, distance), 0.0
    return math.erf(distance), 2.0 / math.sqrt(math.pi) * math.exp(-distance * distance)
