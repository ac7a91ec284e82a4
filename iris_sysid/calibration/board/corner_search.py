"""Locate a board's inner corners approximately, and diagnose an image without them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import BOARD_HELP, Board, shortest_side
from iris_sysid.calibration.board.corner_refinement import refine_by_window
from iris_sysid.calibration.board.grid_topology import SIDES, goes_on, is_board, sides_outside, whole_grid
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Array

Grey = NDArray[np.uint8]

# Longer side of the image that is searched, px: OpenCV's detector misses squares above about 120 px.
SEARCH_SIDES_PX = (960, 1920)
MIN_IMAGE_PX = 32  # shorter side: no board is seen in less, and OpenCV fails on images of a few rows
MAX_SIDE_PX = 4096  # of an image searched whole: the slower method takes 60 bytes a px
CLASSICAL = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
SECTORS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE
MIN_SEEN = 12  # inner corners, 4x3: fewer are detected in any cluttered image


@dataclass(frozen=True, eq=False, slots=True)
class FoundCorners:
    """Corners as first found: numbers on the board (n,) and positions (n, 2) px, in no particular orientation."""

    ids: NDArray[np.int64]
    corners_px: Array


def locate(grey: Grey, board: Board, thorough: bool) -> FoundCorners | None:
    """Find the board's corners in a grey image (h, w), to about a pixel of the scale at which it was found; else None.

    ``thorough`` searches every scale, and uses the slower method too. CalibrationError when the board's dictionary of
    markers is not known.
    """
    if board.marker_m is not None:
        return locate_markers(grey, board)
    for method in (_classical, _by_sectors) if thorough else (_quick,):
        for scale, small in _scales(grey, thorough):
            corners = method(small, board)
            # OpenCV 5 may return every second column of a board that has more of them than requested
            if corners is not None and is_board(small, corners.reshape(board.rows, board.columns, 2)):
                return _at_full_size(corners, small, scale, board)
    return _grown(grey, board) if thorough else None


def _grown(grey: Grey, board: Board) -> FoundCorners | None:
    """The largest visible grid, if it has as many corners as the board."""
    part = part_of_board(grey)
    if part is None or sorted(part.shape[:2]) != sorted((board.rows, board.columns)):
        return None
    grid = part if part.shape[0] == board.rows else part.swapaxes(0, 1)
    return FoundCorners(np.arange(board.rows * board.columns), grid.reshape(-1, 2))


def _scales(grey: Grey, thorough: bool) -> Iterator[tuple[float, Grey]]:
    """The image at each scale that is searched, with the number of original pixels per pixel."""
    longer = max(grey.shape)
    sides = (*SEARCH_SIDES_PX, min(longer, MAX_SIDE_PX)) if thorough else SEARCH_SIDES_PX[:1]
    for side in sides:
        if longer <= side:
            yield 1.0, grey
            return
        scale = longer / side
        size = round(grey.shape[1] / scale), round(grey.shape[0] / scale)
        if min(size) >= MIN_IMAGE_PX:
            yield scale, np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)


def _quick(grey: Grey, board: Board) -> Array | None:
    return _classical(grey, board, CLASSICAL | cv2.CALIB_CB_FAST_CHECK)


def _classical(grey: Grey, board: Board, flags: int = CLASSICAL) -> Array | None:
    success, corners = cv2.findChessboardCorners(grey, (board.columns, board.rows), flags=flags)
    return np.asarray(corners, float).reshape(-1, 2) if success else None


def _by_sectors(grey: Grey, board: Board) -> Array | None:
    success, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=SECTORS)
    return np.asarray(corners, float).reshape(-1, 2) if success else None


def _at_full_size(corners: Array, small: Grey, scale: float, board: Board) -> FoundCorners:
    half_px = int(np.clip(0.25 * shortest_side(corners, board), 2, 11))
    corners = refine_by_window(small, corners, half_px)
    return FoundCorners(np.arange(len(corners)), (corners + 0.5) * scale - 0.5)


# --------------------------------------------------------------------------- markers


def locate_markers(grey: Grey, board: Board) -> FoundCorners | None:
    """Find the corners between the markers of a ChArUco ``board`` in a ``grey`` image; None when fewer than six."""
    for legacy in (False, True):  # boards printed by OpenCV before 4.6 may begin with a marker
        corners, ids, _ = _markers(grey, board, legacy)
        if len(ids) >= 6:
            return FoundCorners(ids, corners)
    return None


def _markers(grey: Grey, board: Board, legacy: bool = False) -> tuple[Array, NDArray[np.int64], int]:
    """Corners, their numbers, and the number of decoded markers."""
    squares = board.columns + 1, board.rows + 1
    marker_m = board.marker_m or 0.0
    pattern = cv2.aruco.CharucoBoard(squares, board.square_m, marker_m, dictionary_of(board.dictionary))
    pattern.setLegacyPattern(legacy)
    corners, ids, _, markers = cv2.aruco.CharucoDetector(pattern).detectBoard(grey)
    n_markers = 0 if markers is None else len(markers)
    if ids is None or not len(ids):
        return np.empty((0, 2)), np.empty(0, np.int64), n_markers
    return np.asarray(corners, float).reshape(-1, 2), np.asarray(ids, np.int64).ravel(), n_markers


def dictionary_of(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of that ``name``, e.g. ``4x4_50``; CalibrationError lists the names there are."""
    constants = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    known = {constant.removeprefix("DICT_").lower(): constant for constant in constants}
    if name.lower() not in known:
        raise CalibrationError(f"no dictionary of markers is named {name!r}; there are: {', '.join(sorted(known))}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, known[name.lower()]))


# --------------------------------------------------------------------------- what went wrong


def why_not_found(grey: Grey, board: Board) -> tuple[str, bool]:
    """Why a ``grey`` image does not show the whole ``board``, with a remedy; and whether any board is visible."""
    return _why_no_markers(grey, board) if board.marker_m is not None else _why_no_checkerboard(grey, board)


def _why_no_markers(grey: Grey, board: Board) -> tuple[str, bool]:
    _, mirrored, _ = _markers(np.ascontiguousarray(grey[:, ::-1]), board)
    if len(mirrored) >= 6:
        reason = "the image is mirrored: the markers can be read in a mirror only; turn off mirroring in the camera"
        return reason, True
    _, ids, n_markers = _markers(grey, board)
    if len(ids):
        return f"only {len(ids)} corners of the ChArUco board are seen, 6 are needed; show more of it, evenly lit", True
    if n_markers > 3:  # a few markers are decoded by chance in any cluttered image
        return (
            f"{n_markers} markers of {board.dictionary} are seen, but they do not fit a ChArUco board of {board.label} "
            f"inner corners; {BOARD_HELP}"
        ), True
    return (
        f"no ChArUco board with markers of {board.dictionary} is seen; check the dictionary, the light and the focus, "
        "and that the board is not too small in the image"
    ), False


def _why_no_checkerboard(grey: Grey, board: Board) -> tuple[str, bool]:
    part = part_of_board(grey)
    if part is None:
        return (
            "no checkerboard is seen; show the whole board, uncovered, with a white margin, larger, in focus, "
            f"or check --board: {BOARD_HELP}"
        ), False
    rows, columns = part.shape[:2]
    seen = f"{max(rows, columns)}x{min(rows, columns)}"
    fits = max(rows, columns) <= max(board.rows, board.columns) and min(rows, columns) <= min(board.rows, board.columns)
    outside = sides_outside(part, grey.shape)
    if fits and outside:
        return (
            f"the board is cut off at the {' and the '.join(outside)} of the image ({seen} of {board.label} inner "
            "corners are seen); show the whole board"
        ), True
    hidden = "; or part of the board is covered, blurred or in glare" if fits else ""
    return f"the board seen has {seen} inner corners, not {board.label}: {BOARD_HELP}{hidden}", True


def part_of_board(grey: Grey) -> Array | None:
    """The largest grid of corners (rows, columns, 2), px, in a ``grey`` image; None when it is too small."""
    scale, small = next(_scales(grey, thorough=True), (1.0, grey))
    success, corners, grid = cv2.findChessboardCornersSBWithMeta(small, (3, 3), SECTORS | cv2.CALIB_CB_LARGER)
    if not success or grid is None:
        return None
    rows, columns = grid.shape[:2]
    part = whole_grid(small, np.asarray(corners, float).reshape(rows, columns, 2))
    if part.shape[0] * part.shape[1] < MIN_SEEN or not is_board(small, part):
        return None
    return (part + 0.5) * scale - 0.5


def check_ends(grey: Grey, corners_px: Array, board: Board) -> None:
    """Refuse a board that extends beyond the corners (columns * rows, 2) found in a ``grey`` image.

    Corners are in px.
    """
    beyond = [side for side, more in goes_on(grey, corners_px.reshape(board.rows, board.columns, 2)).items() if more]
    if beyond:
        columns = board.columns + sum(side in SIDES[:2] for side in beyond)
        rows = board.rows + sum(side in SIDES[2:] for side in beyond)
        raise CalibrationError(
            f"the board goes on beyond {board.label} inner corners: it has at least {columns}x{rows}; {BOARD_HELP}"
        )
