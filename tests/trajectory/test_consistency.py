"""Common sense: a clock, a scale or a phenomenon that the path contradicts is named, and right ones are not."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid import MODELS, PHENOMENA, DataError, Estimate, Track, Trajectory, fit, scale, uncalibrated
from iris_sysid.pipeline.one_clip import observe_and_fit
from iris_sysid.trajectory.circle import circle_through
from iris_sysid.trajectory.consistency.angle_unit import short_pendulum_doubt, with_degrees_doubt
from iris_sysid.trajectory.consistency.gravity_scale import circle_radius
from iris_sysid.trajectory.consistency.path_shape import reversals
from iris_sysid.types import Doubt, TrackQuality

PX_M = 400.0
SCALE = scale(PX_M, 1.0)
MOON = {"gravity": Estimate(1.62, 0.0, "m/s^2")}
BALL = {"ball_radius": Estimate(0.03, 0.001, "m")}
SWING_S, FALL_S = np.arange(150) / 60, np.arange(0, 0.44, 1 / 120)


def swing(length_m=0.5, gravity=9.81, start=0.5, t_s=SWING_S):
    """Positions of a bob on a cord, m."""

    def rates(t, state):
        return [state[1], -gravity / length_m * np.sin(state[0]) - 0.05 * state[1]]

    theta = solve_ivp(rates, (0, t_s[-1]), [start, 0.0], t_eval=t_s, rtol=1e-9, atol=1e-9).y[0]
    return t_s, length_m * np.column_stack([np.sin(theta), -np.cos(theta)])


def flight(speed=0.0, t_s=FALL_S):
    """Positions of a ball that falls, or is thrown, m."""
    return t_s, np.column_stack([0.6 * speed * t_s, speed * t_s - 9.81 / 2 * t_s**2])


def slide(t_s=SWING_S):
    """Positions of a cup on a board of 30 degrees, m."""
    along = 0.5 * 1.5 * (t_s / 2) ** 2
    return t_s, np.column_stack([0.87 * along, -0.5 * along])


def result(path, phenomenon, slow=1.0, calibration=SCALE, settings=None, radius_px=12.0, quality=None):
    """The fit of a path in m, filmed at 400 px/m with errors of 0.05 px, by a clock that runs slow."""
    t_s, position = path
    n, rng = t_s.size, np.random.default_rng(1)
    xy_px = PX_M * position * [1, -1] + [320, 300] + 0.05 * rng.standard_normal((n, 2))
    sigma, valid, radius = np.full((n, 2), 0.05), np.ones(n, bool), np.full(n, radius_px)
    track = Track(t_s * slow, xy_px, sigma, valid, np.arange(n), radius_px=radius, quality=quality)
    _, trajectory, fit = observe_and_fit([track], calibration, PHENOMENA[phenomenon], settings or {})
    assert trajectory.doubts == fit.doubts
    return fit


@pytest.mark.parametrize(
    ("path", "phenomenon", "options"),
    [
        (swing(), "pendulum", {}),
        (swing(start=0.12), "pendulum", {}),
        (swing(gravity=1.62), "pendulum", {"settings": MOON}),
        (swing(), "pendulum", {"calibration": uncalibrated()}),
        (swing(), "pendulum", {"calibration": uncalibrated(), "settings": BALL}),
        (swing(), "pendulum", {"calibration": scale(PX_M / 1.1, 1.0)}),
        (flight(), "dropping-ball", {}),
        (flight(), "dropping-ball", {"calibration": scale(PX_M / 1.1, 1.0)}),
        (flight(), "dropping-ball", {"calibration": uncalibrated()}),
        (flight(speed=2.0), "projectile", {}),
    ],
)
def test_right_clock_and_scale_are_not_doubted(path, phenomenon, options):
    assert result(path, phenomenon, **options).doubts == ()


@pytest.mark.parametrize(
    ("path", "phenomenon", "rate"),
    [(swing(), "pendulum", 60), (flight(), "dropping-ball", 120), (flight(speed=2.0), "projectile", 120)],
)
def test_slow_motion_is_said_first_with_the_frame_rate(path, phenomenon, rate):
    doubt = result(path, phenomenon, slow=8.0).verdict.reasons[0]
    assert doubt.kind == "clock"
    assert "slow motion? the clock seems 8 times too slow" in doubt.finding
    assert f"--fps {rate}" in doubt.remedy


def test_slow_motion_without_a_scale_shows_in_the_size_of_the_body():
    doubt = result(swing(), "pendulum", slow=8.0, calibration=uncalibrated()).verdict.reasons[0]
    assert doubt.kind == "clock"
    assert "by gravity the body is 3.8" in doubt.finding


def test_slow_motion_contradicts_a_stated_radius():
    doubt = result(swing(), "pendulum", slow=4.0, calibration=uncalibrated(), settings=BALL).verdict.reasons[0]
    assert doubt.kind == "clock"
    assert "the clock seems 4" in doubt.finding


def test_time_lapse_is_said_as_well():
    doubt = result(flight(), "dropping-ball", slow=0.25).verdict.reasons[0]
    assert "the clock seems 4 times too fast" in doubt.finding


@pytest.mark.parametrize(("path", "phenomenon"), [(swing(), "pendulum"), (flight(), "dropping-ball")])
def test_wrong_scale_is_said_with_both_readings(path, phenomenon):
    fit = result(path, phenomenon, calibration=scale(PX_M / 1.5, 1.0))
    doubt = fit.verdict.reasons[0]
    assert doubt.kind == "scale"
    assert "lengths are 1.5 times too large, or the clock seems 1.2 times too fast" in doubt.finding
    assert "--scale" in doubt.remedy
    assert not fit.verdict.good


def test_a_swing_that_the_equation_does_not_explain_says_nothing_of_clock_and_scale():
    theta = 0.5 * np.cos(9 * SWING_S) + 0.4 * np.cos(4 * SWING_S)
    fit = result((SWING_S, 0.5 * np.column_stack([np.sin(theta), -np.cos(theta)])), "pendulum")
    kinds = {doubt.kind for doubt in fit.verdict.reasons}
    assert "little-explained" in kinds
    assert not kinds & {"clock", "scale"}


def test_a_fall_that_comes_to_a_steady_speed_says_nothing_of_clock_and_scale():
    t_s, speed = np.arange(0, 1.2, 1 / 60), 1.6  # m/s: a coffee filter
    fallen = speed**2 / 9.81 * np.log(np.cosh(9.81 * t_s / speed))
    fit = result((t_s, np.column_stack([0 * t_s, -fallen])), "dropping-ball")
    assert not {doubt.kind for doubt in fit.verdict.reasons} & {"clock", "scale"}
    assert not fit.verdict.good


def test_a_rod_may_have_another_length_than_its_arc_has_a_radius():
    t_s, bob = swing(length_m=0.4)
    (doubt, *_) = result((t_s, 1.5 * bob), "pendulum").verdict.reasons
    assert "for a rod" in doubt.finding


def test_doubts_about_the_track_come_before_those_about_clock_and_scale():
    lost = TrackQuality((Doubt("another-body", "it shows something else", "mark it"),), {})
    kinds = [doubt.kind for doubt in result(swing(), "pendulum", slow=2.0, quality=lost).verdict.reasons]
    assert kinds.index("another-body") < kinds.index("clock")


@pytest.mark.parametrize("phenomenon", ["dropping-ball", "projectile"])
def test_swing_taken_for_a_flight_is_doubtful_and_names_the_pendulum(phenomenon):
    verdict = result(swing(), phenomenon).verdict
    assert (verdict.word, verdict.complete) == ("doubtful", False)
    assert verdict.reasons[0].kind == "phenomenon"
    assert verdict.reasons[0].remedy == "try --phenomenon pendulum"


@pytest.mark.parametrize(
    ("path", "name"), [(flight(), "dropping-ball"), (flight(speed=2.0), "projectile"), (slide(), "sliding-cone")]
)
def test_other_motion_taken_for_a_swing_is_refused_with_the_one_that_fits(path, name):
    with pytest.raises(DataError, match=f"this is no pendulum; try --phenomenon {name}"):
        result(path, "pendulum")


def test_circle_of_least_squares_finds_centre_and_radius_of_a_short_arc():
    angle = np.linspace(-0.3, 0.3, 200)
    noise = 1e-4 * np.random.default_rng(1).standard_normal((200, 2))
    circle = circle_through(np.column_stack([2 + 0.5 * np.sin(angle), 1 - 0.5 * np.cos(angle)]) + noise)
    assert circle[:3] == pytest.approx((2, 1, 0.5), abs=2e-3)
    assert abs(circle.radius - 0.5) < 4 * circle.stderr < 4e-3
    assert circle_through(np.column_stack([angle, 2 * angle])).radius == np.inf
    assert circle_through(np.ones((20, 2))).radius == np.inf


def test_radius_of_an_arc_has_an_error_that_grows_as_the_arc_gets_short():
    wide, short = (circle_radius(swing(start=start)[1]) for start in (1.0, 0.1))
    assert wide[0] == pytest.approx(0.5, abs=1e-3)
    assert wide[1] < 0.05 * wide[0]
    assert short[1] > 0.3 * short[0]


@pytest.mark.parametrize(
    ("values", "count"), [([0, 1, 2, 3], 0), ([0, 2, 0, 2, 0], 3), ([0, 2, 1.9, 2, 0], 1), ([1, 1, 1], 0)]
)
def test_reversals_are_counted_where_they_are_large(values, count):
    assert reversals(np.array(values, dtype=float)) == count


def angles(amplitude_rad, unit_per_rad, length_m=0.5):
    """A swing as a table of another unit holds it, under a name that says rad."""
    theta = solve_ivp(
        lambda t, state: [state[1], -9.81 / length_m * np.sin(state[0])],
        (0, 6.0),
        [amplitude_rad, 0.0],
        t_eval=np.arange(360) / 60,
        rtol=1e-9,
        atol=1e-9,
    ).y[0]
    theta = unit_per_rad * theta + 1e-3 * np.random.default_rng(2).standard_normal(theta.size)
    n = theta.size
    return Trajectory(
        np.arange(n) / 60, MODELS["pendulum"].observed, theta[:, None], np.full((n, 1), np.nan), np.ones(n, bool)
    )


@pytest.mark.parametrize("amplitude_deg", [5.0, 20.0, 60.0])
def test_degrees_under_a_name_in_rad_are_asked_for(amplitude_deg):
    doubt = fit(angles(np.radians(amplitude_deg), 180 / np.pi), "pendulum").verdict.reasons[0]
    assert doubt.kind == "degrees"
    assert "theta_deg" in doubt.remedy


@pytest.mark.parametrize("amplitude_rad", [0.1, 1.0, 3.0])
def test_angles_in_rad_are_not_taken_for_degrees(amplitude_rad):
    assert fit(angles(amplitude_rad, 1.0), "pendulum").doubts == ()


def test_wheel_on_a_spring_may_turn_by_more_than_a_turn():
    assert with_degrees_doubt(angles(0.2, 100.0), MODELS["linear-oscillator"]).doubts == ()


def test_pendulum_of_a_millimetre_is_doubted():
    (doubt,) = short_pendulum_doubt({"length": Estimate(0.00124, 1e-5, "m")}, MODELS["pendulum"])
    assert "0.00124 m long" in doubt.finding
