"""Coverage of a pixel by a straight, perhaps blurred edge: exact and smooth, with derivatives (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel

NARROWEST = 1e-3  # px: side of a box that is taken for a line, so that no difference cancels
SHARPEST = 1e-12  # px^2: variance of the blur of a sharp edge
ENDED = 8.5  # standard deviations after which 1 - Phi is lost in rounding
ROOT_HALF, NORMAL_PEAK = math.sqrt(0.5), 1 / math.sqrt(2 * math.pi)
BLUR_REACH = 5.0  # standard deviations after which a blurred edge has ended


@kernel(nogil=True)
def edge_coverage(distance: float, cos: float, sin: float, variance: float) -> tuple[float, float, float]:
    """Share of a square pixel that lies inside of an edge blurred by a Gaussian.

    With a = |cos|, b = |sin| of the normal, a unit pixel is across the edge the convolution of two boxes of
    widths a and b. With g the second antiderivative of the normal distribution function of variance v,

        g(u) = (u^2 + v)/2 * Phi(u/s) + u s/2 * phi(u/s),   s^2 = v,
        share(d) = [g(d + p) - g(d + q) - g(d - q) + g(d - p)] / (a b),   p = (a + b)/2, q = (a - b)/2.

    Its derivatives come from g' = u Phi + s phi and, by the equation of heat, dg/dv = Phi/2.

    Parameters
    ----------
    distance
        Distance of the centre of the pixel to the edge, px, positive inside.
    cos, sin
        Cosine and sine of the angle of the normal of the edge.
    variance
        Of the blur, px^2; 0 for a sharp edge.

    Returns
    -------
    share, by_distance, by_variance : float
        Share, and its derivatives by the distance (1/px) and by the variance (1/px^2).
    """
    a, b = max(abs(cos), NARROWEST), max(abs(sin), NARROWEST)
    v = max(variance, SHARPEST)
    s = math.sqrt(v)
    high, low = 0.5 * (a + b), 0.5 * (a - b)
    first, second = _antiderivatives(distance + high, v, s), _antiderivatives(distance + low, v, s)
    third, fourth = _antiderivatives(distance - low, v, s), _antiderivatives(distance - high, v, s)
    share = first[0] - second[0] - third[0] + fourth[0]
    slope = first[1] - second[1] - third[1] + fourth[1]
    spread = first[2] - second[2] - third[2] + fourth[2]
    return share / (2 * a * b), slope / (a * b), spread / (2 * a * b)


@kernel(nogil=True, inline="always")
def _antiderivatives(u: float, v: float, s: float) -> tuple[float, float, float]:
    """2 g, g' and 2 dg/dv of :func:`edge_coverage`; beyond the reach of the blur the edge is sharp."""
    if u > ENDED * s:
        return u**2 + v, u, 1.0
    if u < -ENDED * s:
        return 0.0, 0.0, 0.0
    below = 0.5 * math.erfc(-u / s * ROOT_HALF)
    bell = s * math.exp(-0.5 * (u / s) ** 2) * NORMAL_PEAK
    return (u**2 + v) * below + u * bell, u * below + bell, below


def edge_reach(variance: float) -> float:
    """Distance in px from a blurred edge beyond which every pixel lies wholly on one side."""
    return float(np.sqrt(0.5) + BLUR_REACH * np.sqrt(max(variance, 0.0)))
