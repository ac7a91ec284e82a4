"""A calibration board, and the view of it in one image."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.homography import apply_homography, fit_homography
from iris_sysid.errors import CalibrationError, DataError
from iris_sysid.types import Array, frozen_array

BOARD_HELP = "write the inner corners as columns x rows, e.g. 9x6 for a board of 10 x 7 squares"


class BoardError(CalibrationError):
    """An image gives no view of the board.

    ``reason`` is the message without the image's name; ``seen`` is False where no board was detected, and True for a
    part of a board, another board, or one that cannot be measured.
    """

    def __init__(self, image: str, reason: str, *, seen: bool) -> None:
        super().__init__(f"{image}: {reason}")
        self.reason = reason
        self.seen = seen


@dataclass(frozen=True, slots=True)
class Board:
    """A checkerboard of ``columns`` x ``rows`` inner corners (one fewer than squares each way).

    ``square_m`` is the side of a square with its standard error ``square_stderr_m``, both measured on the print.
    With ``marker_m``, the side of a marker, it is a ChArUco board of the ``dictionary`` named, e.g. ``4x4_50``.
    Its own axes: x along a row, y down the columns, origin at the first inner corner.
    """

    columns: int
    rows: int
    square_m: float
    square_stderr_m: float = 0.0
    marker_m: float | None = None
    dictionary: str = "4x4_50"

    def __post_init__(self) -> None:
        if self.columns < 3 or self.rows < 3:
            raise CalibrationError(
                f"a board needs at least 3x3 inner corners, not {self.columns}x{self.rows}; {BOARD_HELP}"
            )
        _check_side("a square's side", self.square_m, self.square_stderr_m)
        if self.marker_m is not None and not 0 < self.marker_m < self.square_m:
            raise CalibrationError(
                f"a marker must be smaller than its square: marker {self.marker_m:g} m, square {self.square_m:g} m"
            )

    @property
    def label(self) -> str:
        """Its size as text, e.g. ``9x6``."""
        return f"{self.columns}x{self.rows}"

    @property
    def points_m(self) -> Array:
        """Its inner corners (columns * rows, 2) in m, row by row."""
        grid = np.mgrid[0 : self.columns, 0 : self.rows].T.reshape(-1, 2)
        return grid * self.square_m

    @property
    def centre_m(self) -> Array:
        """The centre of its inner corners (2,) in m."""
        return np.array([self.columns - 1, self.rows - 1]) * self.square_m / 2

    @property
    def clear_squares(self) -> float:
        """Part of a square next to its edges that no marker covers, with a margin for blur."""
        return 0.5 if self.marker_m is None else 0.7 * (1 - self.marker_m / self.square_m) / 2


def _check_side(name: str, side_m: float, stderr_m: float) -> None:
    if not (math.isfinite(side_m) and side_m > 0):
        raise CalibrationError(f"{name} must be above zero, not {side_m:g} m; measure it on the print, e.g. 25mm")
    if not 0 <= stderr_m < side_m:
        raise CalibrationError(f"{name} is {side_m:g} m with the standard error {stderr_m:g} m, which cannot be")


@dataclass(frozen=True, eq=False, slots=True)
class BoardView:
    """A board as one image shows it.

    ``image_size`` is (width, height) px. ``ids`` (n,) number the inner corners found, row by row of the board;
    ``corners_px`` (n, 2) are their positions, y down, origin at the centre of pixel (0, 0); ``stderr_px`` (n,) the
    standard error of each coordinate by the grey levels' noise, NaN where unknown. ``blur_px`` is the standard
    deviation of the edges' blur (NaN where not measured).
    ``oriented`` says whether the first corner is known to be the board's first: not for a board that looks the same
    turned by 180 degrees. ``t_s`` is the time of the frame, None for an image.
    """

    name: str
    image_size: tuple[int, int]
    ids: NDArray[np.int64]
    corners_px: Array
    stderr_px: Array
    blur_px: float
    oriented: bool
    t_s: float | None = None

    def __post_init__(self) -> None:
        ids = np.array(self.ids, dtype=np.int64)
        if ids.ndim != 1 or len(np.unique(ids)) != len(ids):
            raise DataError("ids must be a list of different corner numbers")
        ids.flags.writeable = False
        object.__setattr__(self, "ids", ids)
        object.__setattr__(self, "corners_px", frozen_array(self.corners_px, (ids.size, 2), "corners_px"))
        object.__setattr__(self, "stderr_px", frozen_array(self.stderr_px, (ids.size,), "stderr_px"))
        if not np.all(np.isfinite(self.corners_px)):
            raise DataError("a corner has a position that is not finite; leave it out of the view")

    def points_m(self, board: Board) -> Array:
        """The corners' positions (n, 2) on the ``board``, m."""
        if self.ids.size and not 0 <= self.ids.min() <= self.ids.max() < board.columns * board.rows:
            raise CalibrationError(
                f"{self.name} has corner number {self.ids.max()}, but a {board.label} board has "
                f"{board.columns * board.rows}: it was found with another board"
            )
        return board.points_m[self.ids]

    def outline_px(self, board: Board) -> Array:
        """Positions (4, 2), px, of the ``board``'s four outermost inner corners, also of undetected ones."""
        homography, _ = fit_homography(self.points_m(board), self.corners_px)
        last = board.columns * board.rows - 1
        return apply_homography(homography, board.points_m[[0, board.columns - 1, last, last + 1 - board.columns]])

    def named(self, name: str, t_s: float | None = None) -> BoardView:
        """The same view with another ``name`` and time ``t_s``."""
        return replace(self, name=name, t_s=t_s)


def shortest_side(corners_px: Array, board: Board) -> float:
    """Shortest side of a square, px, of all ``corners_px`` (columns * rows, 2) of the ``board``."""
    grid = corners_px.reshape(board.rows, board.columns, 2)
    sides = [np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)]
    return float(min(sides))
