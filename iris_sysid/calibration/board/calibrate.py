"""Calibrate the camera and the plane of motion from images or a clip of a board."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import Board, BoardError, BoardView
from iris_sysid.calibration.board.detect import find_board, find_boards, grey_image
from iris_sysid.calibration.board.frame_selection import choose_frames
from iris_sysid.calibration.board.plane_pose import plane_from_board
from iris_sysid.calibration.board.plane_view import with_plane_view_doubt
from iris_sysid.calibration.board.rest import PlaneView, clearest_at_rest
from iris_sysid.calibration.camera import CameraCalibration, FittedView, calibrate_camera, fitted_view
from iris_sysid.errors import CalibrationError
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.types import Array, Calibration, Frame
from iris_sysid.video.image_sequence import IMAGE_CODECS
from iris_sysid.video.reader import Video, open_video

Progress = Callable[[int, int], None]
Luma = NDArray[np.uint8]
SEARCHED_SLOWLY = 12  # frames before the first in which a quick search finds the board


@dataclass(frozen=True, eq=False, slots=True)
class BoardCalibration:
    """The calibration from images of a board.

    ``calibration`` of the plane of motion; ``camera`` and, in it, the view of the board in the plane, or parallel
    to it (``fitted``); None when one image was all. ``image`` (h, w) uint8 is that view's, ``over`` (h, w) uint8 the
    first of the clip that will be measured, where one is stated.
    """

    calibration: Calibration
    camera: CameraCalibration | None
    fitted: FittedView | None
    image: Luma
    over: Luma | None = None


@dataclass(frozen=True, slots=True)
class BoardPlacement:
    """The position of the board relative to the plane of motion.

    ``view`` is the number of a frame of the clip, or of an image counted from 1, or an image file; None takes the
    first that shows the board. ``offset_m`` is how far the board is behind the plane of motion, ``distance_m`` from the
    camera to the board, both with their standard errors; see
    :func:`~iris_sysid.calibration.board.plane_pose.plane_from_board`.
    """

    view: int | Path | None = None
    offset_m: float = 0.0
    offset_stderr_m: float = 0.0
    distance_m: float | None = None
    distance_stderr_m: float = 0.0
    up: Literal["image", "board"] = "image"


class Views(NamedTuple):
    """The ``views`` of a board, notes on them, and by name the reason why an image has no view (``missing``).

    ``seen_px`` (n, 4, 2), px: outlines of the board in frames spread over a clip; None for images.
    """

    views: tuple[BoardView, ...]
    notes: tuple[str, ...]
    missing: Mapping[str, str]
    seen_px: Array | None = None


@on_one_thread
def calibrate_board(
    sources: Sequence[Path],
    board: Board,
    *,
    placement: BoardPlacement | None = None,
    camera: CameraCalibration | None = None,
    one_image: bool = False,
    progress: Progress | None = None,
) -> BoardCalibration:
    """Calibrate the camera from views of a board, and the plane of motion from the view that lies in it.

    Parameters
    ----------
    sources
        Images, folders of images, or one clip.
    board
        The board that they show.
    placement
        The view in the plane of motion, or its distance from that plane.
    camera
        Camera from an earlier calibration at the same zoom, focus and resolution; then one view is enough.
    one_image
        Calibrate the plane from its view alone, without a camera.
    progress
        Called with (images or frames done, expected).

    Returns
    -------
    BoardCalibration
        Its notes name views that were left out and images without a board; a doubt says where only their order
        tells which view lies in the plane of motion.

    Raises
    ------
    CalibrationError
        When no view can be used, or the views do not fix the camera; the message says what is not determined.
    """
    placement = placement or BoardPlacement()
    clip = _clip_of(sources)
    paths = [] if clip else _images_of(sources)
    view, image, rest = _plane_view(clip, paths, board, placement.view)
    notes: tuple[str, ...] = ()
    views: Views | None = None
    if camera is None and not one_image:
        views = _views(clip, paths, board, progress)
        camera, notes = _camera(views, board)
    plane = plane_from_board(
        view,
        board,
        None if one_image else camera,
        offset_m=placement.offset_m,
        offset_stderr_m=placement.offset_stderr_m,
        distance_m=placement.distance_m,
        distance_stderr_m=placement.distance_stderr_m,
        up=placement.up,
    )
    first = () if placement.view is not None else (f"{view.name}, the first that shows the board, lies in its plane",)
    calibration = replace(plane, assumed=(*plane.assumed, *first), notes=(*plane.notes, *rest, *notes))
    if views is not None and camera is not None and placement.view is None:
        calibration = with_plane_view_doubt(calibration, view, views.views, board, camera, views.seen_px)
    if camera is None or one_image:
        return BoardCalibration(calibration, None, None, image)
    return BoardCalibration(calibration, camera, fitted_view(camera.parameters, view, board), image)


def camera_of(calibration: Calibration) -> CameraCalibration:
    """The camera in a ``calibration`` that was made with one; CalibrationError when it holds none."""
    if calibration.image_size is None or np.array_equal(calibration.camera_matrix, np.eye(3)):
        raise CalibrationError("this calibration holds no camera; make one from several views of a board")
    if "camera" not in calibration.budget:
        raise CalibrationError(
            "this calibration was made from one image, which fixes no camera; make one from several views of a board"
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


# --------------------------------------------------------------------------- images and clips


def first_image(sources: Sequence[Path]) -> Luma:
    """The first frame of the clip, or the first image, in ``sources``, as grey levels (h, w)."""
    clip = _clip_of(sources)
    if clip is None:
        return grey_image(_images_of(sources)[0])
    frame = next(iter(clip.frames()), None)
    if frame is None:
        raise CalibrationError(f"{sources[0]} has no frame")
    return frame.luma.copy()


def _clip_of(sources: Sequence[Path]) -> Video | None:
    clips = [source for source in sources if not source.is_dir() and source.suffix.lower() not in IMAGE_CODECS]
    if not clips:
        return None
    if len(sources) > 1:
        raise CalibrationError(f"give one clip, or images, not {clips[0]} and others together")
    return open_video(clips[0])


def _images_of(sources: Sequence[Path]) -> list[Path]:
    """Image files in the order given, those of a folder by name."""
    images: list[Path] = []
    for source in sources:
        files = (
            sorted(file for file in source.iterdir() if file.suffix.lower() in IMAGE_CODECS)
            if source.is_dir()
            else [source]
        )
        images += files
    if not images:
        raise CalibrationError(f"there is no image in {', '.join(map(str, sources))}; give images or a clip of a board")
    return images


def _views(clip: Video | None, paths: Sequence[Path], board: Board, progress: Progress | None) -> Views:
    if clip is not None:
        chosen = choose_frames(clip, board, progress)
        return Views(chosen.views, (chosen.summary,), {}, chosen.seen_px)
    search = find_boards(paths, board, progress=progress)
    return Views(search.views, tuple(f"no view: {reason}" for reason in search.missing.values()), search.missing)


def _camera(views: Views, board: Board) -> tuple[CameraCalibration, tuple[str, ...]]:
    """The camera from the views, with notes; an error also lists why other images have no view."""
    try:
        camera = calibrate_camera(views.views, board)
    except CalibrationError as error:
        reasons = list(views.missing.values())
        if not reasons:
            raise
        raise CalibrationError(f"{error}; {len(reasons)} other images gave none, e.g. {reasons[0]}") from error
    left_out = (f"{name} was left out: {reason}" for name, reason in camera.left_out.items())
    return camera, (*views.notes, *camera.notes, *left_out)


def _plane_view(clip: Video | None, paths: Sequence[Path], board: Board, requested: int | Path | None) -> PlaneView:
    """The view in the plane of motion, or parallel to it."""
    if isinstance(requested, Path):
        return _view_in(requested, board)
    if clip is not None:
        return clearest_at_rest(clip, *_view_in_clip(clip, board, requested), board)
    if requested is not None:
        if not 1 <= requested <= len(paths):
            raise CalibrationError(f"there is no image number {requested}; {len(paths)} were given, counted from 1")
        return _view_in(paths[requested - 1], board)
    first_error: CalibrationError | None = None
    for path in paths:
        try:
            return _view_in(path, board)
        except CalibrationError as error:
            first_error = first_error or error
    raise CalibrationError(f"none of {len(paths)} images shows the board; {first_error}")


def _view_in(path: Path, board: Board) -> PlaneView:
    image = grey_image(path)
    return PlaneView(find_board(image, board, name=path.name), image)


def _view_in_clip(clip: Video, board: Board, requested: int | None) -> tuple[BoardView, Frame]:
    """The board in the frame of that number, or in the first that shows it."""
    if requested is None:
        return _first_view(clip, board)
    last: Frame | None = None
    for frame in clip.frames():
        last = frame
        if frame.index >= requested:
            return _in_frame(frame, board), frame
    raise CalibrationError(f"the clip has no frame {requested}; its last is {last.index if last else 'none'}")


def _first_view(clip: Video, board: Board) -> tuple[BoardView, Frame]:
    """The board in the first frame that shows it: found quickly, then looked for slowly in some frames before that."""
    before: list[Frame] = []
    every, last = 1, None
    for frame in clip.frames():
        last = frame
        try:
            view = _in_frame(frame, board, thorough=False)
        except BoardError as error:
            if error.seen:
                raise
            if frame.index % every == 0:
                before.append(replace(frame, luma=frame.luma.copy()))
            if len(before) > SEARCHED_SLOWLY:
                before, every = before[::2], 2 * every
            continue
        return _slowly(before, board) or (view, frame)
    if last is None:
        raise CalibrationError("the clip has no frame to look for a board in")
    return _slowly(before, board) or (_in_frame(last, board), last)  # says why


def _slowly(frames: Sequence[Frame], board: Board) -> tuple[BoardView, Frame] | None:
    """The board in the first of some frames that shows it when every scale is searched; None where none does."""
    for frame in frames:
        with suppress(BoardError):
            return _in_frame(frame, board), frame
    return None


def _in_frame(frame: Frame, board: Board, *, thorough: bool = True) -> BoardView:
    """The board in a frame of a clip, which an encoder compressed: its view has the frame's time."""
    name = f"frame {frame.index} ({frame.t_s:.3f} s)"
    return find_board(frame.luma, board, name=name, thorough=thorough).named(name, frame.t_s)
