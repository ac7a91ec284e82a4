"""One request for a calibration of the plane of motion by a board, and a check that it belongs to a clip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

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


def calibrate_plane(
    request: CalibrationRequest, progress: Callable[[int, int], None] | None = None
) -> BoardCalibration:
    """Calibrate the plane of motion as requested, with the vertical by the plumb line where one is given.

    ``progress`` is called with (images or frames done, expected). Raises CalibrationError where the request does not
    fix metres per pixel, or does not belong to the clip that will be measured.
    """
    board = calibrate_board(
        request.sources,
        request.board,
        placement=request.placement,
        camera=request.camera,
        one_image=request.one_image,
        progress=progress,
    )
    calibration, over = board.calibration, None
    if request.clip is not None:
        over = first_image([request.clip])
        check_image_size(calibration.image_size, (over.shape[1], over.shape[0]))
    if request.plumb_px is not None:
        calibration = with_plumb_line(calibration, request.plumb_px[:2], request.plumb_px[2:])
    return replace(board, calibration=calibration, over=over)
