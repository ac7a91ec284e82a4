"""A camera's lens in formulas: where a pixel would be without distortion, and how that depends on the camera.

The model is Brown's, as OpenCV writes it: five coefficients k1, k2, p1, p2, k3. Positions on the image plane at unit
distance are called normalised.
"""

from __future__ import annotations

import numpy as np

from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array

CAMERA_PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
NEWTON_STEPS = 30


def distort(normalised: Array, distortion: Array) -> tuple[Array, Array, Array]:
    """Move normalised points as the lens does (Brown 1966).

    Points are dimensionless: tangents of the angles from the axis.

    ``x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)``, and y_d likewise with p1 and p2 swapped.

    Parameters
    ----------
    normalised
        Points (n, 2) without distortion.
    distortion
        k1, k2, p1, p2, k3 (5,).

    Returns
    -------
    distorted
        (n, 2).
    by_point
        Derivatives by the points (n, 2, 2).
    by_distortion
        Derivatives by the coefficients (n, 2, 5).
    """
    k1, k2, p1, p2, k3 = distortion
    x, y = normalised.T
    square = x * x + y * y
    radial = 1 + square * (k1 + square * (k2 + square * k3))
    slope = 2 * (k1 + square * (2 * k2 + 3 * k3 * square))
    bent = np.column_stack([2 * p1 * x * y + p2 * (square + 2 * x * x), p1 * (square + 2 * y * y) + 2 * p2 * x * y])
    by_point = np.empty((len(x), 2, 2))
    by_point[:, 0, 0] = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    by_point[:, 1, 1] = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    by_point[:, 0, 1] = by_point[:, 1, 0] = slope * x * y + 2 * p1 * x + 2 * p2 * y
    by_distortion = np.empty((len(x), 2, 5))
    for column, power in ((0, 1), (1, 2), (4, 3)):
        by_distortion[:, :, column] = normalised * square[:, None] ** power
    by_distortion[:, :, 2] = np.column_stack([2 * x * y, square + 2 * y * y])
    by_distortion[:, :, 3] = np.column_stack([square + 2 * x * x, 2 * x * y])
    return normalised * radial[:, None] + bent, by_point, by_distortion


def undistort_px(xy_px: Array, camera_matrix: Array, distortion: Array) -> tuple[Array, Array, Array]:
    """Pixels as a camera with the same matrix and no distortion would have shown them, by Newton's method.

    Parameters
    ----------
    xy_px
        Pixels (n, 2), y down, origin at the centre of pixel (0, 0); NaN stays NaN.
    camera_matrix
        (3, 3): fx, fy, cx, cy in px, no skew.
    distortion
        k1, k2, p1, p2, k3 (5,).

    Returns
    -------
    undistorted_px
        (n, 2).
    by_px
        Derivatives by xy_px (n, 2, 2).
    by_camera
        Derivatives by ``CAMERA_PARAMETERS`` (n, 2, 9).

    Raises
    ------
    CalibrationError
        When a pixel lies where the lens model folds back, so that it has no undistorted position.
    """
    known = np.isfinite(xy_px).all(axis=1)
    if not known.all():
        parts = undistort_px(xy_px[known], camera_matrix, distortion)
        undistorted, by_px, by_camera = (np.full((len(xy_px), *part.shape[1:]), np.nan) for part in parts)
        undistorted[known], by_px[known], by_camera[known] = parts
        return undistorted, by_px, by_camera
    focal, centre = np.diag(camera_matrix)[:2], camera_matrix[:2, 2]
    seen = (xy_px - centre) / focal
    flat = _solve(seen, distortion, xy_px)
    _, by_point, by_distortion = distort(flat, distortion)
    inverse = np.linalg.inv(by_point)
    by_px = focal[:, None] * inverse / focal
    by_camera = np.zeros((len(xy_px), 2, 9))
    for k in range(2):
        by_camera[:, k, k] = flat[:, k]
        by_camera[:, k, 2 + k] = 1.0
    by_camera[:, :, :2] -= by_px * seen[:, None, :]
    by_camera[:, :, 2:4] -= by_px
    by_camera[:, :, 4:] = -focal[:, None] * (inverse @ by_distortion)
    return flat * focal + centre, by_px, by_camera


def _solve(seen: Array, distortion: Array, xy_px: Array) -> Array:
    """Normalised points whose distorted positions are ``seen``."""
    if not np.any(distortion):
        return seen.copy()
    flat = seen.copy()
    for _ in range(NEWTON_STEPS):
        distorted, slopes, _ = distort(flat, distortion)
        flat = flat + np.linalg.solve(_regular(slopes), (seen - distorted)[..., None])[..., 0]
        if not np.any(np.abs(seen - distorted) > 1e-13):
            break
    distorted, slopes, _ = distort(flat, distortion)
    # beyond one fold the map is mirrored (determinant below zero), beyond both it is turned (trace below zero)
    unfolded = (np.linalg.det(slopes) > 0) & (np.trace(slopes, axis1=1, axis2=2) > 0)
    wrong = ~(np.abs(seen - distorted).max(axis=1) < 1e-9) | ~unfolded
    if wrong.any():
        x, y = xy_px[np.argmax(wrong)]
        raise CalibrationError(
            f"the lens model of the calibration does not reach pixel ({x:.1f}, {y:.1f}): its distortion folds back "
            "before; calibrate with views of the board that reach the edges of the image"
        )
    return flat


def _regular(slopes: Array) -> Array:
    """The slopes, with the unit matrix where they cannot be inverted (there the point is refused later)."""
    singular = ~(np.abs(np.linalg.det(slopes)) > 1e-9)
    return np.where(singular[:, None, None], np.eye(2), slopes)
