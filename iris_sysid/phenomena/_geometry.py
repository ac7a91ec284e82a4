"""Robust fits of circles and lines to measured positions, with the covariance of autocorrelated residuals.

Residuals about an arc or a board are not white: the lens, the perspective and a cord that swings out of the plane make
them vary slowly. The covariance of each fit is therefore that of white residuals times ``(1 + rho) / (1 - rho)`` with
their correlation rho from one sample to the next (Bayley and Hammersley 1946, J. R. Stat. Soc. Suppl. 8, 184, eq. 5).

A background that is seen beside the body displaces it at each place alike, swing after swing, which no correlation from
one sample to the next shows. The covariance of an arc allows for a displacement that varies smoothly along it, of the
size and the width that the residuals show (restricted maximum likelihood, Patterson and Thompson 1971, Biometrika 58,
545).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types import Array, Estimate, Mask, Trajectory

NORMAL_MAD = 1.4826  # median absolute deviation to standard deviation of a normal
OUTLYING = 5.0  # standard deviations: a normal residual exceeds it once in two million samples
PLACES = 30  # parts of an arc, whose mean residuals tell how it displaces a body
WIDTHS = (0.03, 0.06, 0.12, 0.25)  # of an arc, to try: how far a displacement reaches
SIZES = np.concatenate([[0.0], np.geomspace(0.05, 20.0, 14)])  # of a displacement, over the scatter at a place, to try
TURNS = 10  # rounds of rejecting outliers; two or three are usual
DETERMINED = 3.0  # standard errors by which the curvature must differ from zero
NEAR_THE_TOP = 2.6  # rad; below it no full turn is possible, and a gap must not be unwrapped as one


@dataclass(frozen=True, eq=False, slots=True)
class Circle:
    """A circle through positions: ``x``, ``z``, ``radius`` and their covariance (3, 3) in that order.

    ``off`` (n,) is the distance of each position from it (positive outside), ``belongs`` (n,) marks the positions that
    are not outliers, and ``scatter`` is the standard deviation of their distances.
    """

    x: float
    z: float
    radius: float
    covariance: Array
    off: Array
    scatter: float
    belongs: Mask

    @property
    def stderr(self) -> Array:
        """Standard errors (3,) of x, z and radius. They are in the unit of the positions."""
        return np.sqrt(np.diag(self.covariance))


def fit_circle(position: Array, sigma: float = 0.0, radius: float | None = None, radius_stderr: float = 0.0) -> Circle:
    """Fit a circle to an arc below its centre, by least squares of the orthogonal distances, without outliers.

    Centre and radius are in the unit of ``position`` (n, 2).

    Starts from the algebraic fit of Taubin (1991, IEEE Trans. PAMI 13, 1115) and minimises orthogonal distances over
    (direction to the centre, offset along it, curvature), which stay finite as the arc becomes straight (Chernov 2010,
    Circular and Linear Regression, section 3.1 and 5.9). Samples more than five standard deviations off are rejected,
    in rounds.

    Parameters
    ----------
    position
        (n, 2): x, z.
    sigma
        Standard error of a coordinate, the lower limit of the scatter.
    radius, radius_stderr
        A known radius with its standard error: then only the centre is fitted.

    Raises
    ------
    DataError
        With fewer than five positions; when the arc is too small for its noise to fix the centre; or when it bends
        downwards.
    """
    if len(position) < 5:
        raise DataError(f"an arc needs at least 5 positions, not {len(position)}")
    anchor = position[np.argmin(np.sum((position - position.mean(axis=0)) ** 2, axis=1))]
    size = float(np.sqrt(np.mean((position - anchor) ** 2)))
    if size <= 3 * sigma or size == 0:
        raise DataError(f"the body moves by {size:.3g} only, with a noise of {sigma:.3g}: no arc can be seen")
    scaled = (position - anchor) / size
    curvature = None if radius is None else size / radius
    belongs = np.ones(len(position), dtype=np.bool_)
    start = _taubin(scaled)
    for turn in range(TURNS):
        start = _least_squares(scaled[belongs], start, curvature, "linear" if turn else "soft_l1", sigma / size)
        off = _distances(start, scaled)
        scatter = max(NORMAL_MAD * float(np.median(np.abs(off[belongs]))), sigma / size)
        now = np.abs(off) < OUTLYING * max(scatter, 1e-12)
        if turn and np.array_equal(now, belongs):
            break
        belongs = now
    circle = _circle(start, scaled, belongs, curvature is None, anchor, size)
    if radius is None:
        return circle
    shift = radius_stderr * np.array([np.cos(start[0]), np.sin(start[0]), 1.0])
    return replace(circle, covariance=circle.covariance + np.outer(shift, shift))


def circle_about(x: Estimate, z: Estimate, position: Array, sigma: float = 0.0) -> Circle:
    """The circle about a known centre: its radius is the median distance of positions (n, 2), in their unit.

    ``sigma`` is the standard error of a coordinate, the lower limit of the scatter.
    """
    away = position - np.array([x.value, z.value])
    distance = np.hypot(*away.T)
    if not np.all(distance > 0):
        raise DataError(f"the body passes through the pivot ({x.value:g}, {z.value:g}); is the pivot right?")
    off = distance - np.median(distance)
    scatter = max(NORMAL_MAD * float(np.median(np.abs(off))), sigma)
    belongs = np.abs(off) <= OUTLYING * scatter
    towards = away[belongs].mean(axis=0) / distance[belongs].mean()  # change of the radius with the centre
    own = np.var(off[belongs]) * inflation(off[belongs]) / belongs.sum()
    covariance = np.diag([x.stderr**2, z.stderr**2, 0.0])
    covariance[:2, 2] = covariance[2, :2] = -towards * np.diag(covariance)[:2]
    covariance[2, 2] = own + towards**2 @ np.diag(covariance)[:2]
    radius = float(distance[belongs].mean())
    return Circle(x.value, z.value, radius, covariance, distance - radius, float(np.std(off[belongs])), belongs)


def circle_of(body: Trajectory, used: Mask, radius: Estimate | None) -> Circle:
    """The circle through the ``used`` samples (n,) of a body, x and z, of a known ``radius`` where there is one."""
    position, noise = body.position[used, :2], noise_of(body, used)
    if radius is None:
        return fit_circle(position, noise)
    return fit_circle(position, noise, radius.value, radius.stderr)


def noise_of(body: Trajectory, used: Mask) -> float:
    """The usual standard error of the ``used`` samples (n,) of a body, in its unit; 0 where none is known."""
    sigma = body.sigma[used, :2]
    return float(np.median(sigma[np.isfinite(sigma)])) if np.isfinite(sigma).any() else 0.0


def angles_about(circle: Circle, body: Trajectory) -> tuple[Array, Array]:
    """The angle of a ``body`` from straight down about the centre of a ``circle``, and its random error across it.

    Both (n,), rad; NaN in gaps.
    """
    across, up = body.position[:, 0] - circle.x, body.position[:, 1] - circle.z
    theta = np.arctan2(across, -up)
    seen = np.flatnonzero(body.valid)
    if np.any(np.abs(theta[seen]) > NEAR_THE_TOP):
        theta[seen] = np.unwrap(theta[seen])
    tangential = np.hypot(body.sigma[:, 0] * np.cos(theta), body.sigma[:, 1] * np.sin(theta))
    return theta, tangential / np.hypot(across, up)


def _taubin(position: Array) -> Array:
    """(direction to the centre, offset, curvature) of Taubin's fit, from the SVD of its design matrix."""
    middle = position.mean(axis=0)
    centred = position - middle
    square = np.sum(centred**2, axis=1)
    mean = square.mean()
    _, _, rows = np.linalg.svd(np.column_stack([(square - mean) / (2 * np.sqrt(mean)), centred]), full_matrices=False)
    a, b, c = rows[2]
    a /= 2 * np.sqrt(mean)
    d = -mean * a
    if a < 0:
        a, b, c, d = -a, -b, -c, -d
    # a |p - middle|² + (b, c)·(p - middle) + d = 0; its gradient at p = 0 points away from the centre
    gradient = np.array([b, c]) - 2 * a * middle
    slope = np.hypot(b, c) if a == 0 else np.sqrt(max(b * b + c * c - 4 * a * d, 0.0))
    curvature = 2 * a / slope
    direction = np.arctan2(-gradient[1], -gradient[0])
    length = np.hypot(*gradient) / slope  # distance to the centre in radii
    offset = (length - 1.0) / curvature if curvature > 1e-9 else 0.0
    return np.array([direction, offset, curvature])


