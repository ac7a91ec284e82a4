"""Circles and lines through positions: exact where they can be, honest where they cannot."""

import numpy as np
import pytest

from iris_sysid import DataError, Estimate
from iris_sysid.phenomena._geometry import circle_about, fit_circle, fit_line, inflation
from tests._motions import on_arc
from tests._project import recording

SWING = np.cos(np.linspace(0.0, 20.0, 200))


def exact(x, z):
    return Estimate(x, 0.0, "px", "direct")


@pytest.mark.parametrize("amplitude_deg", [2, 15, 90, 120])
@pytest.mark.parametrize("radius", [0.5, 300.0, 1e5])
def test_circle_through_exact_positions_is_exact(amplitude_deg, radius):
    arc = on_arc(np.radians(amplitude_deg) * SWING, radius, pivot=(3 * radius, -2 * radius))
    circle = fit_circle(arc)
    assert (circle.x, circle.z, circle.radius) == pytest.approx((3 * radius, -2 * radius, radius), rel=1e-6)
    assert circle.belongs.all()
    assert circle.scatter < 1e-6 * radius


@pytest.mark.parametrize("amplitude_deg", [12, 45, 110])
def test_pull_of_centre_and_radius_is_one(amplitude_deg):
    rng = np.random.default_rng(amplitude_deg)
    pulls = []
    for _ in range(150):
        noisy = on_arc(np.radians(amplitude_deg) * SWING, 300.0) + 0.3 * rng.standard_normal((200, 2))
        circle = fit_circle(noisy, 0.3)
        pulls.append(np.array([circle.x, circle.z, circle.radius - 300.0]) / circle.stderr)
    spread = np.std(pulls, axis=0)
    assert np.all((spread > 0.8) & (spread < 1.2)), spread
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.4)


def test_pull_allows_for_a_background_that_displaces_the_body_alike_at_each_place():
    rng, pulls = np.random.default_rng(8), []
    angle = 0.5 * SWING
    for _ in range(60):
        waves, phases = rng.standard_normal((2, 8)), rng.uniform(0, 2 * np.pi, (2, 8))
        displaced = [
            np.sum(
                [size * np.cos(k * angle / 0.12 + phase) for k, (size, phase) in enumerate(zip(*axis, strict=True))], 0
            )
            for axis in zip(waves, phases, strict=True)
        ]
        noisy = on_arc(angle, 300.0) + 0.1 * np.column_stack(displaced) + 0.1 * rng.standard_normal((200, 2))
        circle = fit_circle(noisy, 0.1)
        pulls.append((circle.radius - 300.0) / circle.stderr[2])
    assert np.sqrt(np.mean(np.square(pulls))) < 1.5


def test_small_arc_has_a_large_error_of_the_radius_which_it_shares_with_the_pivot():
    noisy = on_arc(np.radians(8) * SWING, 300.0) + 0.3 * np.random.default_rng(1).standard_normal((200, 2))
    circle = fit_circle(noisy, 0.3)
    assert circle.stderr[0] < 0.2
    assert 2.0 < circle.stderr[2] < 20.0
    correlation = circle.covariance[1, 2] / circle.stderr[1] / circle.stderr[2]
    assert correlation > 0.999


def test_samples_off_the_arc_are_left_out_and_do_not_move_it():
    rng = np.random.default_rng(2)
    arc = on_arc(1.4 * SWING, 300.0) + 0.3 * rng.standard_normal((200, 2))
    arc[:30] *= np.linspace(0.85, 0.98, 30)[:, None]
    arc[100] += [0.0, 40.0]
    circle = fit_circle(arc, 0.3)
    np.testing.assert_array_equal(np.flatnonzero(~circle.belongs), [*range(30), 100])
    assert abs(circle.radius - 300.0) < 4 * circle.stderr[2]
    assert np.all(circle.off[:30] < 0)


