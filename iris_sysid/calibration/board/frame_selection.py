"""Choose the frames of a clip for a camera calibration: sharp, covering the image, without near duplicates."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.calibration.board.board import Board, BoardError, BoardView
from iris_sysid.calibration.board.detect import find_board
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array, Frame, FrameSource, Progress, with_progress

MAX_VIEWS = 20  # of a clip
EXAMINED = 200  # frames, spread evenly over the clip
MIN_DIFFERENCE = 0.02  # fraction of the image's diagonal
SEARCHED_SLOWLY = 4  # frames
SMALL_PX = 480 * 270  # of an image: squares of a few px are seen by the slow search alone, which is quick there
BLURRED_TIMES = 2.0  # the median blur of the sharper half


@dataclass(frozen=True, eq=False, slots=True)
class ChosenFrames:
    """Views chosen from a clip, in order of time, and the number of frames rejected for each reason.

    ``seen_px`` (n_seen, 4, 2) px are the board's outermost corners in every frame that shows it, sharp or not.
    """

    views: tuple[BoardView, ...]
    n_examined: int
    n_seen: int
    n_alike: int
    n_blurred: int
    seen_px: Array

    @property
    def summary(self) -> str:
        """One sentence for a user."""
        return (
            f"{len(self.views)} frames chosen of {self.n_examined} examined: the board was found in {self.n_seen}, "
            f"{self.n_blurred} of them were blurred and {self.n_alike} nearly the same as a sharper one"
        )


def choose_frames(video: FrameSource, board: Board, progress: Progress | None = None) -> ChosenFrames:
    """Find the board in frames spread over a clip and choose the most informative ones for the camera.

    Frames whose edges are more than twice as wide as usual are dropped. Of frames in which the board has nearly the
    same position, the sharpest stays. Of the rest, each next view is the one whose outline differs most from all
    chosen; views are named ``frame 41 (1.367 s)``. ``progress`` is called with (frames decoded, frames expected).
    Raises CalibrationError when no frame shows the board, with the reason, of a few that were searched more slowly.
    """
    seen: list[BoardView] = []
    n_examined, rejected, some = 0, Counter[str](), []
    for n_examined, frame in enumerate(_spread(video, progress), start=1):
        view = _view_of(frame, board, rejected)
        if view is not None:
            seen.append(view)
        elif not seen and n_examined % (EXAMINED // SEARCHED_SLOWLY) == 1:
            some.append(frame)
    if not seen:
        raise CalibrationError(_why_none(n_examined, rejected, some[:SEARCHED_SLOWLY], board))
    sharp = _sharp(seen)
    outlines = np.array([view.outline_px(board) for view in sharp])
    different = _different(sharp, outlines)
    chosen = _spread_out(outlines[different])
    views = sorted((sharp[different[k]] for k in chosen), key=lambda view: view.t_s or 0.0)
    n_alike = len(sharp) - len(different)
    seen_px = np.array([view.outline_px(board) for view in seen])
    return ChosenFrames(tuple(views), n_examined, len(seen), n_alike, len(seen) - len(sharp), seen_px)


def _spread(video: FrameSource, progress: Progress | None) -> Iterator[Frame]:
    """Every k-th frame, to give about EXAMINED frames; where the length is unknown, k grows along the clip."""
    every = max(1, math.ceil(video.n_expected / EXAMINED))
    taken = 0
    for number, frame in enumerate(with_progress(video.frames(), progress, video.n_expected)):
        if number % every == 0:
            yield frame
            taken += 1
            if not video.n_expected and taken == 2 * EXAMINED:
                every, taken = 2 * every, EXAMINED


def _view_of(frame: Frame, board: Board, rejected: Counter[str]) -> BoardView | None:
    name = f"frame {frame.index} ({frame.t_s:.3f} s)"
    try:
        small = frame.luma.size <= SMALL_PX
        return find_board(frame.luma, board, name=name, thorough=small).named(name, frame.t_s)
    except BoardError as error:
        if error.seen:
            rejected[error.reason] += 1
        return None


def _why_none(n_examined: int, rejected: Counter[str], unseen: Sequence[Frame], board: Board) -> str:
    """Why no frame can be used: the most common reason, or what a slow search of the ``unseen`` frames finds."""
    if not n_examined:
        return "the clip has no frame to look for a board in"
    reasons = [reason for reason, _ in rejected.most_common()]
    nothing_seen: list[str] = []
    for frame in unseen:
        try:
            find_board(frame.luma, board, name=f"frame {frame.index}")
        except BoardError as error:
            (reasons if error.seen else nothing_seen).append(str(error))
    return f"none of {n_examined} frames can be used; {[*reasons, *nothing_seen, 'no board is seen'][0]}"


def _sharp(views: list[BoardView]) -> list[BoardView]:
    """Views that are not much more blurred than the sharper half, sharpest first."""
    ordered = sorted(views, key=lambda view: view.blur_px)
    usual = float(np.median([view.blur_px for view in ordered[: math.ceil(len(ordered) / 2)]]))
    return [view for view in ordered if view.blur_px <= BLURRED_TIMES * usual]


def _different(views: list[BoardView], outlines: Array) -> list[int]:
    """Indices of the views that are not near duplicates of a sharper one."""
    limit_px = MIN_DIFFERENCE * math.hypot(*views[0].image_size)
    kept: list[int] = []
    for k, outline in enumerate(outlines):
        if all(np.abs(outline - outlines[other]).max() >= limit_px for other in kept):
            kept.append(k)
    return kept


def _spread_out(outlines: Array) -> list[int]:
    """Indices of the MAX_VIEWS outlines, of (n, 4, 2), that differ most, from the first on (Gonzalez 1985)."""
    chosen = [0]
    nearest = _differences(outlines, outlines[0])
    while len(chosen) < min(MAX_VIEWS, len(outlines)):
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, _differences(outlines, outlines[chosen[-1]]))
    return chosen


def _differences(outlines: Array, outline: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(np.square(outlines - outline), axis=(1, 2))))
