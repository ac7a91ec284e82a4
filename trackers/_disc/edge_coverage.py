"""Coverage of a pixel by a straight, perhaps blurred edge: exact and smooth, with derivatives (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel

MIN_WIDTH = 1e-3  # px: side of a box that is taken for a line, so that no difference cancels
MIN_VARIANCE = 1e-12  # px^2: variance of the blur of a sharp edge
ENDED = 8.5  # standard deviations after which 1 - Phi is lost in rounding
ROOT_HALF, NORMAL_PEAK = math.sqrt(0.5), 1 / math.sqrt(2 * math.pi)
NODES = 128  # of the table of the normal distribution to one standard deviation: its Taylor series has 1e-16 between
BLUR_REACH = 5.0  # standard deviations after which a blurred edge has ended
STEP, SIXTH = 1 / NODES, 1 / 6
BELOW = np.array([0.5 * math.erfc(-(k / NODES - ENDED) * ROOT_HALF) for k in range(int(2 * ENDED * NODES) + 2)])
BELL = np.array([math.exp(-0.5 * (k / NODES - ENDED) ** 2) * NORMAL_PEAK for k in range(int(2 * ENDED * NODES) + 2)])


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
    a, b = max(abs(cos), MIN_WIDTH), max(abs(sin), MIN_WIDTH)
    v = max(variance, MIN_VARIANCE)
    s = math.sqrt(v)
    high, low = 0.5 * (a + b), 0.5 * (a - b)
    inverse, share_of = 1.0 / s, 1.0 / (a * b)
    first, second = _antiderivatives(distance + high, v, s, inverse), _antiderivatives(distance + low, v, s, inverse)
    third, fourth = _antiderivatives(distance - low, v, s, inverse), _antiderivatives(distance - high, v, s, inverse)
    share = first[0] - second[0] - third[0] + fourth[0]
    slope = first[1] - second[1] - third[1] + fourth[1]
    spread = first[2] - second[2] - third[2] + fourth[2]
    return 0.5 * share * share_of, slope * share_of, 0.5 * spread * share_of


@kernel(nogil=True, inline="always")
def _antiderivatives(u: float, v: float, s: float, inverse: float) -> tuple[float, float, float]:
    """2 g, g' and 2 dg/dv of :func:`edge_coverage`; beyond the reach of the blur the edge is sharp. 1 / s is given."""
    if u > ENDED * s:
        return u**2 + v, u, 1.0
    if u < -ENDED * s:
        return 0.0, 0.0, 0.0
    below, bell = _normal(u * inverse)
    return (u**2 + v) * below + u * s * bell, u * below + s * bell, below


@kernel(nogil=True, inline="always")
def _normal(z: float) -> tuple[float, float]:
    """Normal distribution function and density, by the Taylor series about the nearest node of the tables."""
    node = int((z + ENDED) * NODES + 0.5)
    c = node * STEP - ENDED
    d = z - c
    second, third = c * c - 1.0, c * (c * c - 3.0)
    fourth = c * c * (c * c - 6.0) + 3.0
    series = 1.0 + d * (-0.5 * c + d * (SIXTH * second + d * (-0.25 * SIXTH * third + d * (0.05 * SIXTH) * fourth)))
    density = 1.0 + d * (-c + d * (0.5 * second + d * (-SIXTH * third + d * (0.25 * SIXTH) * fourth)))
    return BELOW[node] + BELL[node] * d * series, BELL[node] * density


def edge_reach(variance: float) -> float:
    """Distance in px from a blurred edge beyond which every pixel lies wholly on one side."""
    return float(np.sqrt(0.5) + BLUR_REACH * np.sqrt(max(variance, 0.0)))