def _distances(shape: Array, position: Array) -> Array:
    """Signed orthogonal distance (n,), positive outside; regular where the curvature is zero."""
    direction, offset, curvature = shape
    normal = np.array([np.cos(direction), np.sin(direction)])
    from_foot = position - offset * normal
    bulge = curvature * np.sum(from_foot**2, axis=1) - 2 * from_foot @ normal
    return np.asarray(bulge / (1.0 + np.sqrt(np.maximum(1.0 + curvature * bulge, 0.0))))


def _least_squares(
    position: Array, start: Array, curvature: float | None, loss: Literal["linear", "soft_l1"], sigma: float
) -> Array:
    """The shape of least squares, or of least soft-L1 deviations, from a start; the curvature may be given."""
    from scipy.optimize import (
        least_squares,  # imported here, because it loads slowly and listing names does not need it
    )

    def distances(shape: Array) -> Array:
        return _distances(shape if curvature is None else np.append(shape, curvature), position)

    soft = max(NORMAL_MAD * float(np.median(np.abs(_distances(start, position)))), sigma, 1e-9)
    free = start if curvature is None else start[:2]
    fitted = least_squares(distances, free, loss=loss, f_scale=soft, xtol=1e-14).x
    return np.asarray(fitted if curvature is None else np.append(fitted, curvature))


