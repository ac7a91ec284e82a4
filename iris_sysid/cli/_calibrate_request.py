"""The options of ``iris-sysid calibrate`` as the library's typed request."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from iris_sysid.calibration.board.calibrate import BoardPlacement, camera_of
from iris_sysid.calibration.calibration_json import read_calibration
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.calibration.request import CalibrationRequest
from iris_sysid.calibration.resize_crop import cropped_camera, resized_camera
from iris_sysid.cli import _parsing
from iris_sysid.cli._calibrate_arguments import BoardArguments, CameraArguments
from iris_sysid.errors import CalibrationError


def request_of(
    sources: Sequence[Path],
    board: BoardArguments,
    camera: CameraArguments,
    *,
    plumb: str | None = None,
    over: Path | None = None,
) -> CalibrationRequest:
    """Read the options of the command; ``over`` is the clip that will be measured.

    Raises a CalibrationError or DataError when they name no board or cannot be read.
    """
    offset = None if board.offset is None else _parsing.length(board.offset, "5cm+-2mm")
    distance = None if board.distance is None else _parsing.length(board.distance, "2m+-1cm")
    placement = BoardPlacement(
        view=_view_named(board.plane_view),
        offset_m=offset.value if offset else 0.0,
        offset_stderr_m=offset.stderr if offset else 0.0,
        distance_m=distance.value if distance else None,
        distance_stderr_m=distance.stderr if distance else 0.0,
        up=_upward(board.up),
    )
    return CalibrationRequest(
        sources=tuple(sources),
        board=_parsing.board(board.board, board.square, board.marker, board.dictionary),
        placement=placement,
        camera=_camera(camera),
        one_image=board.one_image,
        plumb_px=None if plumb is None else _parsing.two_points(plumb),
        clip=over,
    )


def _view_named(text: str | None) -> int | Path | None:
    if text is None:
        return None
    return int(text) if text.isascii() and text.isdigit() else Path(text)


def _upward(text: str) -> Literal["image", "board"]:
    if text not in ("image", "board"):
        raise CalibrationError(f"--up must be image or board, not {text!r}")
    return "board" if text == "board" else "image"


def _camera(camera: CameraArguments) -> CameraCalibration | None:
    if camera.camera is None:
        return None
    calibrated = camera_of(read_calibration(camera.camera))
    if camera.resized is not None:
        calibrated = resized_camera(calibrated, _parsing.size(camera.resized))
    crop = _parsing.region(camera.cropped)
    return calibrated if crop is None else cropped_camera(calibrated, crop)
