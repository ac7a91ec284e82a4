"""Calibrate the plane of motion without a board: an object of known size, or a known distance and field of view."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from iris_sysid.calibration.bundle_adjustment import matrix_of
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.calibration.pixel_scale import NO_LENS, STRAIGHT_ON, scale
from iris_sysid.calibration.plane import UNKNOWN_SCALE, with_scale
from iris_sysid.errors import CalibrationError
from iris_sysid.types import N_VALUES, Array, Calibration

# 1.4826: MAD to standard deviation of a normal; 1.2533: standard error of a median over that of a mean
MAD_TO_SIGMA, MEDIAN_FACTOR = 1.4826, 1.2533


def plane_from_size(
    size_px: float,
    size_m: float,
    *,
    size_px_stderr: float,
    size_m_stderr: float = 0.0,
    image_size: tuple[int, int] | None = None,
    source: str = "object of known size",
) -> Calibration:
    """Calibrate by one length that is known in the image and in the plane of motion.

    Parameters
    ----------
    size_px, size_m
        The length, px and m.
    size_px_stderr, size_m_stderr
        Their standard errors.
    image_size
        (width, height) of the image, px; None where the length does not come from an image.
    source
        Where the length comes from, in words.

    Returns
    -------
    Calibration
        Fixes the scale only; origin at the centre of pixel (0, 0). Budget: ``length in px``, ``length in m``.

    Raises
    ------
    CalibrationError
        When a length is not positive or not known better than to itself.
    """
    calibration = scale(size_px, size_m, px_stderr=size_px_stderr, metres_stderr=size_m_stderr)
    text = f"{source}: {size_px:.2f} px are {size_m:g} m"
    return replace(calibration, scale=replace(calibration.scale, source=text), image_size=image_size, source=text)


def plane_from_ball(
    radius_px: Array,
    radius_m: float,
    *,
    radius_m_stderr: float = 0.0,
    edge_stderr_px: float = 0.1,
    xy_px: Array | None = None,
    image_size: tuple[int, int] | None = None,
) -> Calibration:
    """Calibrate by a ball of known radius that was tracked: the median of its radius in the image.

    The scatter of the frames gives the median's standard error; the error of the ball's edge is common to all frames
    and does not average out.

    Parameters
    ----------
    radius_px
        Apparent radius (n,) in each frame, px; NaN in gaps.
    radius_m
        True radius, m.
    radius_m_stderr
        Its standard error.
    edge_stderr_px
        Standard error of the position of the ball's edge, common to all frames; 0.1 px in sharp images.
    xy_px
        Positions of the ball (n, 2): a radius that depends on the position is noted.
    image_size
        (width, height) of the image, px.

    Returns
    -------
    Calibration
        As :func:`plane_from_size`, with a note where the apparent radius changes over the image.

    Raises
    ------
    CalibrationError
        When there is no radius, or it is known no better than to itself.
    """
    radius_px = np.asarray(radius_px, dtype=np.float64)
    seen = np.isfinite(radius_px)
    if seen.sum() < 3:
        raise CalibrationError(
            f"the ball's radius was measured in {int(seen.sum())} frames, 3 are needed; use a tracker that gives "
            "radius_px, or another way to calibrate"
        )
    middle = float(np.median(radius_px[seen]))
    spread = MAD_TO_SIGMA * float(np.median(np.abs(radius_px[seen] - middle)))
    stderr = math.hypot(MEDIAN_FACTOR * spread / math.sqrt(seen.sum()), edge_stderr_px)
    plane = plane_from_size(
        middle,
        radius_m,
        size_px_stderr=stderr,
        size_m_stderr=radius_m_stderr,
        image_size=image_size,
        source=f"ball, median radius of {int(seen.sum())} frames",
    )
    note = "" if xy_px is None else _growth_note(radius_px, np.asarray(xy_px, dtype=np.float64), middle)
    return replace(plane, notes=(note,) if note else ())


def _growth_note(radius_px: Array, xy_px: Array, middle: float) -> str:
    """A note where the radius depends on the position by more than chance and by more than 1 %."""
    known = np.isfinite(radius_px) & np.isfinite(xy_px).all(axis=1)
    if known.sum() < 8:
        return ""
    positions = xy_px[known] - xy_px[known].mean(axis=0)
    slopes, *_ = np.linalg.lstsq(positions, radius_px[known] - radius_px[known].mean(), rcond=None)
    residual = radius_px[known] - radius_px[known].mean() - positions @ slopes
    change = float(np.ptp(positions @ slopes))
    if change < 0.01 * middle or change < 5 * float(np.std(residual)) / math.sqrt(known.sum()):
        return ""
    return (
        f"the ball looks {100 * change / middle:.1f} % larger at one end of its path than at the other: it moves "
        "towards the camera, or the camera is tilted; hold a board in the plane of motion to correct for that"
    )


def camera_from_field_of_view(
    angle_rad: float,
    image_size: tuple[int, int],
    *,
    angle_stderr_rad: float = 0.0,
    across: Literal["width", "height", "diagonal"] = "width",
    centre_stderr: float = 0.01,
) -> CameraCalibration:
    """A camera by its field of view as the maker states it: ``f = side / (2 tan(angle / 2))``.

    Parameters
    ----------
    angle_rad
        Field of view, rad.
    image_size
        (width, height) of the clip, px: the whole field, not a crop.
    angle_stderr_rad
        Its standard error.
    across
        What the angle is measured across.
    centre_stderr
        Standard error of the principal point about the middle of the image, of its longer side.

    Returns
    -------
    CameraCalibration
        Without distortion; nothing in it was fitted.

    Raises
    ------
    CalibrationError
        When the angle is not between 0 and 180 degrees.
    """
    if not 0 < angle_rad < math.pi or not 0 <= angle_stderr_rad < angle_rad:
        raise CalibrationError(
            f"a field of view is between 0 and 180 degrees and known better than to itself, not "
            f"{math.degrees(angle_rad):g} ± {math.degrees(angle_stderr_rad):g} degrees"
        )
    width, height = image_size
    side = {"width": width, "height": height, "diagonal": math.hypot(width, height)}[across]
    focal = side / 2 / math.tan(angle_rad / 2)
    covariance = np.zeros((9, 9))
    # d f / d angle = -side / (4 sin^2(angle / 2))
    covariance[:2, :2] = (angle_stderr_rad * side / (4 * math.sin(angle_rad / 2) ** 2)) ** 2
    covariance[2, 2] = covariance[3, 3] = (centre_stderr * max(image_size)) ** 2
    return CameraCalibration(
        camera_matrix=matrix_of(np.array([focal, focal, (width - 1) / 2, (height - 1) / 2])),
        distortion=np.zeros(5),
        covariance=covariance,
        image_size=image_size,
        rms_px=math.nan,
        noise_px=math.nan,
        fitted=(),
        source=f"field of view {math.degrees(angle_rad):g} degrees across the {across}",
    )


def plane_from_distance(
    camera: CameraCalibration, distance_m: float, *, distance_stderr_m: float, tilt_stderr_rad: float = 0.0
) -> Calibration:
    """Calibrate by the distance from the camera to the plane of motion, which it looks at straight on.

    ``x = distance (u - cx) / fx`` and ``z = -distance (v - cy) / fy`` for undistorted pixels (u, v).

    Parameters
    ----------
    camera
        Calibrated by a board, or by :func:`camera_from_field_of_view`.
    distance_m
        From the camera's lens to the plane of motion, m.
    distance_stderr_m
        Its standard error.
    tilt_stderr_rad
        How well the camera looks straight at the plane: standard error about each axis.

    Returns
    -------
    Calibration
        Origin where the line of sight meets the plane. Budget: ``distance``, ``camera``, ``tilt``.

    Raises
    ------
    CalibrationError
        When the distance is not positive, or not known better than to itself.
    """
    if not (math.isfinite(distance_m) and distance_m > 0 and 0 <= distance_stderr_m < distance_m):
        raise CalibrationError(
            f"the distance must be above zero and larger than its error, not {distance_m:g} ± {distance_stderr_m:g} m"
        )
    if not 0 <= tilt_stderr_rad < 1:
        raise CalibrationError(f"the tilt's standard error must be below 1 rad, not {tilt_stderr_rad:g}")
    fx, fy, cx, cy = camera.parameters[:4]
    homography = np.array([[distance_m / fx, 0, -distance_m * cx / fx], [0, -distance_m / fy, distance_m * cy / fy]])
    homography = np.vstack([homography, [0, 0, 1.0]])
    distorts = bool(np.any(camera.distortion))
    return with_scale(
        Calibration(
            scale=UNKNOWN_SCALE,
            homography=homography,
            camera_matrix=camera.camera_matrix,
            distortion=camera.distortion,
            budget=_distance_budget(camera, homography, distance_m, distance_stderr_m, tilt_stderr_rad),
            image_size=camera.image_size,
            centre_px=(float(cx), float(cy)),
            fixed=("scale",) + (("distortion",) if distorts else ()),
            assumed=(STRAIGHT_ON, *(() if distorts else (NO_LENS,))),
            vertical_source="image",
            source=f"distance {distance_m:g} m; {camera.source}",
        )
    )


def _distance_budget(
    camera: CameraCalibration, homography: Array, distance_m: float, distance_stderr_m: float, tilt_stderr_rad: float
) -> dict[str, Array]:
    fx, fy, cx, cy = camera.parameters[:4]
    by_distance = np.zeros(N_VALUES)
    by_distance[:6] = homography[:2].ravel() / distance_m
    by_camera = np.vstack([np.zeros((9, 9)), np.eye(9)])
    by_camera[:3, 0], by_camera[3:6, 1] = -homography[0] / fx, -homography[1] / fy
    by_camera[2, 2], by_camera[5, 3] = -distance_m / fx, distance_m / fy
    tilt = np.zeros((N_VALUES, N_VALUES))
    for row in (np.array([0, 1 / fy, -cy / fy]), np.array([1 / fx, 0, -cx / fx])):
        turn = np.zeros(N_VALUES)
        turn[6:9] = row  # a small tilt divides by 1 + tilt * (position on the image plane)
        tilt += tilt_stderr_rad**2 * np.outer(turn, turn)
    return {
        "distance": distance_stderr_m**2 * np.outer(by_distance, by_distance),
        "camera": by_camera @ camera.covariance @ by_camera.T,
        "tilt": tilt,
    }
