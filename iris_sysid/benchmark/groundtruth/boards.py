"""The calibration of each class of a data set: from the checkerboard that its camera filmed, or a stated scale."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from iris_sysid.calibration.board.board import Board
from iris_sysid.calibration.board.calibrate import calibrate_board as calibrate_by_board
from iris_sysid.calibration.calibration_json import read_calibration, write_calibration
from iris_sysid.calibration.pixel_scale import scale_bar_from_text, scale_from_text
from iris_sysid.errors import CalibrationError, DataError, IrisError, OutputError
from iris_sysid.io.files import json_text, origin_of, sha256_of, write_atomic
from iris_sysid.io.json_documents import plain_origin
from iris_sysid.io.schemas.groundtruth import BoardEntry, MeasuredDocument, ScaleEntry

NAME = "calibration.json"
ORIGIN = "calibration.origin.json"
OTHER_SIZE = 0.01  # share of the side of a square
TRUTH = ".truth.json"
BESIDE = (".json", TRUTH)  # files beside a clip that may hold the size of its board


@dataclass(frozen=True, eq=False, slots=True)
class BoardJob:
    """The clip of the board of one class, to be calibrated by."""

    class_name: str
    path: Path
    board: BoardEntry


def calibrate_board(folder: Path, job: BoardJob) -> str:
    """Calibrate one class below the folder of the measurements; returns the reason of a failure, else empty."""
    try:
        calibrate_class(job.path, job.board, folder / job.class_name)
    except OutputError:
        raise
    except IrisError as error:
        return str(error)
    return ""


def board_of(clip: Path, class_name: str, measured: MeasuredDocument) -> BoardEntry:
    """The board in the ``clip`` of a class: as ``measured`` by hand, else from ``checkerboard.json`` beside it.

    A synthetic clip has ``checkerboard.truth.json`` instead; only the board is read from it. CalibrationError when
    neither gives the board, or a rendered clip has another one.
    """
    stated = measured.board(class_name)
    if stated is not None:
        _check_against_truth(clip, stated)
        return stated
    for path in (clip.with_name(clip.stem + suffix) for suffix in BESIDE):
        if path.is_file():
            return _read_board(path)
    raise CalibrationError(
        f"{clip.name} shows a board of unknown squares; give them under boards in the file for --measured, "
        "or with --board and --square"
    )


def _check_against_truth(clip: Path, stated: BoardEntry) -> None:
    """CalibrationError where a rendered clip's own truth says that its squares are of another size."""
    path = clip.with_name(clip.stem + TRUTH)
    if not path.is_file():
        return
    true = _read_board(path)
    if abs(stated.square_m / true.square_m - 1) > OTHER_SIZE:
        raise CalibrationError(
            f"the squares of {clip.name} are stated to be {1e3 * stated.square_m:.4g} mm wide, but were rendered "
            f"with {1e3 * true.square_m:.4g} mm ({path.name}): state that, or leave --square out"
        )


def _read_board(path: Path) -> BoardEntry:
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))["board"]
        return BoardEntry.model_validate(
            {"inner_corners": tuple(content["inner_corners"]), "square_m": content["square_m"]}
            | ({"stderr_m": content["stderr_m"]} if "stderr_m" in content else {})
        )
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise DataError(
            f'{path.name} should say {{"board": {{"inner_corners": [9, 6], "square_m": 0.025}}}}: {error}'
        ) from error


def scale_class(scale: ScaleEntry, folder: Path) -> Path:
    """Write the calibration of a class by a stated scale into a folder; CalibrationError when it cannot be read.

    The camera is assumed to look straight at the plane.
    """
    bar = "," in scale.scale.partition("=")[0]
    calibration = scale_bar_from_text(scale.scale) if bar else scale_from_text(scale.scale)
    return write_calibration(calibration, folder / NAME, overwrite=True)


def calibrate_class(clip: Path, board: BoardEntry, folder: Path) -> Path:
    """Calibrate by the clip of a board and write ``calibration.json`` into a folder, unless it is up to date; its path.

    The first view that shows the board is taken to be in the plane of motion. CalibrationError or VideoError when the
    clip does not determine metres per pixel.
    """
    path, origin_path = folder / NAME, folder / ORIGIN
    corners = f"{board.inner_corners[0]}x{board.inner_corners[1]}"
    square = f"{board.square_m!r}+-{board.stderr_m!r}m"  # the format of earlier runs, which are kept
    origin = plain_origin(origin_of(clip, {"board": corners, "square": square}))
    if _kept(path, origin_path, origin):
        return path
    shown = Board(*board.inner_corners, board.square_m, board.stderr_m)
    plane = calibrate_by_board([clip], shown)
    write_calibration(plane.calibration, path, overwrite=True)
    write_atomic(origin_path, json_text({**origin, "calibration_sha256": sha256_of(path)}), overwrite=True)
    return path


def _kept(path: Path, origin_path: Path, origin: dict[str, Any]) -> bool:
    """Whether the calibration on disk was made from this clip with these options."""
    try:
        read_calibration(path)
        content = json.loads(origin_path.read_text(encoding="utf-8"))
        return bool(content == {**origin, "calibration_sha256": sha256_of(path)})
    except (IrisError, OSError, ValueError):
        return False
