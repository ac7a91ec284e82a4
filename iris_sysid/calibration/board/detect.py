"""Find the inner corners of a checkerboard or ChArUco board in images, to a hundredth of a pixel or with a reason."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.calibration.board.board import Board, BoardError, BoardView, shortest_side
from iris_sysid.calibration.board.corner_refinement import MAX_REACH_PX, Saddles, refine_by_model
from iris_sysid.calibration.board.corner_search import (
    MIN_IMAGE_PX,
    FoundCorners,
    check_ends,
    locate,
    why_not_found,
)
from iris_sysid.calibration.board.grid_topology import oriented_grid
from iris_sysid.calibration.homography import apply_homography, fit_homography, homography_slopes
from iris_sysid.errors import CalibrationError
from iris_sysid.types import Progress, with_progress
from iris_sysid.video.container import MAX_PIXELS

Image = str | Path | NDArray[np.uint8]

# Beyond this blur (standard deviation, squares) the edges of neighbouring corners run into one another.
BLUR_LIMIT_SQUARES = 0.2
MIN_SQUARE_PX = 6.0
PNG = b"\x89PNG\r\n\x1a\n"
MIN_KEPT = 0.8  # smallest fraction of the detected corners to keep


@dataclass(frozen=True, eq=False, slots=True)
class BoardSearch:
    """Views of a board in several images, and by name the reason why an image has none (``missing``)."""

    views: tuple[BoardView, ...]
    missing: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "missing", MappingProxyType(dict(self.missing)))


def find_board(image: Image, board: Board, *, name: str = "", thorough: bool = True) -> BoardView:
    """Find a board's inner corners in one image and fit each to the grey levels around it.

    Rough positions come from OpenCV's detectors; then a model of a blurred corner is fitted in a window that follows
    the board's squares, so that it never holds a second corner; see
    :mod:`iris_sysid.calibration.board.corner_refinement`. Corners are numbered in the board's own order, the same in
    every view, by the colour of the squares.

    Parameters
    ----------
    image
        Path of an image file, or an array: grey (h, w) or BGR (h, w, 3), uint8.
    board
        The board to find.
    name
        Name of the image in messages; by default its file name.
    thorough
        Search every scale, also by a slower method, and report why a board was not found.

    Returns
    -------
    BoardView
        Positions, standard errors and blur. A mirrored image of a plain checkerboard looks like a true one.

    Raises
    ------
    BoardError
        When there is no board, only part of one, another one than stated, or it is blurred, too small, or mirrored; the
        message says what to do.
    """
    grey = grey_image(image)
    name = name or (Path(image).name if isinstance(image, str | Path) else "the image")
    rough = locate(grey, board, thorough)
    if rough is None:
        reason, seen = why_not_found(grey, board) if thorough else ("no board is seen", False)
        raise BoardError(name, reason, seen=seen)
    try:
        return _refined(grey, rough, board, name)
    except CalibrationError as error:
        raise BoardError(name, str(error), seen=True) from error


def find_boards(
    images: Iterable[str | Path] | Mapping[str, NDArray[np.uint8]],
    board: Board,
    *,
    progress: Progress | None = None,
) -> BoardSearch:
    """Find a board in several images, paths or arrays by name; those without a view are listed with the reason.

    Images are grey (h, w) or BGR (h, w, 3), in grey levels; ``progress`` is called with (images done, images).
    CalibrationError, with the first image's reason, when no image shows the board.
    """
    items: list[tuple[str, Image]] = (
        list(images.items()) if isinstance(images, Mapping) else [(Path(path).name, path) for path in images]
    )
    views, missing = [], {}
    for name, image in with_progress(items, progress, len(items)):
        try:
            views.append(find_board(image, board, name=name))
        except CalibrationError as error:
            missing[name] = str(error)
    if not views:
        first = next(iter(missing.values()), "no image was given")
        raise CalibrationError(f"none of {len(items)} images shows the board; {first}")
    return BoardSearch(tuple(views), missing)


def grey_image(image: Image) -> NDArray[np.uint8]:
    """The ``image`` in grey levels (h, w); CalibrationError for an array or file that is not an image."""
    array = _read_grey(Path(image)) if isinstance(image, str | Path) else np.asarray(image)
    if array.dtype != np.uint8 or array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] != 3):
        raise CalibrationError(
            f"an image must be uint8, grey (h, w) or BGR (h, w, 3), not {array.dtype} {array.shape}; convert it first"
        )
    grey = array if array.ndim == 2 else cv2.cvtColor(array, cv2.COLOR_BGR2GRAY)
    if min(grey.shape) < MIN_IMAGE_PX:
        raise CalibrationError(f"an image of {grey.shape[1]}x{grey.shape[0]} px is too small for a board")
    return np.ascontiguousarray(grey)


def _read_grey(path: Path) -> NDArray[np.uint8]:
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise CalibrationError(f"cannot read {path}: {error.strerror or error}") from error
    image = None
    with suppress(cv2.error):  # the header claims an image too large to be meant
        image = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if data.size and _chunks_are_within(data.tobytes()) else None
    if image is None:
        raise CalibrationError(f"{path} is not an image that can be read; give PNG, JPEG, TIFF or BMP files")
    if image.size > MAX_PIXELS:
        raise CalibrationError(f"{path} has {image.shape[1]}x{image.shape[0]} px; at most {MAX_PIXELS} px are read")
    return np.asarray(image, np.uint8)


def _chunks_are_within(data: bytes) -> bool:
    """Whether each chunk of a PNG ends before the file does: OpenCV takes the memory that a chunk's length claims."""
    if not data.startswith(PNG):
        return True
    at, kind = len(PNG), b""
    while kind != b"IEND" and at + 8 <= len(data):
        kind = data[at + 4 : at + 8]
        at += 12 + int.from_bytes(data[at : at + 4], "big")  # length and kind before its data, checksum after
    return at <= len(data)


