"""A checkerboard in front of the camera of a scene, for calibration, with the exact position of every corner."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation, Slerp

from iris_sysid.io.files import json_text, write_atomic
from iris_sysid.synthetic.camera import Camera, CameraView
from iris_sysid.synthetic.clip import check_paths, film
from iris_sysid.synthetic.look import Look
from iris_sysid.synthetic.plan import ClipPlan, Timing, plan_clip
from iris_sysid.synthetic.scene import Stage, Wall
from iris_sysid.synthetic.shapes import Layer, Outline, box
from iris_sysid.synthetic.truth import truth_paths
from iris_sysid.types import Array, Progress

SQUARES = (10, 7)  # across, down: 9 by 6 inner corners
FIELD_SHARE = 0.34  # of the field's width that the board takes up
POSES = 18
HELD_S, MOVED_S = 0.3, 0.2  # s, duration of each pose, and of the move to the next
SIDE_POINTS = 4  # a lens bends the sides of a square
WHITE, BLACK = (212.0, 212.0, 210.0), (22.0, 22.0, 24.0)


@dataclass(frozen=True, eq=False, slots=True)
class DrawnBoard:
    """A moving board: side of its squares (m), times (p,) of its poses, positions (p, 3) m and rotations.

    Axes are the plane of motion's: right, down, away from the camera. At first the board lies in that plane.
    """

    square_m: float
    times_s: Array
    places_m: Array
    turns: Rotation

    def at(self, points_m: Array, t_s: Array) -> Array:
        """Positions (k, v, 3) m, at times (k,), of points (v, 2) m of the board, right and down from its middle."""
        t_s = np.clip(t_s, self.times_s[0], self.times_s[-1])
        turned = Slerp(self.times_s, self.turns)(t_s).as_matrix()
        middle = np.stack([np.interp(t_s, self.times_s, positions_m) for positions_m in self.places_m.T], axis=-1)
        return np.einsum("kij,vj->kvi", turned[..., :2], points_m) + middle[:, np.newaxis]

    def corners(self) -> Array:
        """Inner corners (54, 2) m, row by row from the top left."""
        across, down = ((np.arange(1, n) - n / 2) * self.square_m for n in SQUARES)
        return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


def board_for(camera: Camera, seed: int) -> DrawnBoard:
    """A board of round size that fits the camera's field, and poses that cover the field at many angles."""
    width, height = (side / camera.pixels_per_metre for side in camera.size)
    square = _round_size(min(FIELD_SHARE * width / SQUARES[0], 0.6 * height / SQUARES[1]))
    rng = np.random.default_rng([seed, 11])
    across, down = np.meshgrid(np.linspace(-0.27, 0.27, 4), np.linspace(-0.19, 0.19, 4))
    spots = rng.permutation(np.stack([across.ravel() * width, down.ravel() * height], axis=-1))[: POSES - 2]
    nearer = -camera.distance_m * rng.uniform(0.0, 0.3, (len(spots), 1))
    tilts = rng.uniform(-1, 1, (len(spots), 3)) * np.radians([35, 35, 20])
    start = np.zeros((2, 3))  # lies in the plane of motion, and rests there for a while
    places = np.concatenate([start, np.hstack([spots * (1 + nearer / camera.distance_m), nearer])])
    turns = Rotation.from_rotvec(np.concatenate([start, tilts]))
    every = HELD_S + MOVED_S
    times = np.concatenate([[every * k, every * k + HELD_S] for k in range(len(places))])
    return DrawnBoard(square, times, np.repeat(places, 2, axis=0), turns[np.repeat(np.arange(len(places)), 2)])