def test_known_radius_fixes_the_centre_of_an_arc_too_small_for_it():
    rng = np.random.default_rng(3)
    flat = on_arc(np.radians(1) * SWING, 1000.0, (5.0, 7.0)) + 0.3 * rng.standard_normal((200, 2))
    circle = fit_circle(flat, 0.3, 1000.0, 10.0)
    assert circle.radius == 1000.0
    assert abs(circle.x - 5.0) < 5 * circle.stderr[0]
    assert circle.z == pytest.approx(7.0, abs=0.3)
    assert circle.stderr[1] == pytest.approx(10.0, rel=0.01)


def test_known_centre_gives_the_radius_and_its_error():
    rng = np.random.default_rng(4)
    arc = on_arc(0.5 * SWING, 300.0) + 0.3 * rng.standard_normal((200, 2))
    circle = circle_about(exact(0.0, 0.0), exact(0.0, 0.0), arc, 0.3)
    assert abs(circle.radius - 300.0) < 4 * circle.stderr[2]
    marked = Estimate(0.0, 2.0, "px", "direct")
    assert circle_about(exact(0.0, 0.0), marked, arc, 0.3).stderr[2] == pytest.approx(2.0 * np.cos(0.3), rel=0.1)


def test_correlated_residuals_enlarge_the_errors():
    rng = np.random.default_rng(5)
    slow = np.zeros(2000)
    for k in range(1, 2000):
        slow[k] = 0.9 * slow[k - 1] + rng.standard_normal()
    assert inflation(slow) == pytest.approx(19.0, rel=0.3)
    assert inflation(rng.standard_normal(2000)) == pytest.approx(1.0, abs=0.1)
    assert inflation(np.zeros(5)) == 1.0
    assert inflation(np.ones(10)) < 10.0


@pytest.mark.parametrize("angle_deg", [0, 29, 80, 135, -120])
def test_line_points_along_the_motion(angle_deg):
    direction = np.array([np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))])
    line = fit_line(np.linspace(0, 100, 40)[:, None] * direction)
    np.testing.assert_allclose(line.direction, direction, atol=1e-12)
    assert line.scatter < 1e-12


def test_pull_of_the_angle_of_a_line_is_one():
    rng = np.random.default_rng(6)
    way = np.linspace(0, 1, 60) ** 2 * 200
    pulls = []
    for _ in range(300):
        line = fit_line(way[:, None] * [0.8, -0.6] + 0.4 * rng.standard_normal((60, 2)))
        pulls.append((np.arctan2(-line.direction[1], line.direction[0]) - np.arctan2(0.6, 0.8)) / line.angle_stderr)
    assert 0.85 < np.std(pulls) < 1.15


@pytest.mark.parametrize(
    ("position", "message"),
    [
        (np.zeros((4, 2)), "at least 5 positions, not 4"),
        (np.zeros((9, 2)), "no arc can be seen"),
        (np.column_stack([np.arange(9.0), np.zeros(9)]), "too small to fix the pivot"),
        (-on_arc(SWING, 300.0), "bends downwards"),
        (
            on_arc(0.01 * SWING, 300.0) + 0.3 * np.random.default_rng(7).standard_normal((200, 2)),
            r"curvature is .* \+- .*give the pivot \(--mark pivot=",
        ),
    ],
)
def test_fit_circle_refuses_with_the_remedy(position, message):
    with pytest.raises(DataError, match=message):
        fit_circle(position)


def test_centre_on_the_path_is_refused():
    with pytest.raises(DataError, match="passes through the pivot"):
        circle_about(exact(1.0, 0.0), exact(0.0, 0.0), np.column_stack([np.arange(9.0), np.zeros(9)]))


@pytest.mark.parametrize(("position", "message"), [(np.zeros((2, 2)), "at least 3"), (np.ones((9, 2)), "not move")])
def test_fit_line_refuses_with_the_reason(position, message):
    with pytest.raises(DataError, match=message):
        fit_line(position)


def test_webcam_pendulum_has_a_plausible_pivot():
    folder = recording("alexiev_pendulum")
    x, y = (np.loadtxt(folder / f"length_68_{axis}.csv") for axis in "xy")
    circle = fit_circle(np.column_stack([x, -y]))
    assert circle.scatter < 1.0
    assert circle.stderr[2] / circle.radius < 0.03
    assert abs(circle.x - 1002.8) < 6.0  # the author's own origin, of another clip of the same set-up
