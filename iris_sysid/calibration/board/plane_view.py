"""Whether evidence shows that a view of the board lies in the plane of motion, and what the scale would be if not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from iris_sysid.calibration.board.board import Board, BoardView
from iris_sysid.calibration.board.plane_pose import plane_from_board
from iris_sysid.calibration.camera import CameraCalibration
from iris_sysid.calibration.plane import with_scale
from iris_sysid.types import N_VALUES, Array, Calibration, Doubt

ALIKE = 0.02  # relative difference of scales that the choice of the view may make without a word
STILL = 0.005  # of the image's diagonal: how far a hand that holds the board at one place lets its corners move
LONGER = 2.0  # times the usual: how long the board is held in the plane of motion, against all other places
MIN_FRAMES = 3  # frames


def with_plane_view_doubt(
    plane: Calibration,
    view: BoardView,
    views: Sequence[BoardView],
    board: Board,
    camera: CameraCalibration,
    seen_px: Array | None,
) -> Calibration:
    """The plane with a doubt where only the order says that a view lies in it, and others give other scales.

    A board that is held in the plane of motion for at least twice as long as elsewhere is evidence. Without it, the
    budget of the plane has the part ``plane view``: the root mean square of the relative differences of scale, as any
    of the views may be the one that is meant.

    Parameters
    ----------
    plane
        Calibrated by the view.
    view
        The view that was taken to lie in that plane, as the first.
    views
        Different views of the board, from which the camera was calibrated.
    board
        The board that they show.
    camera
        The camera.
    seen_px
        Outlines (n, 4, 2), px, of the board in frames spread evenly over a clip; None for single images.
    """
    first = plane.scale.value
    others = np.array([plane_from_board(other, board, camera).scale.value for other in views])
    if np.max(np.abs(others / first - 1)) < ALIKE:
        return plane
    if seen_px is not None and _held_longest(view, views, board, seen_px):
        return plane
    low, high = (100 * (float(scale) / first - 1) for scale in (others.min(), others.max()))
    doubt = Doubt(
        "plane-view",
        f"{view.name}, the first that shows the board, was taken to lie in the plane of motion; by the other views "
        f"the scale would differ by {low:+.2g} to {high:+.2g} %",
        "say which view lies in that plane with --plane-view, or hold the board there longer than elsewhere",
    )
    of_size = np.zeros(N_VALUES)
    of_size[:6] = float(np.sqrt(np.mean(np.square(others / first - 1)))) * plane.homography[:2].ravel()
    budget = {**plane.budget, "plane view": np.outer(of_size, of_size)}
    return with_scale(replace(plane, budget=budget, doubts=(*plane.doubts, doubt)))


def _held_longest(view: BoardView, views: Sequence[BoardView], board: Board, seen_px: Array) -> bool:
    limit_px = STILL * math.hypot(*view.image_size)

    def frames_at(outline: Array) -> int:
        return int(np.sum(np.abs(seen_px - outline).max(axis=(1, 2)) < limit_px))

    own = view.outline_px(board)
    outlines = [other.outline_px(board) for other in views]
    elsewhere = [frames_at(outline) for outline in outlines if np.abs(outline - own).max() > limit_px]
    held = frames_at(own)
    return held >= MIN_FRAMES and (not elsewhere or held >= LONGER * float(np.median(elsewhere)))