def render_checkerboard(
    phenomenon: str,
    path: str | Path,
    *,
    setting: str | None = None,
    size: tuple[int, int] = (1280, 720),
    fps: float = 60.0,
    seed: int = 0,
    look: Look | None = None,
    progress: Progress | None = None,
    overwrite: bool = False,
) -> tuple[float, pd.DataFrame]:
    """Render a checkerboard clip by the camera that films a phenomenon; 9 x 6 inner corners, first in its plane.

    Beside the clip go .truth.json (camera, board) and .truth.csv (every corner in every frame).

    Parameters
    ----------
    phenomenon, setting
        Scene and setting whose camera films the board.
    path
        The clip.
    size, fps, seed, look
        As for :func:`render_clip`.
    progress
        Called with (frames done, frames in all).
    overwrite
        Replace a clip that is there.

    Returns
    -------
    square_m : float
        Side of a square, m.
    corners : DataFrame
        ``frame``, ``t_s``, ``corner`` (row by row from the top left), ``x_px``, ``y_px``.
    """
    clip = check_paths(path, overwrite=overwrite)
    length = POSES * (HELD_S + MOVED_S)
    plan = plan_clip(phenomenon, setting=setting, size=size, fps=fps, duration_s=length, seed=seed, look=look)
    board = board_for(plan.camera, seed)
    corners = _corner_table(board, plan)
    filmed = ClipPlan(_stage(board, plan), plan.camera, plan.look, plan.timing, plan.shift_px, 0.0, seed, plan.truth)
    truth_path, table, _ = truth_paths(clip)
    with film(clip, filmed, progress, overwrite=overwrite):
        write_atomic(table, corners.to_csv(index=False, lineterminator="\n"), overwrite=True)
        write_atomic(truth_path, json_text(_known_to_a_user(clip.name, board, plan)), overwrite=True)
    return board.square_m, corners


def _known_to_a_user(clip: str, board: DrawnBoard, plan: ClipPlan) -> dict[str, Any]:
    described: Mapping[str, Any] = {
        "squares": list(SQUARES),
        "inner_corners": [SQUARES[0] - 1, SQUARES[1] - 1],
        "square_m": board.square_m,
        "in_plane_until_s": float(board.times_s[3]),
    }
    return {"schema": 1, "clip": clip, "board": described, "camera": plan.truth.camera, "look": asdict(plan.look)}


def _corner_table(board: DrawnBoard, plan: ClipPlan) -> pd.DataFrame:
    timing: Timing = plan.timing
    seen = plan.camera.project_space(board.at(board.corners(), timing.true_s)) + plan.shift_px[:, np.newaxis]
    frames, count = seen.shape[:2]
    return pd.DataFrame(
        {
            "frame": np.repeat(np.arange(frames), count),
            "t_s": np.repeat(timing.file_s, count),
            "corner": np.tile(np.arange(count), frames),
            "x_px": seen[..., 0].ravel(),
            "y_px": seen[..., 1].ravel(),
        }
    )


def _stage(board: DrawnBoard, plan: ClipPlan) -> Stage:
    width, height = ((n + 1.2) * board.square_m for n in SQUARES)
    sheet = [box(0.0, 0.0, width, height)]
    columns, rows = ((np.arange(n) - (n - 1) / 2) * board.square_m for n in SQUARES)
    dark = [(i, j) for i in range(SQUARES[0]) for j in range(SQUARES[1]) if (i + j) % 2 == 0]
    black = [box(columns[i], rows[j], board.square_m, board.square_m) for i, j in dark]
    layers = (
        Layer(_seen(board, plan.camera, sheet), WHITE),
        # the squares share the layer's weight, so that their sum is the weight of one shape
        Layer(_seen(board, plan.camera, black), BLACK, opacity=float(len(black))),
    )
    bare: CameraView = plan.stage.view
    return Stage(bare, Wall(plan.stage.wall.colour), (), layers, (), {}, plan.stage.phase)


def _seen(board: DrawnBoard, camera: Camera, tiles: list[Array]) -> Outline:
    """Outlines of tiles of the board, projected from the camera onto the plane of motion."""
    points = np.concatenate([_divided(tile) for tile in tiles])

    def outline(t_s: Array, scale: float) -> Array:
        del scale
        space = board.at(points, t_s)
        eye = camera.rotation().T @ np.array([0.0, 0.0, -camera.distance_m])
        reach = eye[2] / (eye[2] - space[..., 2:])
        plane = eye[:2] + reach * (space[..., :2] - eye[:2])
        shown = np.array(camera.aim_m) + plane * np.array([1.0, -1.0])
        return np.concatenate(np.split(shown, len(tiles), axis=1))

    return outline


def _divided(tile: Array) -> Array:
    """The sides of a polygon (v, 2), each divided into four."""
    share = np.linspace(0, 1, SIDE_POINTS, endpoint=False)[:, np.newaxis]
    return np.concatenate([a + share * (b - a) for a, b in zip(tile, np.roll(tile, -1, axis=0), strict=True)])


def _round_size(metres: float) -> float:
    """The next smaller number with one or two digits, as boards are made: 25 mm, 38 mm, 4 mm."""
    unit = 10.0 ** (math.floor(math.log10(metres)) - 1)
    return round(math.floor(metres / unit) * unit, 9)