def _circle(shape: Array, scaled: Array, belongs: Mask, free: bool, anchor: Array, size: float) -> Circle:
    """The circle in the units of the positions, with the covariance of centre and radius."""
    parameters = 3 if free else 2
    off = _distances(shape, scaled)
    residual = off[belongs]
    jacobian = _jacobian(lambda values: _distances(values, scaled[belongs]), shape)[:, :parameters]
    variance = residual @ residual / max(residual.size - parameters, 1) * inflation(residual)
    spread = variance * np.linalg.inv(jacobian.T @ jacobian)
    if free and shape[2] < DETERMINED * np.sqrt(spread[2, 2]):
        _refuse(shape[2] / size, float(np.sqrt(spread[2, 2])) / size)
    away = (scaled[belongs] - _centre(shape)[:2]) @ np.array([1.0, 1.0j])
    spread = spread + _by_place(np.angle(-away * np.exp(-1j * shape[0])), residual, jacobian)
    if np.sin(shape[0]) < 0:
        raise DataError(
            "the arc bends downwards, its centre lies below it: is it a pendulum, and is down really down in the image?"
        )
    to_centre = _jacobian(_centre, shape)[:, :parameters]
    x, z, radius = _centre(shape) * size + np.append(anchor, 0.0)
    return Circle(
        float(x),
        float(z),
        float(radius),
        size**2 * to_centre @ spread @ to_centre.T,
        off * size,
        size * float(np.sqrt(residual @ residual / max(residual.size - parameters, 1))),
        belongs,
    )


def _by_place(place: Array, residual: Array, jacobian: Array) -> Array:
    """What displacements that belong to the places (n,) along an arc add to the covariance (p, p) of its shape.

    Places are angles in rad; ``residual`` (n,) and ``jacobian`` (n, p) are of the least squares. Mean residuals of
    parts of the arc are a smooth displacement and independent errors of the samples; what the shape itself absorbs of
    either is allowed for.
    """
    part = np.minimum((PLACES * (place - place.min()) / np.ptp(place)).astype(int), PLACES - 1)
    count = np.bincount(part, minlength=PLACES)
    seen = count > 0
    if residual.size <= 2 * seen.sum() or seen.sum() <= 2 * jacobian.shape[1]:
        return np.zeros((jacobian.shape[1],) * 2)

    def mean(values: Array) -> Array:
        return np.bincount(part, values, PLACES)[seen] / count[seen]

    middle, level = mean(place), mean(residual)
    slope = np.column_stack([mean(column) for column in jacobian.T])
    within = residual - np.bincount(part, residual, PLACES)[part] / count[part]
    scatter = float(within @ within) / (residual.size - seen.sum()) * inflation(within)
    apart = (middle[:, None] - middle) / np.ptp(place)
    best, displaced = -np.inf, np.zeros_like(apart)
    for width in WIDTHS:
        smooth = np.exp(-0.5 * (apart / width) ** 2)
        for amount in SIZES:
            covariance = scatter * (amount**2 * smooth + np.diag(1.0 / count[seen]))
            likelihood = _restricted_likelihood(level, slope, covariance) - (amount > 0)
            if likelihood > best:
                best, displaced = likelihood, scatter * amount**2 * smooth
    gain = np.linalg.inv(jacobian.T @ jacobian) @ (slope * count[seen, None]).T
    return np.asarray(gain @ displaced @ gain.T)


