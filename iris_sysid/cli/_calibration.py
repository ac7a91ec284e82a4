"""What ``iris-sysid calibrate`` does with its options, and its files, drawings and text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from matplotlib.figure import Figure

from iris_sysid.calibration.board.calibrate import (
    BoardCalibration,
    BoardPlacement,
    calibrate_board,
    camera_of,
    first_image,
)
from iris_sysid.calibration.calibration_json import calibration_document, read_calibration, write_calibration
from iris_sysid.calibration.plane import check_image_size, local_geometry
from iris_sysid.calibration.resize_crop import cropped_camera, resized_camera
from iris_sysid.calibration.vertical import assumptions, fixed_by_data, with_plumb_line
from iris_sysid.cli import _parsing
from iris_sysid.errors import CalibrationError
from iris_sysid.io.files import write_atomic
from iris_sysid.io.json_documents import document_text
from iris_sysid.report.calibration_figure import camera_figure, grid_figure, view_figure
from iris_sysid.report.page import png_of
from iris_sysid.report.text import with_error

if TYPE_CHECKING:
    from iris_sysid.calibration.camera import CameraCalibration
    from iris_sysid.cli._calibrate_arguments import BoardArguments, CameraArguments
    from iris_sysid.types import Calibration, Progress

MIN_TURN = 1e-6  # rad; below it the world is turned by definition, not by measurement
DRAWINGS = ("camera", "board", "grid")


def calibrated(
    sources: Sequence[Path],
    board: BoardArguments,
    camera: CameraArguments,
    plumb: str | None,
    over: Path | None,
    progress: Progress,
) -> BoardCalibration:
    """Calibrate the plane of motion as the options say; ``over`` is the clip that will be measured, of the same size.

    CalibrationError or DataError when they name no board, cannot be read, or do not fix metres per pixel.
    """
    printed = _parsing.board(board.board, board.square, board.marker, board.dictionary)
    placement, known = _placement(board), _camera(camera)
    ends = None if plumb is None else _parsing.two_points(plumb)
    plane = calibrate_board(
        sources, printed, placement=placement, camera=known, one_image=board.one_image, progress=progress
    )
    calibration, image = plane.calibration, None
    if over is not None:
        image = first_image([over])
        check_image_size(calibration.image_size, (image.shape[1], image.shape[0]))
    if ends is not None:
        calibration = with_plumb_line(calibration, ends[:2], ends[2:])
    return replace(plane, calibration=calibration, over=image)


def _placement(board: BoardArguments) -> BoardPlacement:
    offset = None if board.offset is None else _parsing.length(board.offset, "5cm+-2mm")
    distance = None if board.distance is None else _parsing.length(board.distance, "2m+-1cm")
    return BoardPlacement(
        view=_view_named(board.plane_view),
        offset_m=offset.value if offset else 0.0,
        offset_stderr_m=offset.stderr if offset else 0.0,
        distance_m=distance.value if distance else None,
        distance_stderr_m=distance.stderr if distance else 0.0,
        up=_upward(board.up),
    )


def _view_named(text: str | None) -> int | Path | None:
    if text is None:
        return None
    return int(text) if text.isascii() and text.isdigit() else Path(text)


def _upward(way: str) -> Literal["image", "board"]:
    if way not in ("image", "board"):
        raise CalibrationError(f"--up must be image or board, not {way!r}")
    return "board" if way == "board" else "image"


def _camera(camera: CameraArguments) -> CameraCalibration | None:
    if camera.camera is None:
        return None
    known = camera_of(read_calibration(camera.camera))
    if camera.resized is not None:
        known = resized_camera(known, _parsing.size(camera.resized))
    crop = _parsing.region(camera.cropped)
    return known if crop is None else cropped_camera(known, crop)


def plot_paths(output: Path) -> tuple[Path, ...]:
    """The files that hold the drawings of a calibration written to ``output``."""
    return tuple(output.with_name(f"{output.stem}-{name}.png") for name in DRAWINGS)


def save(plane: BoardCalibration, output: Path, *, plot: bool = False, overwrite: bool = False) -> list[Path]:
    """Write calibration.json and, with ``plot``, drawings beside it: corners, residuals, the grid; their paths."""
    figures = _figures(plane) if plot else {}
    write_calibration(plane.calibration, output, overwrite=overwrite)
    paths = dict(zip(DRAWINGS, plot_paths(output), strict=True))
    for name, figure in figures.items():
        write_atomic(paths[name], png_of(figure), overwrite=overwrite)
    return [paths[name] for name in figures]


def _figures(plane: BoardCalibration) -> dict[str, Figure]:
    figures: dict[str, Figure] = {}
    camera = plane.camera
    if camera is not None and camera.views:
        figures["camera"] = camera_figure(camera)
    if plane.fitted is not None:
        figures["board"] = view_figure(plane.fitted, plane.image)
    figures["grid"] = grid_figure(plane.calibration, plane.image if plane.over is None else plane.over)
    return figures


def text_of(calibration: Calibration, *, json: bool = False) -> str:
    """Doubts, then scale, stretch, shear and turn with their standard errors, what the data fix, assumptions, notes.

    The content of calibration.json instead with ``json``.
    """
    if json:
        return document_text(calibration_document(calibration)).rstrip("\n")
    geometry = local_geometry(calibration, calibration.centre_px)
    stated = {name: value for name, value in geometry.items() if name != "turn_rad" or value.stderr > MIN_TURN}
    shown = {name.removesuffix("_rad"): value for name, value in stated.items()}
    x, y = calibration.centre_px
    rows = [f"{name:<10} {with_error(value)}" for name, value in shown.items()] + [f"at ({x:.0f}, {y:.0f}) px"]
    statements = [f"fixed by the data: {', '.join(fixed_by_data(calibration))}"]
    statements += [f"assumed: {text}" for text in assumptions(calibration)]
    statements += [f"note: {text}" for text in calibration.notes]
    doubts = [f"doubtful: {doubt.text}" for doubt in calibration.doubts]
    return "\n".join([*doubts, calibration.source, *rows, *statements])
