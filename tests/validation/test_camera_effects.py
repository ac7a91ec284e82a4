"""The clips of ``validation.camera_effects`` show what OpenCV's projection says."""

import cv2
import numpy as np
import pytest

from validation.camera_effects import (
    FAULTS,
    NO_FAULT,
    PX_PER_M,
    SCENES,
    SIZE_PX,
    WALL,
    Outcome,
    filmed,
    jobs,
    plane_seen,
    table,
)

MIDDLE = (np.array(SIZE_PX) - 1) / 2


@pytest.mark.parametrize(
    ("fault", "size"),
    [("nothing", 0.0), ("camera-tilt", 0.3), ("radial-distortion", -0.3), ("anisotropic-scale", 0.05)],
)
def test_pixels_look_where_opencv_projects_from(fault, size):
    focal = 250.0
    plane = plane_seen(fault, size, focal)
    points = np.array([[20, 30], [160, 200], [300, 60]])
    places = plane[points[:, 1], points[:, 0]]
    matrix = np.array(
        [[focal * (1 + size * (fault == "anisotropic-scale")), 0, MIDDLE[0]], [0, focal, MIDDLE[1]], [0, 0, 1]]
    )
    seen, _ = cv2.projectPoints(
        np.column_stack([places, np.zeros(3)]),
        np.array([0.0, size * (fault == "camera-tilt"), 0.0]),
        np.array([0.0, 0.0, focal / PX_PER_M]),
        matrix,
        np.array([size * (fault == "radial-distortion"), 0.0, 0.0, 0.0]),
    )
    np.testing.assert_allclose(seen[:, 0], points, atol=1e-3)


def balls(scene, fault, size):
    """Centroids (n, 2) px of what is brighter than the wall, in the frames before the ball leaves the picture."""
    film, _ = filmed(SCENES[scene], fault, size, np.random.default_rng(4))
    rows, columns = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    weights = [np.where(image > WALL + 30, image - WALL, 0.0) for image in film.images[:63]]
    return np.array([[np.sum(w * columns), np.sum(w * rows)] / np.sum(w) for w in weights])


def test_shutter_shows_each_ball_at_the_time_of_its_row():
    plain, rolled = (balls("projectile", "rolling-shutter", size) for size in (0.0, 0.04))
    inside = slice(3, 60)
    velocity = np.gradient(plain, 1 / SCENES["projectile"].fps, axis=0)
    delay = 0.04 / SIZE_PX[1] * (rolled[:, 1] - MIDDLE[1])
    expected = velocity * delay[:, None]
    np.testing.assert_allclose((rolled - plain)[inside], expected[inside], atol=0.2)
    assert np.max(np.abs(expected[inside])) > 1.5


def test_lost_frames_are_a_jump_along_the_same_path():
    plain, short = (balls("projectile", "dropped-frame", size) for size in (0.0, 3.0))
    jump = int(np.argmax(np.hypot(*(short - plain).T) > 2))
    np.testing.assert_allclose(short[jump:60], plain[jump + 3 : 63], atol=0.3)


def test_table_counts_names_and_parameters():
    right = Outcome("pendulum", "camera-tilt", 0, 0.2, ("camera-tilt",), (("camera-tilt",),), False, 1.0, 0.5, 0.001)
    wrong = Outcome("pendulum", "camera-tilt", 1, 0.2, ("leak",), (("leak", "overflow"),), False, 1.0, -9.0, 0.1)
    rival = Outcome("pendulum", "camera-tilt", 2, 0.2, ("leak",), (("leak", "camera-tilt"),), False, 1.0, 1.0, 0.001)
    silent = Outcome("pendulum", "camera-tilt", 3, 0.2, (), (), True, 2.5, 1.0, 0.01)
    row = table([right, wrong, rival, silent]).iloc[0]
    assert row["named exactly"] == "25 % (1 of 4)"
    assert row["in class"] == "50 % (2 of 4)"
    assert row["wrong name"] == "25 % (1 of 4)"
    assert row["named or refused"] == "75 % (3 of 4)"
    assert row["L or g within 3 sigma"] == "75 % (3 of 4)"


def test_every_effect_of_a_camera_is_filmed():
    faults = {fault.name for _, fault, _ in jobs(1, 0, (*FAULTS, NO_FAULT))}
    assert len(faults) == 7
