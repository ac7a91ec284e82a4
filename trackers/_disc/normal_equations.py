"""Normal equations of the disc model summed over pixels without an array of derivatives (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._disc.robust_least_squares import HUBER, TUKEY, Labels

ZONES = 3


@kernel(nogil=True)
def levels(terms: Array, background: Array, inside: Array, outside: Array, body: Array, surroundings: Array) -> None:
    """Set grey levels (n,) of the body and of the background behind it by their coefficients of the terms (n, 6)."""
    for k in range(background.size):
        own, behind = 0.0, background[k]
        for j in range(inside.size):
            own += terms[k, j] * inside[j]
        for j in range(outside.size):
            behind += terms[k, j] * outside[j]
        body[k], surroundings[k] = own, behind


@kernel(nogil=True)
def derivatives(row: Array, share: float, slopes: Array, contrast: float, terms: Array, counts: Array) -> None:
    """Set the derivatives (p,) of the grey level of a pixel by outline, levels inside and levels outside.

    ``counts`` says how many there are of each.
    """
    outline, inside, outside = counts
    for j in range(outline):
        row[j] = contrast * slopes[j]
    for j in range(inside):
        row[outline + j] = share * terms[j]
    for j in range(outside):
        row[outline + inside + j] = (1.0 - share) * terms[j]


@kernel(nogil=True)
def jacobian(share: Array, slopes: Array, contrast: Array, terms: Array, counts: Array) -> Array:
    """Derivatives (n, p) of the grey levels of pixels."""
    rows = np.empty((share.size, counts.sum()))
    for k in range(share.size):
        derivatives(rows[k], share[k], slopes[k], contrast[k], terms[k], counts)
    return rows


@kernel(nogil=True)
def weight_of(ratio: float, number: int) -> float:
    """Weight of a residual over sigma: 1 in the first round, Huber's in the second, Tukey's biweight in the third."""
    if number == 0:
        return 1.0
    if number == 1:
        return HUBER / max(ratio, HUBER)
    return max(0.0, 1.0 - (ratio / TUKEY) ** 2) ** 2


@kernel(nogil=True)
def _span(share: float, counts: Array) -> tuple[int, int]:
    """The parameters that a pixel tells: wholly inside or outside it tells the levels there alone."""
    inside = counts[0] + counts[1]
    if share == 1.0:
        return counts[0], inside
    return (inside, inside + counts[2]) if share == 0.0 else (0, inside + counts[2])


@kernel(nogil=True)
def normal_equations(
    jacobian_of: tuple[Array, Array, Array, Array, Array],
    sigma: Array,
    zone: Labels,
    number: int,
    residual: Array,
    weight: Array,
) -> tuple[Array, Array]:
    """Weighted sums over pixels: information of each zone (3, p, p), and gradient (p,).

    Parameters
    ----------
    jacobian_of
        Share, slopes, contrast, terms and counts, as for :func:`jacobian`.
    sigma, zone
        Noise (n,) of the pixels, grey levels, and the zone (n,) of each.
    number
        Of the round, which decides the weights.
    residual, weight
        Residuals (n,) in grey levels, and the weights (n,) to be set.
    """
    share, slopes, contrast, terms, counts = jacobian_of
    size = counts.sum()
    information, gradient, row = np.zeros((ZONES, size, size)), np.zeros(size), np.empty(size)
    for k in range(share.size):
        weight[k] = weight_of(abs(residual[k]) / sigma[k], number)
        if weight[k] == 0.0:
            continue
        scale = weight[k] / sigma[k] ** 2
        at = zone[k]
        first, stop = _span(share[k], counts)
        if first == 0:
            derivatives(row, share[k], slopes[k], contrast[k], terms[k], counts)
        else:
            for j in range(first, stop):
                row[j] = terms[k, j - first]
        for i in range(first, stop):
            scaled = scale * row[i]
            gradient[i] += scaled * residual[k]
            for j in range(first, i + 1):
                information[at, i, j] += scaled * row[j]
    for part in information:
        for i in range(size):
            for j in range(i):
                part[j, i] = part[i, j]
    return information, gradient
