"""Which view of a board lies in the plane of motion: by evidence, or said to be a guess."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import render_checkerboard
from iris_sysid.calibration.board.board import Board
from iris_sysid.calibration.board.calibrate import BoardPlacement, calibrate_board
from iris_sysid.calibration.board.plane_pose import plane_from_board
from iris_sysid.calibration.board.plane_view import with_plane_view_doubt
from iris_sysid.calibration.calibration_json import read_calibration, write_calibration
from iris_sysid.calibration.camera import calibrate_camera
from iris_sysid.calibration.pixel_scale import scale
from iris_sysid.calibration.plane import geometry_of
from iris_sysid.types import Doubt
from tests._board_pictures import BOARD, simulated_views


@pytest.fixture(scope="module")
def views():
    """Twelve views of a board at different distances and angles."""
    return simulated_views(np.random.default_rng(7), 12)


@pytest.fixture(scope="module")
def camera(views):
    return calibrate_camera(views, BOARD)


def frames(views, held, at=0):
    """Outlines of the board in frames of a clip: ``held`` at one view, two at each of the others; a hand trembles."""
    rng = np.random.default_rng(1)
    outlines = [view.outline_px(BOARD) for k, view in enumerate(views) for _ in range(held if k == at else 2)]
    return np.array(outlines) + rng.normal(0, 0.3, (len(outlines), 4, 2))


def plane_and_doubt(views, camera, seen_px, first=0):
    """The plane of the first view, and what is said of it."""
    plane = with_plane_view_doubt(
        plane_from_board(views[first], BOARD, camera), views[first], views, BOARD, camera, seen_px
    )
    return plane, next(iter(plane.doubts), None)


def test_first_of_some_images_is_a_guess_that_says_what_it_does_to_the_scale(views, camera):
    _, doubt = plane_and_doubt(views, camera, None)
    assert doubt.kind == "plane-view"
    assert "the first that shows the board, was taken to lie in the plane of motion" in doubt.finding
    assert "%" in doubt.finding
    assert "--plane-view" in doubt.remedy


def test_guess_of_the_view_is_in_the_error_of_the_scale(views, camera):
    plane, _ = plane_and_doubt(views, camera, None)
    scales = np.array([plane_from_board(view, BOARD, camera).scale.value for view in views])
    without = plane_from_board(views[0], BOARD, camera).scale
    guessed = np.sqrt(np.mean(np.square(scales - scales[0])))
    assert plane.scale.stderr == pytest.approx(np.hypot(without.stderr, guessed), rel=1e-3)
    assert plane.scale.value == pytest.approx(without.value)


def test_first_view_of_a_clip_that_is_held_longest_is_evidence(views, camera):
    assert plane_and_doubt(views, camera, frames(views, held=8))[1] is None


def test_first_view_of_a_clip_that_is_held_as_long_as_others_is_a_guess(views, camera):
    assert plane_and_doubt(views, camera, frames(views, held=2))[1] is not None


def test_first_view_is_a_guess_where_another_is_held_longest(views, camera):
    assert plane_and_doubt(views, camera, frames(views, held=20, at=5))[1] is not None


def test_views_of_one_scale_leave_nothing_to_guess(views, camera):
    assert plane_and_doubt(views[:1], camera, None)[1] is None


def test_doubt_is_kept_in_the_file(tmp_path):
    doubt = Doubt("plane-view", "a guess", "say which")
    path = write_calibration(replace(scale(400, 1.0), doubts=(doubt,)), tmp_path / "calibration.json")
    assert read_calibration(path).doubts == (doubt,)


@pytest.mark.slow
def test_small_board_is_seen_in_the_first_frame_and_gives_scale_and_axes(tmp_path):
    """At 320 x 180 px a square has 10 px: only the slow search finds it, and it is quick there."""
    render_checkerboard("pendulum", tmp_path / "board.mp4", size=(320, 180), seed=1)
    truth = json.loads((tmp_path / "board.truth.json").read_text())
    shown = Board(9, 6, truth["board"]["square_m"])
    found = calibrate_board([tmp_path / "board.mp4"], shown).calibration
    assert not found.doubts
    assert "frame 0 (0.000 s), the first that shows the board, lies in its plane" in found.assumed
    assert abs(found.scale.value - truth["camera"]["pixels_per_metre"]) < 2.5 * found.scale.stderr
    assert found.scale.stderr < 2e-3 * found.scale.value
    _, stretch, shear_rad, _ = geometry_of(found.values, found.centre_px)
    assert (stretch, shear_rad) == pytest.approx((1.0, 0.0), abs=1e-3)


@pytest.mark.slow
def test_error_of_the_scale_from_one_view_covers_over_scenes_and_sizes(tmp_path, monkeypatch):
    """Corners of one column lie at the same place in their pixels and share their error: more corners help little."""
    monkeypatch.setattr("iris_sysid.synthetic.board.POSES", 2)  # the board at rest in the plane of motion
    sizes = [(312, 176), (320, 180), (328, 184), (368, 208), (400, 226), (480, 270)]
    scenes = ("pendulum", "dropping-ball", "sliding-cone", "hitting-cones")
    pulls = []
    for seed, (size, scene) in enumerate(itertools.product(sizes, scenes)):
        clip = tmp_path / f"{seed}.mp4"
        render_checkerboard(scene, clip, size=size, fps=10.0, seed=seed)
        truth = json.loads(clip.with_suffix(".truth.json").read_text())
        board = Board(9, 6, truth["board"]["square_m"])
        found = calibrate_board([clip], board, placement=BoardPlacement(view=2), one_image=True).calibration.scale
        pulls.append((found.value - truth["camera"]["pixels_per_metre"]) / found.stderr)
    assert 0.5 < np.sqrt(np.mean(np.square(pulls))) < 1.25
    assert np.mean(np.abs(pulls) < 1.96) > 0.9
