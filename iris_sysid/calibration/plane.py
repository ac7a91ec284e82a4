"""Map pixels to metres in the plane of motion and back, with the systematic errors that all samples share."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from iris_sysid.calibration.distortion import distort, undistort_px
from iris_sysid.calibration.homography import apply_homography, homography_sensitivity, homography_slopes
from iris_sysid.errors import CalibrationError
from iris_sysid.types import N_VALUES, Array, Calibration, Estimate

STEP = 1e-2  # fraction of a standard error: the map is linear over such a step
UNKNOWN_SCALE = Estimate(math.nan, math.nan, "px/m")
NEGLIGIBLE = 1e-3  # fraction of the largest pattern of a source: contributes 1e-6 of its variance


def with_scale(calibration: Calibration) -> Calibration:
    """The ``calibration`` with the scale, and its standard error, that it has at its ``centre_px``."""
    return replace(calibration, scale=local_scale(calibration, calibration.centre_px))


def to_plane(calibration: Calibration, xy_px: Array) -> tuple[Array, Array, Array]:
    """Map pixels to the plane of motion, with the derivatives for error propagation.

    The random error of a sample is ``A diag(sigma_px^2) A'`` with A = ``by_px``; the error that samples i and j have in
    common is ``B_i C B_j'`` with B = ``by_calibration`` and C = ``calibration.covariance`` (GUM, 5.2.2).

    Parameters
    ----------
    calibration
        Of the plane.
    xy_px
        Pixels (n, 2), y down, origin at the centre of pixel (0, 0); NaN stays NaN.

    Returns
    -------
    position_m
        (n, 2): x right, z up.
    by_px
        Derivatives (n, 2, 2).
    by_calibration
        Derivatives (n, 2, 18) by ``calibration.values``.

    Raises
    ------
    CalibrationError
        When a pixel lies beyond the lens model or beyond the plane's horizon.
    """
    undistorted, by_px, by_camera = undistort_px(xy_px, calibration.camera_matrix, calibration.distortion)
    homography = calibration.homography
    centre = undistort_px(np.array([calibration.centre_px]), calibration.camera_matrix, calibration.distortion)[0]
    depth, ahead = (points @ homography[2, :2] + homography[2, 2] for points in (undistorted, centre[0]))
    depth = depth * np.sign(ahead)
    if np.any(depth <= 0):
        x, y = xy_px[np.argmax(depth <= 0)]
        raise CalibrationError(
            f"pixel ({x:.1f}, {y:.1f}) lies beyond the horizon of the calibrated plane; does the calibration belong to "
            "this clip and this plane?"
        )
    slopes = homography_slopes(homography, undistorted)
    by_calibration = np.concatenate([homography_sensitivity(homography, undistorted), slopes @ by_camera], axis=2)
    return apply_homography(homography, undistorted), slopes @ by_px, by_calibration


def to_pixels(calibration: Calibration, position_m: Array) -> Array:
    """Pixels (n, 2) at which the camera sees points ``position_m`` (n, 2) of the plane, x right, z up."""
    undistorted = apply_homography(np.asarray(np.linalg.inv(calibration.homography)), position_m)
    matrix = calibration.camera_matrix
    focal, centre = np.diag(matrix)[:2], matrix[:2, 2]
    return distort((undistorted - centre) / focal, calibration.distortion)[0] * focal + centre


def common_errors(calibration: Calibration, xy_px: Array) -> dict[str, Array]:
    """Systematic errors of a calibration as independent changes of its numbers, as far as they matter at some pixels.

    Parameters
    ----------
    calibration
        Of the plane.
    xy_px
        Pixels (n, 2); NaN is ignored.

    Returns
    -------
    dict
        By source of its budget: changes (r, 18) of ``calibration.values`` by one standard error each. To first order
        the covariance of positions is the sum of the outer products of the resulting changes (GUM, 5.2.2).
    """
    seen = xy_px[np.isfinite(xy_px).all(axis=1)]
    sensitivity = to_plane(calibration, seen)[2].reshape(-1, N_VALUES)
    normal = sensitivity.T @ sensitivity
    by_source = {}
    for source, part in calibration.budget.items():
        root = _root(part)
        squares, turns = np.linalg.eigh(root.T @ normal @ root)
        shown = squares > max(NEGLIGIBLE**2 * squares.max(initial=0.0), np.finfo(np.float64).tiny)
        if shown.any():
            by_source[source] = (root @ turns[:, shown]).T[::-1]
    return by_source


def changed(calibration: Calibration, change: Array) -> Calibration:
    """The ``calibration`` with its numbers changed by ``change`` (18,), without a budget.

    The change is in the units of the calibration's values.
    """
    values = calibration.values + change
    fx, fy, cx, cy = values[9:13]
    return replace(
        calibration,
        homography=values[:9].reshape(3, 3),
        camera_matrix=np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]),
        distortion=values[13:],
        budget={},
    )


# --------------------------------------------------------------------------- at one position


def local_scale(calibration: Calibration, at_px: tuple[float, float]) -> Estimate:
    """Pixels a metre at a position ``at_px`` of the image, as the mean of all directions: ``|det A|^(-1/2)``.

    Its standard error is common to all samples; it is ``assumed`` where nothing says how well it is known.
    """
    value, stderr = (float(part[0]) for part in _geometry(calibration, at_px))
    return Estimate(value, stderr, "px/m", "direct" if stderr > 0 else "assumed", calibration.source)


def local_geometry(calibration: Calibration, at_px: tuple[float, float]) -> dict[str, Estimate]:
    """Scale and its distortions at a position ``at_px`` of the image, each with the error common to all samples.

    ``stretch`` is the ratio of the scales along the image's x and y, ``shear_rad`` how far the image's right angle
    is off a right angle in the plane, ``turn_rad`` how far the image's up is turned clockwise from z.
    """
    values, stderrs = _geometry(calibration, at_px)
    names = (("scale", "px/m"), ("stretch", "1"), ("shear_rad", "rad"), ("turn_rad", "rad"))
    return {
        name: Estimate(float(value), float(stderr), unit, "direct" if stderr > 0 else "assumed", calibration.source)
        for (name, unit), value, stderr in zip(names, values, stderrs, strict=True)
    }


def _geometry(calibration: Calibration, at_px: tuple[float, float]) -> tuple[Array, Array]:
    """Scale, stretch, shear and turn (4,) at a position, and their standard errors (4,).

    The errors come from steps along each axis of the calibration's covariance.
    """
    values = calibration.values
    variance = np.zeros(4)
    for direction in _root(calibration.covariance).T:
        step = STEP * direction
        variance += np.square((geometry_of(values + step, at_px) - geometry_of(values - step, at_px)) / (2 * STEP))
    return geometry_of(values, at_px), np.sqrt(variance)


def _root(covariance: Array) -> Array:
    """R (18, r) with R R' = covariance, whose entries may be of very unequal size."""
    size = np.sqrt(np.maximum(np.diag(covariance), 0))
    known = size > 0
    lengths, directions = np.linalg.eigh(covariance[np.ix_(known, known)] / np.outer(size[known], size[known]))
    root = np.zeros((N_VALUES, int(known.sum())))
    root[known] = size[known, None] * directions * np.sqrt(np.maximum(lengths, 0))
    return root


