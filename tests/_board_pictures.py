"""Images of boards by a camera that is known exactly, and the corners as it sees them."""

import cv2
import numpy as np

from iris_sysid.calibration.board.board import Board, BoardView
from iris_sysid.calibration.board.plane_pose import _homography
from iris_sysid.calibration.bundle_adjustment import matrix_of, projected
from iris_sysid.calibration.distortion import undistort_px
from iris_sysid.calibration.homography import apply_homography, homography_slopes
from iris_sysid.calibration.plane import UNKNOWN_SCALE, to_plane, with_scale
from iris_sysid.calibration.vertical import upright
from iris_sysid.types import N_VALUES, Calibration

BOARD = Board(9, 6, 0.03)
SIZE = (960, 540)
PHONE = np.array([750.0, 750, 480, 262, 0.12, -0.25, 0.0005, -0.0008, 0.0])
LATTICE = 21  # with 34 samples: Fibonacci numbers, the best such lattice
STRAIGHT = np.array([750.0, 750, 479.5, 269.5, 0, 0, 0, 0, 0])


def pose(tilt=(0.0, 0.0), roll=0.0, distance=0.6, aside=(0.0, 0.0), board=BOARD):
    """Rotation vector and translation (6,) that put the middle of the board there."""
    turn = cv2.Rodrigues(np.array([*tilt, 0.0]))[0] @ cv2.Rodrigues(np.array([0.0, 0, roll]))[0]
    place = np.array([*aside, distance]) - turn @ np.append(board.centre_m, 0.0)
    return np.concatenate([cv2.Rodrigues(turn)[0].ravel(), place])


def random_pose(rng, tilt=0.5, size=SIZE, board=BOARD, camera=PHONE):
    """A pose in which the whole board is in the image."""
    while True:
        candidate = pose(
            rng.uniform(-tilt, tilt, 2), rng.uniform(-0.3, 0.3), rng.uniform(0.4, 0.7), rng.uniform(-0.15, 0.15, 2)
        )
        seen = corners(candidate, board, camera)
        margin = 40
        if seen.min() > margin and np.all(seen < np.array(size) - margin):
            return candidate


def corners(pose, board=BOARD, camera=PHONE):
    return projected(camera, pose, board.points_m)[0]


def view_of_corners(corners_px, image_size, board, *, name="corners", oriented=True):
    """A view from corners (columns * rows, 2) px in the board's order, NaN where one was not seen."""
    seen = np.isfinite(corners_px).all(axis=1)
    unknown = np.full(int(seen.sum()), np.nan)
    return BoardView(name, image_size, np.flatnonzero(seen), corners_px[seen], unknown, np.nan, oriented)


def simulated(pose, noise_px, rng, *, board=BOARD, camera=PHONE, size=SIZE, name="corners"):
    """A view with normal noise on each coordinate."""
    seen = corners(pose, board, camera)
    return view_of_corners(seen + rng.normal(0, noise_px, seen.shape), size, board, name=name)


def simulated_views(rng, n, noise_px=0.1, **where):
    return [simulated(random_pose(rng, **where), noise_px, rng, name=f"view {k}") for k in range(n)]


def true_plane(pose, up_like, offset_m=0.0, board=BOARD, camera=PHONE):
    """The exact calibration of the plane that lies offset_m in front of a board, its world turned like another's."""
    homography = _homography(pose, camera, offset_m, 1.0, board.centre_m).reshape(3, 3)
    exact = with_scale(
        Calibration(
            homography,
            UNKNOWN_SCALE,
            camera_matrix=matrix_of(camera),
            distortion=camera[4:],
            image_size=SIZE,
            centre_px=up_like.centre_px,
        )
    )
    return upright(exact, "image")


_RAYS = {}


def _rays(camera, size):
    """Undistorted position of each pixel's centre, and its derivative within the pixel."""
    key = (tuple(camera), size)
    if key not in _RAYS:
        grid = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), axis=-1).reshape(-1, 2).astype(float)
        _RAYS[key] = undistort_px(grid, matrix_of(camera), camera[4:])[:2]
    return _RAYS[key]


def picture(pose, *, board=BOARD, camera=PHONE, size=SIZE, blur_px=0.7, noise=2.0, rng=None, samples=34):
    """The board on white paper before grey, each pixel the mean of that many positions in it; uint8 (h, w)."""
    places, slopes = _rays(camera, size)
    to_board = _homography(pose, camera, 0.0, 1.0, board.centre_m).reshape(3, 3) / board.square_m
    to_board[2] *= board.square_m
    half = (np.array([board.columns, board.rows]) + 1) / 2

    def levels(at):
        (across, down), (half_across, half_down) = at.T, half
        column, row = np.floor(across + half_across), np.floor(down + half_down)
        inside = (column >= 0) & (column < 2 * half_across) & (row >= 0) & (row < 2 * half_down)
        paper = (np.abs(across) < half_across + 1) & (np.abs(down) < half_down + 1)
        dark = inside & ((column + row) % 2 == board.rows % 2)
        return np.where(dark, 40.0, np.where(paper, 210.0, 110.0))

    middle = apply_homography(to_board, places)
    level = levels(middle)
    edge = (np.abs(middle[:, 0]) < half[0] + 2) & (np.abs(middle[:, 1]) < half[1] + 2)
    near = middle[edge]
    reach = 1.5 / np.sqrt(np.abs(np.linalg.det(homography_slopes(np.linalg.inv(to_board), near))))
    edge[edge] = np.min(np.abs(near + half - np.round(near + half)), axis=1) < 1.5 * reach
    # a lattice that no row or column of samples lies in: else edges along the pixels come out in steps
    k = np.arange(samples)
    within = np.stack([(k + 0.5) / samples, (k * LATTICE + 0.5) / samples % 1], axis=1) - 0.5
    total = np.zeros(int(edge.sum()))
    edge_places, edge_slopes = places[edge], slopes[edge]
    for offset in within:
        total += levels(apply_homography(to_board, edge_places + edge_slopes @ offset))
    level[edge] = total / samples
    level = level.reshape(size[1], size[0])
    level = cv2.GaussianBlur(level, (0, 0), blur_px) if blur_px else level
    if rng is not None:
        level = level + rng.normal(0, noise, level.shape)
    return np.clip(np.round(level), 0, 255).astype(np.uint8)


def common_covariance(calibration, xy_px, source=None):
    """Covariance (2 n, 2 n), m^2, of what errors of positions have in common: B C B' (GUM, 5.2.2), x, z by point."""
    sensitivity = to_plane(calibration, xy_px)[2].reshape(-1, N_VALUES)
    part = calibration.covariance if source is None else calibration.budget[source]
    return sensitivity @ part @ sensitivity.T
