"""The checkerboard clip: its corners agree with the truth file, and calibrate the camera that filmed the scene."""

import json

import av
import cv2
import numpy as np
import pytest

from iris_sysid.errors import OutputError, UnknownNameError
from iris_sysid.synthetic import Look, render_checkerboard
from iris_sysid.synthetic.board import HELD_S, MOVED_S, POSES, board_for
from iris_sysid.synthetic.plan import plan_clip

LOOK = Look.plain(tilt_deg=(2.0, -3.0), roll_deg=0.5, distortion=(-0.08, 0.02))
CLIP = {"size": (960, 540), "fps": 4.0, "look": LOOK}


def grey_frames(path):
    with av.open(str(path)) as container:
        return [frame.to_ndarray(format="gray") for frame in container.decode(video=0)]


@pytest.fixture(scope="module")
def board(tmp_path_factory):
    path = tmp_path_factory.mktemp("board") / "board.mkv"
    square_m, corners = render_checkerboard("pendulum", path, **CLIP)
    return path, square_m, corners, grey_frames(path)


def found_beside_true(board):
    """For each frame in which OpenCV finds the board at rest: corners found, corners true."""
    _, _, corners, frames = board
    every = HELD_S + MOVED_S
    for k, image in enumerate(frames):
        if (k / 4.0) % every > HELD_S:
            continue
        true = corners[corners.frame == k][["x_px", "y_px"]].to_numpy()
        complete, seen = cv2.findChessboardCorners(image, (9, 6))
        if complete:
            seen = np.ascontiguousarray(seen.reshape(-1, 1, 2), dtype=np.float32)
            criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
            fine = cv2.cornerSubPix(image, seen, (5, 5), (-1, -1), criteria).reshape(-1, 2)
            yield (fine if np.abs(fine - true).max() < np.abs(fine[::-1] - true).max() else fine[::-1]), true


def test_corners_are_where_the_truth_says(board):
    errors = np.array([seen - true for seen, true in found_beside_true(board)])
    assert len(errors) >= 12
    assert np.sqrt(np.mean(errors**2)) < 0.05
    assert np.abs(errors.mean(axis=(0, 1))).max() < 0.02


def test_corners_calibrate_the_camera(board):
    path, square_m, _, _ = board
    pairs = list(found_beside_true(board))
    grid = np.zeros((54, 3), np.float32)
    grid[:, :2] = square_m * np.stack(np.meshgrid(np.arange(9), np.arange(6)), -1).reshape(-1, 2)
    views = [true.astype(np.float32) for _, true in pairs]
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    rms, matrix, lens, *_ = cv2.calibrateCamera([grid] * len(views), views, (960, 540), None, None, flags=flags)
    camera = json.loads(path.with_suffix(".truth.json").read_text())["camera"]
    assert rms < 1e-3
    assert (matrix[0, 0], matrix[1, 1]) == pytest.approx(tuple(camera["focal_px"]), rel=1e-4)
    assert (matrix[0, 2], matrix[1, 2]) == pytest.approx(tuple(camera["centre_px"]), abs=0.05)
    assert lens.ravel()[:2] == pytest.approx(camera["distortion"][:2], abs=2e-3)


def test_board_lies_in_the_plane_of_motion_at_first(board):
    _, square_m, corners, _ = board
    plan = plan_clip("pendulum", size=(960, 540), fps=4.0, duration_s=1.0, look=LOOK)
    first = corners[corners.frame == 0][["x_px", "y_px"]].to_numpy()
    across, down = np.meshgrid((np.arange(9) - 4) * square_m, (np.arange(6) - 2.5) * square_m)
    aim_x, aim_z = plan.camera.aim_m
    plane = np.stack([aim_x + across, aim_z - down], axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(first, plan.camera.project(plane), atol=1e-9)


def test_board_is_still_while_a_pose_is_held(board):
    _, _, corners, _ = board
    early = corners[corners.t_s < 0.8]
    assert np.ptp(early[early.corner == 0].x_px) == 0


def test_board_has_a_round_size_and_many_poses():
    board = board_for(plan_clip("dropping-ball", size=(960, 540), duration_s=1.0).camera, 0)
    assert board.square_m == pytest.approx(round(board.square_m, 3))
    assert 0.02 < board.square_m < 0.2
    assert board.times_s[-1] == pytest.approx(POSES * (HELD_S + MOVED_S) - MOVED_S)


def test_board_clip_is_the_same_again(tmp_path):
    for name in ("a", "b"):
        render_checkerboard("led", tmp_path / f"{name}.mp4", size=(64, 36), fps=4.0)
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()


def test_bad_board_request_is_refused(tmp_path):
    with pytest.raises(UnknownNameError, match="no scene is named 'chess'"):
        render_checkerboard("chess", tmp_path / "a.mp4")
    with pytest.raises(OutputError, match="video format"):
        render_checkerboard("led", tmp_path / "a.png")
    (tmp_path / "a.mp4").write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        render_checkerboard("led", tmp_path / "a.mp4")
