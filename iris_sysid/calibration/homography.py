"""Maps from plane to plane: apply one, its slopes, and the one nearest to measured points with its covariance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array

STEPS = 20


def apply_homography(homography: Array, points: Array) -> Array:
    """Map points (n, 2) by ``(u, v, w) = H (x, y, 1)`` to ``(u/w, v/w)`` (Hartley and Zisserman 2004, eq. 2.5).

    Each plane has its own unit, px or m; the homography (3, 3) takes one to the other.
    """
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return mapped[:, :2] / mapped[:, 2:]


def homography_slopes(homography: Array, points: Array) -> Array:
    """Derivatives (n, 2, 2) of the mapped points by the points (n, 2); the map is that of ``homography``.

    In the unit of the image of the map per unit of its source.
    """
    mapped = points @ homography[:, :2].T + homography[:, 2]
    flat = mapped[:, :2] / mapped[:, 2:]
    return (homography[None, :2, :2] - flat[:, :, None] * homography[None, 2:, :2]) / mapped[:, 2, None, None]


def homography_sensitivity(homography: Array, points: Array) -> Array:
    """Derivatives (n, 2, 9) of the mapped ``points`` by the nine entries of the homography, row by row.

    In the unit of the mapped points per unit of each entry.
    """
    ones = np.column_stack([points, np.ones(len(points))])
    mapped = ones @ homography.T
    flat = mapped[:, :2] / mapped[:, 2:]
    out = np.zeros((len(points), 2, 9))
    out[:, 0, :3] = out[:, 1, 3:6] = ones
    out[:, :, 6:] = -flat[:, :, None] * ones[:, None, :]
    return out / mapped[:, 2, None, None]


def slopes_at_zero(function: Callable[[Array], Array], steps: Array) -> Array:
    """Derivatives (m, k) of a function of k numbers, at zero, by central differences with ``steps`` (k,).

    In the unit of each of the m results per unit of each number.
    """
    columns = [(function(step) - function(-step)) / (2 * step.max()) for step in np.diag(steps)]
    return np.column_stack(columns)


def fit_homography(source: Array, target: Array, errors: Array | None = None) -> tuple[Array, Array]:
    """Fit the homography that takes points to measured points, with least squares in the measured ones.

    Each plane has its own unit, px or m.

    Starts from the normalised direct linear transformation and goes on by Gauss-Newton steps (Hartley and Zisserman
    2004, algorithms 4.2 and 4.3).

    Parameters
    ----------
    source
        Points (n, 2) without error.
    target
        The same points as measured (n, 2), n at least 4.
    errors
        (n,) of the measured points, relative to one another; None where all are alike.

    Returns
    -------
    homography
        (3, 3) with its last entry 1.
    covariance
        (9, 9) of its entries, row by row, for measured points whose coordinates have the variance 1, or
        these errors squared.

    Raises
    ------
    CalibrationError
        When the points lie on a line, or are fewer than four.
    """
    if len(source) < 4:
        raise CalibrationError(f"a plane needs at least 4 points, not {len(source)}; show more of the board")
    rows = np.repeat(np.ones(len(source)) if errors is None else errors, 2)
    into, out = _normaliser(source), _normaliser(target)
    normal_source, normal_target = apply_homography(into, source), apply_homography(out, target)
    normal = _direct_linear(normal_source, normal_target)
    for _ in range(STEPS):
        slopes = homography_sensitivity(normal, normal_source)[..., :8].reshape(-1, 8)
        residual = (normal_target - apply_homography(normal, normal_source)).ravel()
        step = np.linalg.lstsq(slopes / rows[:, None], residual / rows, rcond=None)[0]
        normal = normal + np.append(step, 0.0).reshape(3, 3)
        if np.abs(step).max() < 1e-12:
            break
    homography = np.linalg.inv(out) @ normal @ into
    homography = homography / homography[2, 2]
    slopes = homography_sensitivity(homography, source)[..., :8].reshape(-1, 8)
    return homography, _covariance(slopes / rows[:, None])


def _normaliser(points: Array) -> Array:
    """Similarity that puts the centre of the points at 0 and their mean distance from it at sqrt(2)."""
    centre = points.mean(axis=0)
    spread = float(np.linalg.norm(points - centre, axis=1).mean())
    if not spread > 0:
        raise CalibrationError("the points of the board all lie at one position; mark them again")
    scale = np.sqrt(2) / spread
    return np.array([[scale, 0, -scale * centre[0]], [0, scale, -scale * centre[1]], [0, 0, 1]])


def _direct_linear(source: Array, target: Array) -> Array:
    ones = np.column_stack([source, np.ones(len(source))])
    rows = np.zeros((len(source), 2, 9))
    rows[:, 0, :3] = rows[:, 1, 3:6] = ones
    rows[:, :, 6:] = -target[:, :, None] * ones[:, None, :]
    _, singular, directions = np.linalg.svd(rows.reshape(-1, 9), full_matrices=True)
    # 1e-7: points on a line leave a second null direction, singular value 1e-16; real boards are above 1e-3
    if singular[7] < 1e-7 * singular[0]:
        raise CalibrationError("the points of the board lie on a line, so they fix no plane; use a board with rows")
    homography = directions[8].reshape(3, 3)
    return homography / homography[2, 2]


def _covariance(slopes: Array) -> Array:
    size = np.linalg.norm(slopes, axis=0)
    covariance = np.zeros((9, 9))
    covariance[:8, :8] = np.linalg.inv((slopes / size).T @ (slopes / size)) / np.outer(size, size)
    return covariance
