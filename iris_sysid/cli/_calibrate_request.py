"""The options of ``iris-sysid calibrate`` as the library's typed request."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, TypeVar

from iris_sysid.calibration.board.calibrate import BoardPlacement, CameraOptions, camera_of
from iris_sysid.calibration.calibration_json import read_calibration
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.calibration.request import (
    ByBall,
    ByBoard,
    ByDistance,
    BySize,
    CalibrationRequest,
    FieldOfView,
    Side,
)
from iris_sysid.calibration.resize_crop import cropped_camera, resized_camera
from iris_sysid.cli import _parsing
from iris_sysid.cli._calibrate_arguments import BoardArguments, CameraArguments, SizeArguments
from iris_sysid.errors import CalibrationError
from iris_sysid.io.csv_read import read_track
from iris_sysid.units import parse_scale

Name = TypeVar("Name", bound=str)
UPWARD: dict[str, Literal["image", "board"]] = {"image": "image", "picture": "image", "board": "board"}
SIDES: dict[str, Side] = {"width": "width", "height": "height", "diagonal": "diagonal"}


def request_of(
    sources: Sequence[Path],
    board: BoardArguments,
    camera: CameraArguments,
    size: SizeArguments,
    *,
    plumb: str | None = None,
    over: Path | None = None,
) -> CalibrationRequest:
    """Read the options of the command; ``over`` is the clip that will be measured.

    Raises a CalibrationError or DataError when they choose no method, more than one, or cannot be read.
    """
    _check_method(board, camera, size)
    return CalibrationRequest(
        sources=tuple(sources),
        method=_method(board, camera, size),
        plumb_px=None if plumb is None else _parsing.two_points(plumb),
        clip=over,
    )


def _check_method(board: BoardArguments, camera: CameraArguments, size: SizeArguments) -> None:
    methods = {"--board": board.board, "--object": size.known, "--ball": size.ball}
    given = [name for name, value in methods.items() if value is not None]
    if not given and board.distance is not None and (size.fov is not None or camera.camera is not None):
        return
    if len(given) != 1:
        raise CalibrationError(
            "give one of --board, --object, --ball, or --distance with --fov or --camera, not "
            f"{' and '.join(given) or 'none of them'}"
        )
    if size.ball is not None and size.track is None:
        raise CalibrationError("a ball needs its track: --track track.csv, made by iris-sysid track")


def _method(
    board: BoardArguments, camera: CameraArguments, size: SizeArguments
) -> ByBoard | BySize | ByBall | ByDistance:
    if board.board is not None:
        return _by_board(board, camera)
    if size.known is not None:
        px, metres = parse_scale(size.known)
        return BySize(px.value, metres.value, px.stderr, metres.stderr)
    if size.ball is not None and size.track is not None:
        radius = _parsing.length(size.ball, "33.5+-0.5mm")
        return ByBall(read_track(size.track)[0], radius.value, radius.stderr, size.edge)
    distance = _parsing.length(board.distance or "", "2m+-1cm")
    tilt_rad = _parsing.angle(size.tilt_error, "1deg").value
    return ByDistance(distance.value, _camera(camera) or _field_of_view(size), distance.stderr, tilt_rad)


def _by_board(board: BoardArguments, camera: CameraArguments) -> ByBoard:
    offset = None if board.offset is None else _parsing.length(board.offset, "5cm+-2mm")
    distance = None if board.distance is None else _parsing.length(board.distance, "2m+-1cm")
    placement = BoardPlacement(
        view=_view_named(board.plane_view),
        offset_m=offset.value if offset else 0.0,
        offset_stderr_m=offset.stderr if offset else 0.0,
        distance_m=distance.value if distance else None,
        distance_stderr_m=distance.stderr if distance else 0.0,
        up=_choice(board.up, UPWARD, "--up"),
    )
    options = CameraOptions(
        lens=None if camera.lens is None else tuple(filter(None, camera.lens.replace(" ", "").split(","))),
        square_pixels=not camera.free_aspect,
        drop_outliers=not camera.keep_outliers,
        window_px=camera.window,
        count=camera.views,
        examine=max(camera.examine, camera.views),
    )
    stated = _parsing.board(board.board, board.square, board.marker, board.dictionary)
    return ByBoard(stated, placement, _camera(camera), board.one_image, options)


def _view_named(text: str | None) -> int | Path | None:
    if text is None:
        return None
    return int(text) if text.isascii() and text.isdigit() else Path(text)


def _choice(text: str, choices: dict[str, Name], option: str) -> Name:
    if text not in choices:
        raise CalibrationError(f"{option} must be {' or '.join(dict.fromkeys(choices.values()))}, not {text!r}")
    return choices[text]


def _camera(camera: CameraArguments) -> CameraCalibration | None:
    if camera.camera is None:
        return None
    calibrated = camera_of(read_calibration(camera.camera))
    if camera.resized is not None:
        calibrated = resized_camera(calibrated, _parsing.size(camera.resized))
    crop = _parsing.region(camera.cropped)
    return calibrated if crop is None else cropped_camera(calibrated, crop)


def _field_of_view(size: SizeArguments) -> FieldOfView:
    angle = _parsing.angle(size.fov or "")
    return FieldOfView(angle.value, angle.stderr, _choice(size.across, SIDES, "--across"))
