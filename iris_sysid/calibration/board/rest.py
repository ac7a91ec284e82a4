"""A board that rests: the frames of a clip show it ever more truly, as an encoder adds what its key frame left out."""

from __future__ import annotations

from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import Board, BoardView
from iris_sysid.calibration.board.corner_errors import usual_error
from iris_sysid.calibration.board.detect import find_again
from iris_sysid.errors import CalibrationError, VideoError
from iris_sysid.types import Frame
from iris_sysid.video.reader import Video

LOOKS = (1, 2, 4, 8, 16, 32)  # frames after the first
MOVED = 3.0  # standard errors of a corner by its grey levels: an encoder shifts the usual one by up to 2


class PlaneView(NamedTuple):
    """A view of the board, the grey levels (h, w) in which it was measured, and a note where a later frame has them."""

    view: BoardView
    image: NDArray[np.uint8]
    notes: tuple[str, ...] = ()


def clearest_at_rest(clip: Video, view: BoardView, frame: Frame, board: Board) -> PlaneView:
    """The clearest view of a board while it rests, beginning with the frame in which it was found.

    In a key frame an encoder shifts corners by their place in the pixel and in its blocks; over a board that looks like
    another scale. While nothing moves, each frame adds to the picture, and that error falls by a factor of about four.

    Parameters
    ----------
    clip
        The clip.
    view, frame
        Where the board was found.
    board
        What it is.
    """
    best = PlaneView(view, frame.luma.copy())
    try:
        for later in islice(clip.frames_from(frame.index), LOOKS[-1] + 1):
            if later.index - frame.index in LOOKS:
                seen = find_again(later.luma, view, board)
                if _moved(view, seen):
                    break
                if usual_error(seen.stderr_px) < usual_error(best.view.stderr_px):
                    note = f"the board rests: its corners are those of frame {later.index} ({later.t_s:.3f} s)"
                    best = PlaneView(seen, later.luma.copy(), (note,))
    except (CalibrationError, VideoError):
        pass  # it is no longer there, or the file ends in damage that the frames before do not have
    return best


def _moved(view: BoardView, later: BoardView) -> bool:
    _, before, after = np.intersect1d(view.ids, later.ids, assume_unique=True, return_indices=True)
    shift_px = np.asarray(later.corners_px)[after] - np.asarray(view.corners_px)[before]
    return float(np.median(np.abs(shift_px))) > MOVED * usual_error(view.stderr_px)