def geometry_of(values: Array, at_px: tuple[float, float]) -> Array:
    """Scale, stretch, shear and turn (4,) at a position ``at_px``, by the 18 ``values`` of a calibration."""
    fx, fy, cx, cy = values[9:13]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    undistorted, by_px, _ = undistort_px(np.array([at_px], dtype=np.float64), matrix, values[13:])
    slopes = homography_slopes(values[:9].reshape(3, 3), undistorted)[0] @ by_px[0]
    (xx, xy), (zx, zy) = slopes
    along_x, along_y = math.atan2(zx, xx), math.atan2(-zy, -xy)
    return np.array(
        [
            abs(xx * zy - xy * zx) ** -0.5,
            math.hypot(xy, zy) / math.hypot(xx, zx),
            math.remainder(along_y - along_x - math.pi / 2, 2 * math.pi),
            math.remainder(math.pi / 2 - along_y, 2 * math.pi),
        ]
    )


def positions_of(values: Array, xy_px: Array) -> Array:
    """Positions (n, 2) in the world, m, of pixels ``xy_px`` (n, 2), by the 18 ``values`` of a calibration."""
    fx, fy, cx, cy = values[9:13]
    undistorted = undistort_px(xy_px, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), values[13:])[0]
    return apply_homography(values[:9].reshape(3, 3), undistorted)


# --------------------------------------------------------------------------- agreement with the clip


def check_image_size(calibrated: tuple[int, int] | None, clip: tuple[int, int]) -> None:
    """Refuse a calibration made at another resolution or crop than the clip's; sizes are (width, height) px.

    ``calibrated`` is None for a calibration that was not made from images. Raises CalibrationError.
    """
    if calibrated is None or tuple(calibrated) == tuple(clip):
        return
    (width, height), (clip_width, clip_height) = calibrated, clip
    sizes = f"the calibration was made from images of {width}x{height} px, the clip is {clip_width}x{clip_height} px"
    if (clip_height, clip_width) == (width, height):
        raise CalibrationError(f"{sizes}: one of them is turned by 90 degrees; calibrate with the camera held alike")
    if abs(clip_width * height - clip_height * width) <= max(width, height, clip_width, clip_height):
        raise CalibrationError(
            f"{sizes}, of the same shape: a camera often uses another part of its sensor at another resolution; "
            f"calibrate at {clip_width}x{clip_height} px, or, if the images were only resized, calibrate with "
            f"--camera and --resized {clip_width}x{clip_height}"
        )
    raise CalibrationError(
        f"{sizes}, of another shape: the images were cropped; calibrate at {clip_width}x{clip_height} px, or, where "
        "the position of the crop is known, with --camera and --cropped x,y,w,h"
    )