def _restricted_likelihood(values: Array, slope: Array, covariance: Array) -> float:
    """Logarithm of the likelihood of what a linear fit leaves of values (n,), without a constant."""
    factor = np.linalg.cholesky(covariance)
    white, columns = np.linalg.solve(factor, values), np.linalg.solve(factor, slope)
    orthogonal, triangle = np.linalg.qr(columns)
    left = white - orthogonal @ (orthogonal.T @ white)
    logarithms = np.log(np.diag(factor)).sum() + np.log(np.abs(np.diag(triangle))).sum()
    return -0.5 * float(left @ left) - float(logarithms)


def _refuse(curvature: float, stderr: float) -> None:
    raise DataError(
        f"the arc is too small to fix the pivot: its curvature is {curvature:.3g} +- {stderr:.3g} (1 / radius); "
        "give the pivot (--mark pivot=X,Y in px) or the radius (--set arc_radius=...)"
    )


def _centre(shape: Array) -> Array:
    """x, z and radius from (direction, offset, curvature)."""
    direction, offset, curvature = shape
    away = offset + 1.0 / curvature
    return np.array([away * np.cos(direction), away * np.sin(direction), 1.0 / curvature])


def _jacobian(function: Callable[[Array], Array], at: Array) -> Array:
    """Central differences of a function of three numbers."""
    columns = []
    for k in range(at.size):
        step = np.zeros(at.size)
        step[k] = 1e-6 * max(abs(at[k]), 1e-3)
        columns.append((function(at + step) - function(at - step)) / (2 * step[k]))
    return np.array(columns).T


@dataclass(frozen=True, eq=False, slots=True)
class Line:
    """A straight line: a point on it, the direction of motion, the angle's standard error, the scatter across it."""

    point: Array
    direction: Array
    angle_stderr: float
    across: Array
    scatter: float


def fit_line(position: Array) -> Line:
    """Fit a straight line to positions (n, 2), px or m, by total least squares; it points from the first to the last.

    The standard error of its angle, rad, is ``scatter / (sqrt(n) sd along)``, enlarged for correlated residuals.
    DataError with fewer than three positions, or when they do not differ.
    """
    if len(position) < 3:
        raise DataError(f"a line needs at least 3 positions, not {len(position)}")
    point = position.mean(axis=0)
    _, length, rows = np.linalg.svd(position - point, full_matrices=False)
    if length[0] == 0:
        raise DataError("the body does not move, so its motion has no direction")
    direction = rows[0] * (np.sign((position[-1] - position[0]) @ rows[0]) or 1.0)
    across = (position - point) @ np.array([-direction[1], direction[0]])
    scatter = float(np.sqrt(across @ across / max(across.size - 2, 1)))
    return Line(point, direction, scatter * math.sqrt(inflation(across)) / float(length[0]), across, scatter)


def inflation(residual: Array) -> float:
    """``(1 + rho) / (1 - rho)``: how much fewer independent values correlated residuals (n,) stand for; at least 1.

    Dimensionless, whatever the unit of the residuals.
    """
    power = float(residual @ residual)
    if residual.size < 3 or power == 0:
        return 1.0
    rho = float(residual[1:] @ residual[:-1]) / power
    rho = float(np.clip(rho, 0.0, 1.0 - 2.0 / residual.size))  # at least one independent value must remain
    return (1.0 + rho) / (1.0 - rho)
