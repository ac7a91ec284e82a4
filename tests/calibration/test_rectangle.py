"""Four marked corners of a rectangle: the plane, its error, and what is refused."""

import numpy as np
import pytest

from iris_sysid.calibration.homography import apply_homography
from iris_sysid.calibration.pixel_scale import to_world
from iris_sysid.calibration.plane import to_plane
from iris_sysid.calibration.rectangle import plane_from_rectangle
from iris_sysid.errors import CalibrationError
from tests.calibration.test_pixel_scale import track

WIDTH, HEIGHT = 0.2, 0.125
# a board seen from the side: upper left, upper right, lower right, lower left in the image
SEEN = np.array([[100.0, 90.0], [300.0, 70.0], [310.0, 240.0], [95.0, 215.0]])


def metres(plane, xy_px):
    return to_plane(plane, np.asarray(xy_px, dtype=float))[0]


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1]])
def test_sides_of_the_rectangle_are_as_stated_and_z_runs_up(order):
    plane = plane_from_rectangle(SEEN[order], WIDTH, HEIGHT)
    corners = metres(plane, SEEN)
    sides = np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1)
    assert sides == pytest.approx([WIDTH, HEIGHT, WIDTH, HEIGHT])
    assert corners[0, 1] > corners[3, 1]
    assert corners[1, 0] > corners[0, 0]


def test_first_side_is_the_width():
    plane = plane_from_rectangle(SEEN[[1, 2, 3, 0]], HEIGHT, WIDTH)
    corners = metres(plane, SEEN)
    assert np.linalg.norm(corners[1] - corners[0]) == pytest.approx(WIDTH)


def test_scale_is_covered_by_its_error_when_the_corners_are_clicked_anew():
    rng = np.random.default_rng(7)
    true = plane_from_rectangle(SEEN, WIDTH, HEIGHT)
    at = np.array([[150.0, 120.0], [280.0, 200.0]])
    length = np.linalg.norm(np.diff(metres(true, at), axis=0))
    pulls, scales = [], []
    for _ in range(300):
        clicked = SEEN + rng.normal(0, 0.75, SEEN.shape)
        plane = plane_from_rectangle(clicked, WIDTH, HEIGHT, corner_stderr_px=0.75)
        ends, _, by_calibration = to_plane(plane, at)
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        by_values = along @ (by_calibration[1] - by_calibration[0])
        pulls.append((np.linalg.norm(ends[1] - ends[0]) - length) / np.sqrt(by_values @ plane.covariance @ by_values))
        scales.append((plane.scale.value - true.scale.value) / plane.scale.stderr)
    assert np.std(pulls) == pytest.approx(1.0, abs=0.12)
    assert np.std(scales) == pytest.approx(1.0, abs=0.12)


def test_error_of_a_side_is_common_to_all_lengths():
    plane = plane_from_rectangle(SEEN, WIDTH, HEIGHT, width_stderr_m=0.002, height_stderr_m=0.00125)
    exact = plane_from_rectangle(SEEN, WIDTH, HEIGHT)
    added = np.sqrt(plane.scale.stderr**2 - exact.scale.stderr**2) / plane.scale.value
    assert 0.01 / 2 < added < 0.01  # two independent errors of 1 % of the sides


def test_positions_of_a_track_come_with_the_calibration_in_their_budget():
    plane = plane_from_rectangle(SEEN, WIDTH, HEIGHT, width_stderr_m=0.001)
    world = to_world(track(SEEN), plane)
    assert [quantity.unit for quantity in world.quantities] == ["m", "m"]
    assert any("corners" in source for source in world.systematic)
    assert any("width" in source for source in world.systematic)


@pytest.mark.parametrize(
    ("corners", "sides", "message"),
    [
        (SEEN[[0, 2, 1, 3]], (WIDTH, HEIGHT), "one after the other around it"),
        ([[0, 0], [100, 0], [200, 0], [100, 100]], (WIDTH, HEIGHT), "one after the other around it"),
        ([[0, 0], [3, 0], [3, 3], [0, 3]], (WIDTH, HEIGHT), "mark a larger rectangle"),
        (SEEN, (0.0, HEIGHT), "above zero"),
        (SEEN, (float("nan"), HEIGHT), "above zero"),
    ],
)
def test_what_is_no_rectangle_is_refused(corners, sides, message):
    with pytest.raises(CalibrationError, match=message):
        plane_from_rectangle(np.array(corners, dtype=float), *sides)


def test_map_is_that_of_the_corners():
    plane = plane_from_rectangle(SEEN, WIDTH, HEIGHT)
    half = np.array([WIDTH, HEIGHT]) / 2
    found = apply_homography(plane.homography, SEEN)
    assert np.abs(np.linalg.norm(found, axis=1) - np.linalg.norm(half)).max() < 1e-9
