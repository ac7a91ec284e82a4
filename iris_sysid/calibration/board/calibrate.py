"""From pictures or a clip of a board to the calibration of the plane of motion, with everything needed to draw it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import Board, BoardView
from iris_sysid.calibration.board.detect import NOT_SEEN, find_board, find_boards, grey_picture
from iris_sysid.calibration.board.frame_selection import choose_frames
from iris_sysid.calibration.board.plane_pose import plane_from_board
from iris_sysid.calibration.camera import CameraCalibration, FittedView, calibrate_camera, fitted_view
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Calibration, Frame
from iris_sysid.video.image_sequence import IMAGE_CODECS
from iris_sysid.video.reader import Video, open_video

Progress = Callable[[int, int], None]
Luma = NDArray[np.uint8]
NO_VIEW = "no view"  # begins the note on a picture that shows no board


@dataclass(frozen=True, eq=False, slots=True)
class BoardCalibration:
    """What pictures of a board gave.

    ``calibration`` of the plane of motion; ``camera`` and, in it, the view of the board in the plane, or parallel
    to it (``fitted``); None when one picture was all. ``picture`` (h, w) is that view's.
    """

    calibration: Calibration
    camera: CameraCalibration | None
    fitted: FittedView | None
    picture: Luma


@dataclass(frozen=True, slots=True)
class PlaneBoard:
    """Where the board is with respect to the plane of motion.

    ``view`` is the number of a frame of the clip, or of a picture counted from 1, or a picture's file; None takes the
    first that shows the board. ``offset_m`` is how far the board is behind the plane of motion, ``distance_m`` from the
    camera to the board, both with their standard errors; see
    :func:`~iris_sysid.calibration.board.plane_pose.plane_from_board`.
    """

    view: int | Path | None = None
    offset_m: float = 0.0
    offset_stderr_m: float = 0.0
    distance_m: float | None = None
    distance_stderr_m: float = 0.0
    up: Literal["picture", "board"] = "picture"


@dataclass(frozen=True, slots=True)
class CameraChoices:
    """How a camera is fitted to views: options of ``calibrate_camera`` and of ``choose_frames``.

    ``count`` frames of a clip are chosen from ``examine``; ``window_px`` takes the classical corner windows.
    """

    lens: tuple[str, ...] | None = None
    square_pixels: bool = True
    drop_outliers: bool = True
    window_px: int | None = None
    count: int = 20
    examine: int = 200


def calibrate_board(
    sources: Sequence[Path],
    board: Board,
    *,
    place: PlaneBoard | None = None,
    camera: CameraCalibration | None = None,
    one_picture: bool = False,
    choices: CameraChoices | None = None,
    progress: Progress | None = None,
) -> BoardCalibration:
    """Calibrate the camera from views of a board, and the plane of motion from the view that lies in it.

    Parameters
    ----------
    sources
        Pictures, folders of pictures, or one clip.
    board
        What they show.
    place
        Which view is in the plane of motion, or how far off it.
    camera
        Known already, from an earlier calibration at the same zoom, focus and resolution; then one view is enough.
    one_picture
        Calibrate the plane without a camera, from its view alone.
    choices
        How the camera is fitted.
    progress
        Called with (pictures or frames done, expected).

    Returns
    -------
    BoardCalibration
        Its notes name views that were left out and pictures without a board.

    Raises
    ------
    CalibrationError
        When no view can be used, or the views do not fix the camera; the message says what is not determined.
    """
    place, choices = place or PlaneBoard(), choices or CameraChoices()
    clip = _clip_of(sources)
    paths = [] if clip else _pictures_of(sources)
    view, picture = _plane_view(clip, paths, board, place.view, choices)
    notes: list[str] = []
    if camera is None and not one_picture:
        views, notes = _views(clip, paths, board, choices, progress)
        camera = _camera(views, board, choices, notes)
        notes += [*camera.notes, *(f"{name} was left out: {why}" for name, why in camera.left_out.items())]
    plane = plane_from_board(view, board, None if one_picture else camera, **_where(place))
    said = (f"{view.name}, the first that shows the board, is its place",) if place.view is None else ()
    calibration = replace(plane, assumed=(*plane.assumed, *said), notes=(*plane.notes, *notes))
    if camera is None or one_picture:
        return BoardCalibration(calibration, None, None, picture)
    return BoardCalibration(calibration, camera, fitted_view(camera.parameters, view, board), picture)


def _where(place: PlaneBoard) -> dict[str, Any]:
    names = ("offset_m", "offset_stderr_m", "distance_m", "distance_stderr_m", "up")
    return {name: getattr(place, name) for name in names}


def camera_of(calibration: Calibration) -> CameraCalibration:
    """The camera in a ``calibration`` that was made with one; CalibrationError when it holds none."""
    if calibration.image_size is None or np.array_equal(calibration.camera_matrix, np.eye(3)):
        raise CalibrationError("this calibration holds no camera; make one from several views of a board")
    if "camera" not in calibration.budget:
        raise CalibrationError(
            "this calibration was made from one picture, which fixes no camera; make one from several views of a board"
        )
    covariance = calibration.budget["camera"][9:, 9:]
    return CameraCalibration(
        camera_matrix=calibration.camera_matrix,
        distortion=calibration.distortion,
        covariance=covariance,
        image_size=calibration.image_size,
        rms_px=math.nan,
        noise_px=math.nan,
        fitted=(),
        source=f"camera of an earlier calibration: {calibration.source}",
    )


# --------------------------------------------------------------------------- pictures and clips


def first_picture(sources: Sequence[Path]) -> Luma:
    """The first frame of the clip, or the first picture, in ``sources``, as grey levels (h, w)."""
    clip = _clip_of(sources)
    if clip is None:
        return grey_picture(_pictures_of(sources)[0])
    frame = next(iter(clip.frames()), None)
    if frame is None:
        raise CalibrationError(f"{sources[0]} has no frame")
    return frame.luma.copy()


def _clip_of(sources: Sequence[Path]) -> Video | None:
    clips = [one for one in sources if not one.is_dir() and one.suffix.lower() not in IMAGE_CODECS]
    if not clips:
        return None
    if len(sources) > 1:
        raise CalibrationError(f"give one clip, or pictures, not {clips[0]} and others together")
    return open_video(clips[0])


def _pictures_of(sources: Sequence[Path]) -> list[Path]:
    """Picture files in the order given, those of a folder by name."""
    found: list[Path] = []
    for source in sources:
        inside = (
            sorted(one for one in source.iterdir() if one.suffix.lower() in IMAGE_CODECS)
            if source.is_dir()
            else [source]
        )
        found += inside
    if not found:
        raise CalibrationError(
            f"there is no picture in {', '.join(map(str, sources))}; give pictures or a clip of a board"
        )
    return found


def _views(
    clip: Video | None, paths: Sequence[Path], board: Board, choices: CameraChoices, progress: Progress | None
) -> tuple[tuple[BoardView, ...], list[str]]:
    """Views, and what to say about those chosen or missing."""
    if clip is not None:
        chosen = choose_frames(clip, board, count=choices.count, examine=choices.examine, progress=progress)
        return chosen.views, [chosen.summary]
    search = find_boards(paths, board, window_px=choices.window_px, progress=progress)
    return search.views, [f"{NO_VIEW}: {why}" for why in search.missing.values()]


def _camera(
    views: Sequence[BoardView], board: Board, choices: CameraChoices, notes: Sequence[str]
) -> CameraCalibration:
    """The camera that the views fix; where they do not, the error says also why other pictures gave no view."""
    try:
        return calibrate_camera(
            views,
            board,
            lens=choices.lens,
            square_pixels=choices.square_pixels,
            drop_outliers=choices.drop_outliers,
        )
    except CalibrationError as error:
        missing = [note.removeprefix(f"{NO_VIEW}: ") for note in notes if note.startswith(NO_VIEW)]
        if not missing:
            raise
        raise CalibrationError(f"{error}; {len(missing)} other pictures gave none, e.g. {missing[0]}") from error


def _plane_view(
    clip: Video | None, paths: Sequence[Path], board: Board, wanted: int | Path | None, choices: CameraChoices
) -> tuple[BoardView, Luma]:
    """The view in the plane of motion, or parallel to it, and its picture."""
    if isinstance(wanted, Path):
        return _view_in(wanted, board, choices)
    if clip is not None:
        return _view_in_clip(clip, board, wanted)
    if wanted is not None:
        if not 1 <= wanted <= len(paths):
            raise CalibrationError(f"there is no picture number {wanted}; {len(paths)} were given, counted from 1")
        return _view_in(paths[wanted - 1], board, choices)
    first_error: CalibrationError | None = None
    for path in paths:
        try:
            return _view_in(path, board, choices)
        except CalibrationError as error:
            first_error = first_error or error
    raise CalibrationError(f"none of {len(paths)} pictures shows the board; {first_error}")


def _view_in(path: Path, board: Board, choices: CameraChoices) -> tuple[BoardView, Luma]:
    picture = grey_picture(path)
    return find_board(picture, board, window_px=choices.window_px, name=path.name), picture


def _view_in_clip(clip: Video, board: Board, wanted: int | None) -> tuple[BoardView, Luma]:
    """The board in the frame of that number, or in the first that shows it."""
    last: Frame | None = None
    for frame in clip.frames():
        last = frame
        if wanted is not None and frame.index < wanted:
            continue
        try:
            name = f"frame {frame.index} ({frame.t_s:.3f} s)"
            return find_board(frame.luma, board, name=name, thorough=wanted is not None), frame.luma.copy()
        except CalibrationError as error:
            if wanted is not None or NOT_SEEN not in str(error):
                raise
    if wanted is not None or last is None:
        raise CalibrationError(f"the clip has no frame {wanted}; its last is {last.index if last else 'none'}")
    find_board(last.luma, board, name=f"frame {last.index}")  # says why
    raise CalibrationError("no frame of the clip shows the board")
