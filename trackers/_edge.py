"""How much of a pixel lies behind a straight, perhaps blurred, edge: exact, smooth, with its derivatives."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from iris_sysid.types import Array

NARROWEST = 1e-3  # px: side of a box that is taken for a line, so that no difference cancels
SHARPEST = 1e-12  # px^2: variance of the blur of a sharp edge
BLUR_REACH = 5.0  # standard deviations after which a blurred edge has ended


def edge_coverage(distance: Array, normal: tuple[Array, Array], variance: Array | float) -> tuple[Array, Array, Array]:
    """Share of square pixels that lie inside of an edge blurred by a Gaussian.

    With a = |cos|, b = |sin| of the normal, a unit pixel is across the edge the convolution of two boxes of
    widths a and b. With g the second antiderivative of the normal distribution function of variance v,

        g(u) = (u^2 + v)/2 * Phi(u/s) + u s/2 * phi(u/s),   s^2 = v,
        share(d) = [g(d + p) - g(d + q) - g(d - q) + g(d - p)] / (a b),   p = (a + b)/2, q = (a - b)/2.

    Its derivatives come from g' = u Phi + s phi and, by the equation of heat, dg/dv = Phi/2.

    Parameters
    ----------
    distance
        Distance (n,) of the centres of the pixels to the edge, px, positive inside.
    normal
        Cosine and sine (n,) of the angle of the normal of the edge.
    variance
        Of the blur, px^2, of all pixels or of each (n,); 0 for a sharp edge.

    Returns
    -------
    share, by_distance, by_variance : Array
        Share (n,), and its derivatives by the distance (1/px) and by the variance (1/px^2).
    """
    a, b = (np.maximum(np.abs(side), NARROWEST) for side in normal)
    v = np.maximum(variance, SHARPEST)
    s = np.sqrt(v)
    share, slope, spread = (np.zeros_like(distance) for _ in range(3))
    for sign, shift in ((1, a + b), (-1, a - b), (-1, b - a), (1, -a - b)):
        u = distance + shift / 2
        below = ndtr(u / s)
        bell = s * np.exp(-0.5 * np.minimum((u / s) ** 2, 1e3)) / np.sqrt(2 * np.pi)
        share += sign * ((u**2 + v) * below + u * bell)
        slope += sign * (u * below + bell)
        spread += sign * below
    return share / (2 * a * b), slope / (a * b), spread / (2 * a * b)


def edge_reach(variance: float) -> float:
    """Distance in px from a blurred edge beyond which every pixel lies wholly on one side."""
    return float(np.sqrt(0.5) + BLUR_REACH * np.sqrt(max(variance, 0.0)))
