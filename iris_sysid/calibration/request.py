"""One request for a calibration of the plane of motion by a board, and a check that it belongs to a clip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import Board
from iris_sysid.calibration.board.calibrate import (
    BoardCalibration,
    BoardPlacement,
    calibrate_board,
    first_image,
)
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.calibration.plane import check_image_size
from iris_sysid.calibration.vertical import with_plumb_line
from iris_sysid.types import Calibration


@dataclass(frozen=True, slots=True)
class CalibrationRequest:
    """What to calibrate the plane of motion by; see :func:`~iris_sysid.calibration.board.calibrate.calibrate_board`.

    ``sources`` are images, folders of images, or one clip of the ``board``. ``camera`` is one that was calibrated
    before; ``one_image`` calibrates the plane alone, from its view. ``plumb_px`` holds two points of a plumb line (x1,
    y1, x2, y2), px, upper end first. ``clip`` is the clip that will be measured: its resolution is checked.
    """

    sources: tuple[Path, ...]
    board: Board
    placement: BoardPlacement = field(default_factory=BoardPlacement)
    camera: CameraCalibration | None = None
    one_image: bool = False
    plumb_px: tuple[float, float, float, float] | None = None
    clip: Path | None = None


@dataclass(frozen=True, eq=False, slots=True)
class CalibratedPlane:
    """The ``calibration``, the views of the ``board`` that it comes from, and an ``image`` (h, w) uint8."""

    calibration: Calibration
    board: BoardCalibration
    image: NDArray[np.uint8]


def calibrate_plane(request: CalibrationRequest, progress: Callable[[int, int], None] | None = None) -> CalibratedPlane:
    """Calibrate the plane of motion as requested.

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
    board = calibrate_board(
        request.sources,
        request.board,
        placement=request.placement,
        camera=request.camera,
        one_image=request.one_image,
        progress=progress,
    )
    calibration, image = board.calibration, board.image
    if request.clip is not None:
        image = first_image([request.clip])
        check_image_size(calibration.image_size, (image.shape[1], image.shape[0]))
    if request.plumb_px is not None:
        calibration = with_plumb_line(calibration, request.plumb_px[:2], request.plumb_px[2:])
    return CalibratedPlane(calibration, board, image)
