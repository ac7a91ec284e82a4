"""Calibrate the plane of motion from one image of a board held in it, or parallel to it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from iris_sysid.calibration.board.board import Board, BoardView
from iris_sysid.calibration.board.corner_errors import covariance_of_fit, relative_errors, usual_error
from iris_sysid.calibration.bundle_adjustment import Points, matrix_of, pose_of, projected, rotation_of
from iris_sysid.calibration.camera import USUAL_FOCAL, CameraCalibration, rms_of
from iris_sysid.calibration.distortion import distort
from iris_sysid.calibration.homography import (
    apply_homography,
    fit_homography,
    homography_sensitivity,
    slopes_at_zero,
)
from iris_sysid.calibration.pixel_scale import NO_LENS, STRAIGHT_ON
from iris_sysid.calibration.plane import UNKNOWN_SCALE, check_image_size, with_scale
from iris_sysid.calibration.vertical import upright
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array, Calibration

Up = Literal["image", "board"]

LENS_CENTRED = "the lens is centred in the image"
PARALLEL = "the board is parallel to the plane of motion"
BOW_DEVIATIONS = 5.0
GAUSS_NEWTON_STEPS = 30


def plane_from_board(
    view: BoardView,
    board: Board,
    camera: CameraCalibration | None = None,
    *,
    offset_m: float = 0.0,
    offset_stderr_m: float = 0.0,
    distance_m: float | None = None,
    distance_stderr_m: float = 0.0,
    up: Up = "image",
) -> Calibration:
    """Calibrate the plane of motion from one image of a board held in it, or parallel to it.

    With a camera, the board's pose R = [r1 r2 r3], t is fitted, the plane is moved along its normal by the offset, and
    the map from undistorted px to the board's axes is ``(K [r1 r2 t - offset r3])^-1`` (Zhang 2000, eq. 2). Without
    one, the homography is fitted to the corners, with k1 of a lens centred in the image where they show it by five
    standard errors, and an offset changes the scale about the middle of the image by
    ``(distance - offset) / distance``.

    Parameters
    ----------
    view
        View of the board in the image.
    board
        The board, with the standard error of its squares.
    camera
        The camera that took the image and the clip; without it, only what one image shows is corrected.
    offset_m
        Distance of the board behind the plane of motion, away from the camera; negative in front of it.
    offset_stderr_m
        Its standard error.
    distance_m
        From the camera to the board; needed with an offset where no camera is given, not used otherwise.
    distance_stderr_m
        Its standard error.
    up
        ``image``: z runs up in the image at the board's middle. ``board``: along the board's edge nearest to that.

    Returns
    -------
    Calibration
        Origin at the middle of the board's inner corners. Its budget has the parts ``corners``, ``camera``,
        ``square``, ``offset`` and ``distance``.

    Raises
    ------
    CalibrationError
        When the view is of another resolution than the camera, shows too few corners, or an offset cannot be allowed
        for.
    """
    _check_offset(offset_m, offset_stderr_m, distance_m, distance_stderr_m)
    if camera is not None:
        check_image_size(camera.image_size, view.image_size)
        plane = _with_camera(view, board, camera, offset_m, offset_stderr_m)
    elif (offset_m or offset_stderr_m) and distance_m is None:
        raise CalibrationError(
            f"a board {offset_m:g} m off the plane of motion needs the distance from the camera to the board too, or a "
            "calibrated camera"
        )
    else:
        far = math.inf if distance_m is None else distance_m
        plane = _without_camera(view, board, (offset_m, offset_stderr_m), (far, distance_stderr_m))
    return upright(plane, up)


def _check_offset(offset_m: float, offset_stderr_m: float, distance_m: float | None, distance_stderr_m: float) -> None:
    for name, stderr in (("offset", offset_stderr_m), ("distance", distance_stderr_m)):
        if not 0 <= stderr < math.inf:
            raise CalibrationError(f"the standard error of the {name} must be zero or above, not {stderr:g} m")
    if not math.isfinite(offset_m):
        raise CalibrationError(f"the board's offset from the plane of motion must be a length in m, not {offset_m:g}")
    if distance_m is not None and not (math.isfinite(distance_m) and distance_m > max(offset_m, 0)):
        raise CalibrationError(
            f"with the board {distance_m:g} m from the camera and {offset_m:g} m behind the plane of motion, "
            "that plane is not in front of the camera; the distance is from the camera to the board"
        )


# --------------------------------------------------------------------------- with a camera


def _with_camera(
    view: BoardView, board: Board, camera: CameraCalibration, offset_m: float, offset_stderr_m: float
) -> Calibration:
    errors = relative_errors(np.asarray(view.stderr_px))
    points = Points(view.points_m(board), np.asarray(view.corners_px), errors)
    parameters = camera.parameters
    pose = pose_of(parameters, points)
    pixels, by_pose, by_camera = projected(parameters, pose, points.board_m)
    residual = points.seen_px - pixels
    _check_freedom(residual, unknowns=6)
    by_pose, by_camera = by_pose / points.rows[:, None], by_camera / points.rows[:, None]
    inverse = np.linalg.inv(by_pose.T @ by_pose)

    def numbers(change: Array) -> Array:
        """The 18 numbers after a change of pose (6), camera (9), offset and relative size of the squares."""
        changed = parameters + change[6:15]
        behind_m, size = offset_m + change[15], 1 + change[16]
        return np.append(_homography(pose + change[:6], changed, behind_m, size, board.centre_m), changed)

    if not pose[5] - offset_m * rotation_of(pose)[2, 2] > 0:  # of the centre of the plane of motion
        raise CalibrationError(
            f"the board is {np.linalg.norm(pose[3:]):.3g} m away, so a plane {offset_m:g} m in front of it is "
            "behind the camera; the offset is positive where the board is further away than the motion"
        )
    steps = np.concatenate([0.1 * np.sqrt(np.diag(inverse)), 1e-4 * np.abs(parameters[:4]), [1e-4] * 7])
    slopes = slopes_at_zero(numbers, steps)
    # a change of the camera also moves the fitted pose: implicit function of the normal equations
    slopes[:, 6:15] -= slopes[:, :6] @ inverse @ by_pose.T @ by_camera
    corners = covariance_of_fit(by_pose, residual / errors[:, None], points.seen_px, _encoded_error(view))
    distorts = bool(np.any(camera.distortion))
    return with_scale(
        Calibration(
            scale=UNKNOWN_SCALE,
            homography=numbers(np.zeros(17))[:9].reshape(3, 3),
            camera_matrix=camera.camera_matrix,
            distortion=camera.distortion,
            budget={
                "corners": slopes[:, :6] @ corners @ slopes[:, :6].T,
                "camera": slopes[:, 6:15] @ camera.covariance @ slopes[:, 6:15].T,
                "square": _squared(board.square_stderr_m / board.square_m * slopes[:, 16]),
                "offset": _squared(offset_stderr_m * slopes[:, 15]),
            },
            image_size=view.image_size,
            centre_px=_pair(projected(parameters, pose, board.centre_m[None])[0][0]),
            fixed=("scale", "tilt", "distance", "distortion")[: 4 if distorts else 3],
            assumed=(() if distorts else (NO_LENS,)) + ((PARALLEL,) if offset_m else ()),
            rms_px=rms_of(residual),
            source=_source(view, board, offset_m),
        )
    )


def _homography(pose: Array, parameters: Array, behind_m: float, size: float, centre_m: Array) -> Array:
    """Undistorted px to metres, z up along the board, origin at its middle: nine entries, the last 1."""
    axes = rotation_of(pose)
    translation = size * pose[3:] - behind_m * axes[:, 2]
    to_board = np.array([[1, 0, size * centre_m[0]], [0, -1, size * centre_m[1]], [0, 0, 1]])
    to_image = matrix_of(parameters) @ np.column_stack([axes[:, :2], translation]) @ to_board
    homography = np.linalg.inv(to_image)
    return np.asarray(homography / homography[2, 2]).ravel()


# --------------------------------------------------------------------------- without a camera


@dataclass(frozen=True, eq=False, slots=True)
class _OneView:
    """A map of the board to one image: homography to undistorted px, camera matrix, k1, and the residual (n, 2) px.

    ``covariance`` (9, 9) is that of the homography's first eight entries and of k1.
    """

    to_image: Array
    camera_matrix: Array
    k1: float
    residual: Array
    covariance: Array

    @property
    def lens(self) -> bool:
        return self.k1 != 0.0


def _without_camera(
    view: BoardView, board: Board, offset: tuple[float, float], distance: tuple[float, float]
) -> Calibration:
    points = Points(
        (view.points_m(board) - board.centre_m) * [1, -1],
        np.asarray(view.corners_px),
        relative_errors(np.asarray(view.stderr_px)),
    )
    fit = _one_view(points, view.image_size, _encoded_error(view))
    middle = fit.camera_matrix[:2, 2]

    def numbers(change: Array) -> Array:
        """The 18 numbers after a change of nine fitted ones, relative size of the squares, offset and 1/distance."""
        homography = np.linalg.inv(fit.to_image + np.append(change[:8], 0.0).reshape(3, 3))
        nearer = 1 - (offset[0] + change[10]) * (1 / distance[0] + change[11])
        x, z = apply_homography(homography, middle[None])[0]
        shrink = np.array([[nearer, 0, (1 - nearer) * x], [0, nearer, (1 - nearer) * z], [0, 0, 1]])
        homography = np.diag([1 + change[9], 1 + change[9], 1]) @ shrink @ homography
        camera = np.concatenate([np.diag(fit.camera_matrix)[:2], middle, [fit.k1 + change[8], 0, 0, 0, 0]])
        return np.append((homography / homography[2, 2]).ravel(), camera)

    steps = 0.1 * np.sqrt(np.diag(fit.covariance))
    steps[8] = steps[8] or 1e-4
    slopes = slopes_at_zero(numbers, np.append(steps, [1e-4] * 3))
    inverse_stderr = 0.0 if math.isinf(distance[0]) else distance[1] / distance[0] ** 2
    values = numbers(np.zeros(12))
    return with_scale(
        Calibration(
            scale=UNKNOWN_SCALE,
            homography=values[:9].reshape(3, 3),
            camera_matrix=fit.camera_matrix,
            distortion=values[13:],
            budget={
                "corners": slopes[:, :9] @ fit.covariance @ slopes[:, :9].T,
                "square": _squared(board.square_stderr_m / board.square_m * slopes[:, 9]),
                "offset": _squared(offset[1] * slopes[:, 10]),
                "distance": _squared(inverse_stderr * slopes[:, 11]),
            },
            image_size=view.image_size,
            centre_px=_pair(np.mean(view.corners_px, axis=0)),
            fixed=("scale", "tilt", "distortion (one coefficient)")[: 3 if fit.lens else 2],
            assumed=(LENS_CENTRED if fit.lens else NO_LENS,) + ((PARALLEL, STRAIGHT_ON) if offset[0] else ()),
            rms_px=rms_of(fit.residual),
            source=_source(view, board, offset[0]),
        )
    )


def _one_view(points: Points, image_size: tuple[int, int], encoded_px: float | None) -> _OneView:
    """Fit a homography, and k1 of a lens centred in the image where it is significant."""
    focal = USUAL_FOCAL * max(image_size)  # only gives k1 its unit
    camera_matrix = matrix_of(np.array([focal, focal, (image_size[0] - 1) / 2, (image_size[1] - 1) / 2]))
    to_image = fit_homography(points.board_m, points.seen_px, points.errors)[0]
    residual = points.seen_px - apply_homography(to_image, points.board_m)
    _check_freedom(residual, unknowns=9)
    slopes = homography_sensitivity(to_image, points.board_m)[..., :8].reshape(-1, 8)
    plain = _OneView(to_image, camera_matrix, 0.0, residual, _covariance(slopes, residual, points, encoded_px))
    bowed = _with_lens(points, plain, encoded_px)
    return bowed if abs(bowed.k1) > BOW_DEVIATIONS * math.sqrt(bowed.covariance[8, 8]) else plain


def _with_lens(points: Points, start: _OneView, encoded_px: float | None) -> _OneView:
    focal, middle = start.camera_matrix[0, 0], start.camera_matrix[:2, 2]
    params = np.append(start.to_image.ravel()[:8], 0.0)
    for _ in range(GAUSS_NEWTON_STEPS):
        to_image = np.append(params[:8], 1.0).reshape(3, 3)
        flat = (apply_homography(to_image, points.board_m) - middle) / focal
        distorted, by_point, by_lens = distort(flat, np.array([params[8], 0, 0, 0, 0]))
        residual = points.seen_px - distorted * focal - middle
        by_entries = by_point @ homography_sensitivity(to_image, points.board_m)[..., :8]
        slopes = np.concatenate([by_entries, focal * by_lens[..., :1]], axis=2).reshape(-1, 9)
        weighted = slopes / points.rows[:, None]
        size = np.linalg.norm(weighted, axis=0)
        step = np.linalg.lstsq(weighted / size, residual.ravel() / points.rows, rcond=None)[0]
        if np.abs(step).max() < 1e-9:
            break
        params = params + step / size
    covariance = _covariance(slopes, residual, points, encoded_px)
    return _OneView(to_image, start.camera_matrix, float(params[8]), residual, covariance)


def _covariance(slopes: Array, residual: Array, points: Points, encoded_px: float | None) -> Array:
    """Covariance (9, 9) of up to nine fitted numbers, zero for those beyond them."""
    fitted = slopes.shape[1]
    covariance = np.zeros((9, 9))
    covariance[:fitted, :fitted] = covariance_of_fit(
        slopes / points.rows[:, None], residual / points.errors[:, None], points.seen_px, encoded_px
    )
    return covariance


def _check_freedom(residual: Array, unknowns: int) -> None:
    if residual.size - unknowns < 1:
        raise CalibrationError(f"{len(residual)} corners are too few to say how well they fit; show more of the board")


def _encoded_error(view: BoardView) -> float | None:
    """Usual error of the corners in a frame of a clip, px; None for an image."""
    return usual_error(view.stderr_px) if view.t_s is not None else None


def _squared(column: Array) -> Array:
    return np.outer(column, column)


def _pair(point: Array) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _source(view: BoardView, board: Board, offset_m: float) -> str:
    where = "in the plane of motion"
    if offset_m:
        where = f"{abs(offset_m):g} m {'behind' if offset_m > 0 else 'in front of'} the plane of motion"
    return f"{board.label} board of {board.square_m * 1000:g} mm squares {where}, in {view.name}"
