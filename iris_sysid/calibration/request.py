"""One request for a calibration of the plane of motion: by a board, an object, a ball, or the camera's distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import Board
from iris_sysid.calibration.board.calibrate import (
    BoardCalibration,
    BoardPlacement,
    CameraOptions,
    calibrate_board,
    first_image,
)
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.calibration.known_size import (
    camera_from_field_of_view,
    plane_from_ball,
    plane_from_distance,
    plane_from_size,
)
from iris_sysid.calibration.plane import check_image_size
from iris_sysid.calibration.vertical import with_plumb_line
from iris_sysid.types import Calibration, Track

Side = Literal["width", "height", "diagonal"]


@dataclass(frozen=True, slots=True)
class ByBoard:
    """By images or a clip of a ``board``; see :func:`~iris_sysid.calibration.board.calibrate.calibrate_board`.

    ``camera`` is one that was calibrated before; ``one_image`` calibrates the plane alone, from its view.
    """

    board: Board
    placement: BoardPlacement = field(default_factory=BoardPlacement)
    camera: CameraCalibration | None = None
    one_image: bool = False
    options: CameraOptions = field(default_factory=CameraOptions)


@dataclass(frozen=True, slots=True)
class BySize:
    """By an object in the plane of motion that is ``size_px`` long in the image and ``size_m`` in truth."""

    size_px: float
    size_m: float
    size_px_stderr: float = 0.0
    size_m_stderr: float = 0.0


@dataclass(frozen=True, slots=True)
class ByBall:
    """By a tracked ball of known radius; ``edge_stderr_px`` is the error of its edge that all frames share."""

    track: Track
    radius_m: float
    radius_m_stderr: float = 0.0
    edge_stderr_px: float = 0.1


@dataclass(frozen=True, slots=True)
class FieldOfView:
    """A camera's field of view ``across`` a side of its image, rad."""

    angle_rad: float
    angle_stderr_rad: float = 0.0
    across: Side = "width"


@dataclass(frozen=True, slots=True)
class ByDistance:
    """By the distance from the camera to the plane of motion, at which it looks straight.

    ``camera`` was calibrated before, or is known by its field of view; ``tilt_stderr_rad`` is the standard error of its
    direction about each axis.
    """

    distance_m: float
    camera: CameraCalibration | FieldOfView
    distance_stderr_m: float = 0.0
    tilt_stderr_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class CalibrationRequest:
    """What to calibrate the plane of motion by.

    ``sources`` are images, folders of images, or one clip. ``plumb_px`` holds two points of a plumb line (x1, y1, x2,
    y2), px, upper end first. ``clip`` is the clip that will be measured: its resolution is checked.
    """

    sources: tuple[Path, ...]
    method: ByBoard | BySize | ByBall | ByDistance
    plumb_px: tuple[float, float, float, float] | None = None
    clip: Path | None = None


@dataclass(frozen=True, eq=False, slots=True)
class CalibratedPlane:
    """The ``calibration``, the views of the ``board`` that it comes from, if any, and an ``image`` (h, w) uint8."""

    calibration: Calibration
    board: BoardCalibration | None
    image: NDArray[np.uint8]


def calibrate_plane(request: CalibrationRequest, progress: Callable[[int, int], None] | None = None) -> CalibratedPlane:
    """Calibrate the plane of motion by the method of the request.

    Parameters
    ----------
    request
        The images, and what is known about them.
    progress
        Called with (images or frames done, expected).

    Returns
    -------
    CalibratedPlane
        With the vertical by the plumb line, where one is given.

    Raises
    ------
    CalibrationError
        When the request does not fix metres per pixel, or does not belong to the clip that will be measured.
    """
    method = request.method
    board = None
    if isinstance(method, ByBoard):
        board = calibrate_board(
            request.sources,
            method.board,
            placement=method.placement,
            camera=method.camera,
            one_image=method.one_image,
            options=method.options,
            progress=progress,
        )
        calibration, image = board.calibration, board.image
    else:
        image = first_image(request.sources)
        calibration = _without_board(method, (image.shape[1], image.shape[0]))
    if request.clip is not None:
        image = first_image([request.clip])
        check_image_size(calibration.image_size, (image.shape[1], image.shape[0]))
    if request.plumb_px is not None:
        calibration = with_plumb_line(calibration, request.plumb_px[:2], request.plumb_px[2:])
    return CalibratedPlane(calibration, board, image)


def _without_board(method: BySize | ByBall | ByDistance, image_size: tuple[int, int]) -> Calibration:
    if isinstance(method, BySize):
        return plane_from_size(
            method.size_px,
            method.size_m,
            size_px_stderr=method.size_px_stderr,
            size_m_stderr=method.size_m_stderr,
            image_size=image_size,
        )
    if isinstance(method, ByBall):
        return plane_from_ball(
            _radius_px(method.track),
            method.radius_m,
            radius_m_stderr=method.radius_m_stderr,
            edge_stderr_px=method.edge_stderr_px,
            xy_px=method.track.xy_px,
            image_size=image_size,
        )
    camera = method.camera
    if isinstance(camera, FieldOfView):
        camera = camera_from_field_of_view(
            camera.angle_rad, image_size, angle_stderr_rad=camera.angle_stderr_rad, across=camera.across
        )
    check_image_size(camera.image_size, image_size)
    return plane_from_distance(
        camera,
        method.distance_m,
        distance_stderr_m=method.distance_stderr_m,
        tilt_stderr_rad=method.tilt_stderr_rad,
    )


def _radius_px(track: Track) -> NDArray[np.float64]:
    """Apparent radius (n,) in each frame, px; NaN in gaps."""
    if track.radius_px is None:
        return np.full(len(track.t_s), np.nan)
    return np.where(track.valid, track.radius_px, np.nan)