def _refined(grey: NDArray[np.uint8], rough: FoundCorners, board: Board, name: str) -> BoardView:
    rough_px, oriented = rough.corners_px, True
    if board.marker_m is None:
        grid = rough_px.reshape(board.rows, board.columns, 2)
        check_ends(grey, rough_px, board)
        grid, oriented = oriented_grid(grey, grid)
        rough_px = grid.reshape(-1, 2)
    return _fitted(grey, FoundCorners(rough.ids, rough_px), board, name, oriented=oriented)


def find_again(grey: NDArray[np.uint8], view: BoardView, board: Board) -> BoardView:
    """The ``view`` of a ``board`` in another image ``grey`` (h, w) of it, taken at about the same place.

    CalibrationError when too many corners are no longer there.
    """
    rough = FoundCorners(view.ids, np.asarray(view.corners_px))
    return _fitted(grey, rough, board, view.name, oriented=view.oriented).named(view.name, view.t_s)


def _fitted(grey: NDArray[np.uint8], rough: FoundCorners, board: Board, name: str, *, oriented: bool) -> BoardView:
    ids, rough_px = rough.ids, rough.corners_px
    points = board.points_m / board.square_m
    homography, _ = fit_homography(points[ids], rough_px)
    square_px = shortest_side(apply_homography(homography, points), board)
    if square_px < MIN_SQUARE_PX:
        raise CalibrationError(
            f"the squares are only {square_px:.1f} px wide, {MIN_SQUARE_PX:g} are needed; come closer or use a "
            "larger board"
        )
    sides_px = homography_slopes(homography, points[ids])
    saddles = refine_by_model(grey, rough_px, sides_px, board.clear_squares)
    kept = _checked(saddles, square_px)
    return BoardView(
        name=name,
        image_size=(grey.shape[1], grey.shape[0]),
        ids=ids[kept],
        corners_px=saddles.xy_px[kept],
        stderr_px=saddles.stderr_px[kept],
        blur_px=float(np.median(saddles.blur_px[kept])),
        oriented=oriented,
    )


def _checked(saddles: Saddles, square_px: float) -> NDArray[np.bool_]:
    """True for corners to keep; CalibrationError when the image is blurred or too many corners are lost."""
    kept = np.asarray(np.isfinite(saddles.xy_px).all(axis=1))
    blurs = saddles.blur_px[np.isfinite(saddles.blur_px)]
    limit_px = BLUR_LIMIT_SQUARES * min(square_px, MAX_REACH_PX / 0.42)
    if blurs.size and np.median(blurs) > limit_px:
        raise CalibrationError(
            f"the image is blurred: edges of the board are {2 * np.median(blurs):.1f} px wide, at most "
            f"{2 * limit_px:.1f} px can be used with squares of {square_px:.0f} px; hold the board still and focus"
        )
    if kept.mean() < MIN_KEPT:
        raise CalibrationError(
            f"{int((~kept).sum())} of {kept.size} corners cannot be located: part of the board is covered, in glare or "
            "blurred; show all of it, evenly lit"
        )
    return kept
