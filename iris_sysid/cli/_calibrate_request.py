"""What ``iris-sysid calibrate`` is asked, as typed, and what it makes, draws and says."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import Board, board_from_text
from iris_sysid.calibration.board.calibrate import (
    BoardCalibration,
    CameraChoices,
    PlaneBoard,
    calibrate_board,
    camera_of,
    first_picture,
)
from iris_sysid.calibration.calibration_json import calibration_document, read_calibration, write_calibration
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.calibration.known_size import (
    camera_from_field_of_view,
    plane_from_ball,
    plane_from_distance,
    plane_from_size,
)
from iris_sysid.calibration.pixel_scale import scale_sides
from iris_sysid.calibration.plane import check_image_size, local_geometry, with_plumb_line
from iris_sysid.calibration.resize_crop import cropped_camera, resized_camera
from iris_sysid.cli._parsing import numbers, region, size
from iris_sysid.errors import CalibrationError
from iris_sysid.io.csv_read import read_track
from iris_sysid.io.files import write_atomic
from iris_sysid.io.json_documents import document_text
from iris_sysid.report import text as wording
from iris_sysid.report.calibration_figure import camera_figure, grid_figure, view_figure
from iris_sysid.report.page import png_of
from iris_sysid.types import Calibration
from iris_sysid.units import ANGLES, LENGTHS, measured

Progress = Callable[[int, int], None]
Luma = NDArray[np.uint8]
SMALLEST_TURN = 1e-6  # rad; below it the world is turned by definition, not by measurement
DRAWINGS = ("camera", "board", "grid")


@dataclass(frozen=True, slots=True)
class Asked:
    """What a user asks of ``iris-sysid calibrate``, as typed; its help explains each."""

    sources: tuple[Path, ...]
    board: str | None = None
    square: str | None = None
    marker: str = ""
    dictionary: str = "4x4_50"
    plane_view: str | None = None
    offset: str | None = None
    distance: str | None = None
    up: str = "picture"
    plumb: str | None = None
    one_picture: bool = False
    camera: Path | None = None
    resized: str | None = None
    cropped: str | None = None
    lens: str | None = None
    square_pixels: bool = True
    drop_outliers: bool = True
    window: int | None = None
    views: int = 20
    examine: int = 200
    known: str | None = None
    ball: str | None = None
    track: Path | None = None
    edge_px: float = 0.1
    fov: str | None = None
    across: str = "width"
    tilt_error: str = "0deg"
    over: Path | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Made:
    """A ``calibration``, the ``board`` pictures that it comes from, if any, and the ``picture`` to draw it over."""

    calibration: Calibration
    board: BoardCalibration | None
    picture: Luma


def make(asked: Asked, progress: Progress | None = None) -> Made:
    """Calibrate as asked.

    Parameters
    ----------
    asked
        By a board, an object, a ball or a distance.
    progress
        Called with (pictures or frames done, expected).

    Returns
    -------
    Made
        With the vertical by the plumb line, where one is given.

    Raises
    ------
    CalibrationError
        When what is asked does not fix metres per pixel, or does not belong to the clip that will be measured.
    """
    _check_choice(asked)
    found = None if asked.board is None else _by_board(asked, progress)
    picture = found.picture if found else first_picture(asked.sources)
    calibration = found.calibration if found else _without_board(asked, (picture.shape[1], picture.shape[0]))
    if asked.over is not None:
        picture = first_picture([asked.over])
        check_image_size(calibration.image_size, (picture.shape[1], picture.shape[0]))
    ends = numbers(asked.plumb, "x1,y1,x2,y2")
    if ends is not None:
        calibration = with_plumb_line(calibration, (ends[0], ends[1]), (ends[2], ends[3]))
    return Made(calibration, found, picture)


def _check_choice(asked: Asked) -> None:
    ways = {"--board": asked.board, "--object": asked.known, "--ball": asked.ball}
    given = [name for name, value in ways.items() if value is not None]
    if not given and asked.distance is not None and (asked.fov is not None or asked.camera is not None):
        return
    if len(given) != 1:
        raise CalibrationError(
            "give one of --board, --object, --ball, or --distance with --fov or --camera, not "
            f"{' and '.join(given) or 'none of them'}"
        )
    if asked.board is not None and asked.square is None:
        raise CalibrationError("a board needs the side of its squares: --square 25mm, measured on the print")
    if asked.ball is not None and asked.track is None:
        raise CalibrationError("a ball needs its track: --track track.csv, made by iris-sysid track")


def _by_board(asked: Asked, progress: Progress | None) -> BoardCalibration:
    board: Board = board_from_text(asked.board or "", asked.square or "", asked.marker, asked.dictionary)
    offset = (0.0, 0.0) if asked.offset is None else measured(asked.offset, LENGTHS, "5cm+-2mm")
    distance = None if asked.distance is None else measured(asked.distance, LENGTHS, "2m+-1cm")
    place = PlaneBoard(
        view=_view_named(asked.plane_view),
        offset_m=offset[0],
        offset_stderr_m=offset[1],
        distance_m=distance[0] if distance else None,
        distance_stderr_m=distance[1] if distance else 0.0,
        up=cast(Literal["picture", "board"], _one_of(asked.up, ("picture", "board"), "--up")),
    )
    choices = CameraChoices(
        lens=None if asked.lens is None else tuple(filter(None, asked.lens.replace(" ", "").split(","))),
        square_pixels=asked.square_pixels,
        drop_outliers=asked.drop_outliers,
        window_px=asked.window,
        count=asked.views,
        examine=asked.examine,
    )
    camera = _camera(asked)
    return calibrate_board(
        asked.sources,
        board,
        place=place,
        camera=camera,
        one_picture=asked.one_picture,
        choices=choices,
        progress=progress,
    )


def _view_named(text: str | None) -> int | Path | None:
    if text is None:
        return None
    return int(text) if text.isascii() and text.isdigit() else Path(text)


def _one_of(text: str, names: Sequence[str], option: str) -> str:
    if text not in names:
        raise CalibrationError(f"{option} must be {' or '.join(names)}, not {text!r}")
    return text


def _camera(asked: Asked) -> CameraCalibration | None:
    if asked.camera is None:
        return None
    camera = camera_of(read_calibration(asked.camera))
    if asked.resized is not None:
        camera = resized_camera(camera, size(asked.resized))
    crop = region(asked.cropped)
    return camera if crop is None else cropped_camera(camera, crop)


def _without_board(asked: Asked, image_size: tuple[int, int]) -> Calibration:
    if asked.known is not None:
        px, px_stderr, metres, metres_stderr = scale_sides(asked.known)
        return plane_from_size(px, metres, size_px_stderr=px_stderr, size_m_stderr=metres_stderr, image_size=image_size)
    if asked.ball is not None and asked.track is not None:
        radius_m, stderr_m = measured(asked.ball, LENGTHS, "33.5+-0.5mm")
        body = read_track(asked.track)[0]
        radius_px = (
            np.full(len(body.t_s), np.nan) if body.radius_px is None else np.where(body.valid, body.radius_px, np.nan)
        )
        return plane_from_ball(
            radius_px,
            radius_m,
            radius_m_stderr=stderr_m,
            edge_stderr_px=asked.edge_px,
            xy_px=body.xy_px,
            image_size=image_size,
        )
    return _by_distance(asked, image_size)


def _by_distance(asked: Asked, image_size: tuple[int, int]) -> Calibration:
    distance_m, stderr_m = measured(asked.distance or "", LENGTHS, "2m+-1cm")
    tilt = measured(asked.tilt_error, ANGLES, "1deg")[0]
    camera = _camera(asked)
    if camera is None:
        angle, angle_stderr = measured(asked.fov or "", ANGLES, "60deg+-1deg")
        side = cast(
            Literal["width", "height", "diagonal"], _one_of(asked.across, ("width", "height", "diagonal"), "--across")
        )
        camera = camera_from_field_of_view(angle, image_size, angle_stderr_rad=angle_stderr, across=side)
    check_image_size(camera.image_size, image_size)
    return plane_from_distance(camera, distance_m, distance_stderr_m=stderr_m, tilt_stderr_rad=tilt)


# --------------------------------------------------------------------------- files and words


def plot_paths(output: Path) -> tuple[Path, ...]:
    """Where the drawings of a calibration written to ``output`` go."""
    return tuple(output.with_name(f"{output.stem}-{name}.png") for name in DRAWINGS)


def save(made: Made, output: Path, *, plot: bool = False, overwrite: bool = False) -> list[Path]:
    """Write calibration.json and, when asked, its drawings beside it.

    Parameters
    ----------
    made
        What :func:`make` returned.
    output
        The file.
    plot
        Draw corners with their residuals, their coverage, and the world's grid.
    overwrite
        Replace files that exist.

    Returns
    -------
    list of Path
        The drawings.
    """
    figures = _figures(made) if plot else {}
    write_calibration(made.calibration, output, overwrite=overwrite)
    paths = dict(zip(DRAWINGS, plot_paths(output), strict=True))
    for name, figure in figures.items():
        write_atomic(paths[name], png_of(figure), overwrite=overwrite)
    return [paths[name] for name in figures]


def _figures(made: Made) -> dict[str, Figure]:
    figures: dict[str, Figure] = {}
    camera = None if made.board is None else made.board.camera
    if camera is not None and camera.views:
        figures["camera"] = camera_figure(camera)
    if made.board is not None and made.board.fitted is not None:
        figures["board"] = view_figure(made.board.fitted, made.board.picture)
    figures["grid"] = grid_figure(made.calibration, made.picture)
    return figures


def text_of(calibration: Calibration, *, json: bool = False) -> str:
    """What a calibration says, for a terminal.

    Parameters
    ----------
    calibration
        Of the plane.
    json
        As calibration.json instead.

    Returns
    -------
    str
        Scale and its departures with their standard errors, what the data fixed, what is assumed, notes.
    """
    if json:
        return document_text(calibration_document(calibration)).rstrip("\n")
    found = local_geometry(calibration, calibration.centre_px)
    shown = {name: one for name, one in found.items() if name != "turn_rad" or one.stderr > SMALLEST_TURN}
    x, y = calibration.centre_px
    rows = [f"{name:<10} {wording.with_error(one)}" for name, one in shown.items()] + [f"at ({x:.0f}, {y:.0f}) px"]
    parts = [f"fixed by the data: {', '.join(calibration.fixed)}"]
    parts += [f"assumed: {one}" for one in calibration.assumed]
    parts += [f"note: {one}" for one in calibration.notes]
    return "\n".join([calibration.source, *rows, *parts])
