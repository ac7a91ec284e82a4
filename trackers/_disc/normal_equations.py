"""Normal equations of the disc model, summed over pixels without an array of derivatives (numba), and their steps."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._disc.coverage import disc_coverage
from trackers._disc.robust_least_squares import HUBER, RIDGE, TUKEY, Labels

Scene = tuple[Array, Array, Array, Array, NDArray[np.int64], Array, int]  # see :func:`equations`

ZONES = 3
MIN_SHARE = 0.1  # of a step that goes back


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
    """The parameters that a pixel depends on: wholly inside or outside, the levels there alone."""
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


def equations(
    scene: Scene, data: tuple[Array, Array, Labels], number: int, parameters: Array, work: tuple[Array, ...]
) -> tuple[Array, Array]:
    """Information of each zone (3, p, p) and gradient (p,) of the disc model for its ``parameters`` (p,).

    Parameters
    ----------
    scene
        x and y (n,) of the pixels, px, their background (n,), the terms (n, 6) of their shading, how many parameters
        outline, body and surroundings have, and the way (5,) within the exposure and the number of its parts.
    data
        Grey levels (n,), their noise (n,) and zone (n,).
    number
        Of the round, which decides the weights.
    parameters
        Outline, levels inside, levels outside.
    work
        Set to share (n,), slopes (n, 6), contrast, residual and weight (n,).
    """
    x, y, background, terms, counts, way, parts = scene
    values, sigma, zone = data
    share, slopes, contrast, residual, weight = work
    cover(x, y, parameters[: counts[0]], way, parts, share, slopes)
    body = counts[0] + counts[1]
    levels(terms, background, parameters[counts[0] : body], parameters[body:], contrast, residual)
    contrast -= residual  # that of the background so far
    residual[:] = values - (residual + share * contrast)
    return normal_equations((share, slopes, contrast, terms, counts), sigma, zone, number, residual, weight)


def cover(x: Array, y: Array, outline: Array, way: Array, parts: int, share: Array, slopes: Array) -> None:
    """Set the share (n,) of each pixel that the moving disc covers in the mean, and its derivatives (n, 6)."""
    every = np.zeros(6)
    every[: outline.size] = outline
    disc_coverage(x, y, every, way, parts, share, slopes)


def gauss_newton(
    scene: Scene,
    data: tuple[Array, Array, Labels],
    rounds: tuple[int, int, float],
    bounds: tuple[Array, Array],
    start: Array,
    work: tuple[Array, ...],
) -> tuple[Array, Array, Array, Array]:
    """Gauss-Newton steps with the weights of one round; a step that goes to and fro is shortened, and lengthened again.

    Returns parameters and last step (p,), and the information of each zone and the gradient before that step.

    Parameters
    ----------
    scene, data, work
        As for :func:`equations`.
    rounds
        Number of the round, the most steps, and the step over standard error that ends it sooner.
    bounds
        Longest step (p,) and lowest value (p,) of each parameter.
    start
        Parameters (p,) to start from.
    """
    number, most, settled = rounds
    longest, lowest = bounds
    parameters, before, share = start.copy(), np.zeros_like(start), 1.0
    for _ in range(most):
        of_zones, gradient = equations(scene, data, number, parameters, work)
        information = of_zones.sum(axis=0)
        scale = np.sqrt(information.diagonal())
        step = bounded_step(parameters, information, gradient, longest, lowest)
        back = (step * scale * before).sum() < 0
        share = max(MIN_SHARE, share / 2) if back else min(1.0, share * 1.5)
        before = step * scale
        step = share * step
        parameters = np.maximum(parameters + step, lowest)
        if (np.abs(step) * scale <= settled).all():
            break
    return parameters, step, of_zones, gradient


def bounded_step(parameters: Array, information: Array, gradient: Array, longest: Array, lowest: Array) -> Array:
    """A Gauss-Newton step (p,); a parameter at its lowest value stays there while it is pushed down."""
    matrix, right = information.copy(), gradient.copy()
    matrix.flat[:: parameters.size + 1] *= 1.0 + RIDGE
    held = (parameters <= lowest) & (gradient <= 0)
    if held.any():
        matrix[held, :], matrix[:, held], right[held] = 0.0, 0.0, 0.0
        matrix[held, held] = 1.0
    return np.asarray(np.clip(np.linalg.solve(matrix, right), -longest, longest))
