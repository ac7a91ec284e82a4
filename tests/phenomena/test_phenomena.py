"""What the models observe is made from positions as it should be, with the geometry found on the way."""

import numpy as np
import pytest

from iris_sysid import (
    MODELS,
    PHENOMENA,
    TRACKERS,
    DataError,
    Estimate,
    Quantity,
    Segment,
    Trajectory,
    fit,
    open_video,
    track,
)
from iris_sysid.calibration.pixel_scale import to_world, uncalibrated
from iris_sysid.trajectory.segmentation import segment
from iris_sysid.trajectory.smoothing import smooth
from tests._motions import bouncing_ball, down_a_board, in_plane, on_arc, pendulum_angle
from tests._project import recording


def given(value, unit="px", stderr=0.0):
    return Estimate(value, stderr, unit, "direct", "given")


def observed(name, world, settings=None, hand=None):
    return PHENOMENA[name].observe([segment(world, hand=hand, kind=PHENOMENA[name].motion)], settings or {})


def swing(rng, amplitude_deg=40.0, radius=350.0, pivot=(437.0, -42.0), sigma=0.2, n=300):
    t_s = np.arange(n) / 60
    theta = pendulum_angle(t_s, np.radians(amplitude_deg), 0.54)
    return theta, in_plane(t_s, on_arc(theta, radius, pivot), sigma, rng=rng)


@pytest.mark.parametrize("name", sorted(PHENOMENA))
def test_phenomenon_names_a_tracker_and_a_model_that_observes_what_it_gives(name):
    phenomenon = PHENOMENA[name]
    assert phenomenon.tracker in TRACKERS
    assert {quantity.name for quantity in MODELS[phenomenon.model].observed}
    assert phenomenon.summary


# --------------------------------------------------------------------------- pendulum


@pytest.mark.parametrize("shutter", [0.5, 1.0])
def test_error_of_the_pivot_holds_what_the_mean_over_an_exposure_does_to_it(shutter):
    t_s = (np.arange(300) + 0.5) / 60
    within = t_s[:, None] + ((np.arange(20) + 0.5) / 20 - 0.5) * shutter / 60
    theta = pendulum_angle(within.ravel(), np.radians(60), 0.54).reshape(within.shape)
    mean = np.mean([on_arc(each, 350.0, (437.0, -42.0)) for each in theta.T], axis=0)
    got = observed("pendulum", in_plane(t_s, mean, 0.01, rng=np.random.default_rng(0))).geometry
    off = abs(got["pivot_z"].value + 42.0)
    assert off > 5 * got["pivot_z"].stderr * shutter
    assert off < 2 * got["pivot_along"].stderr * 350.0


@pytest.mark.parametrize("amplitude_deg", [10, 40, 89])
def test_pendulum_finds_its_pivot_and_the_angle_about_it(amplitude_deg):
    theta, world = swing(np.random.default_rng(amplitude_deg), amplitude_deg)
    got = observed("pendulum", world)
    for name, true in (("pivot_x", 437.0), ("pivot_z", -42.0), ("arc_radius", 350.0)):
        assert abs(got.geometry[name].value - true) < 4 * got.geometry[name].stderr, name
        assert got.geometry[name].unit == "px"
    assert got.quantities == (Quantity("theta", "rad", r"\theta"),)
    # what the pivot's error does to every angle alike, to first order, and five standard errors of a sample
    common = 4 * np.hypot(got.geometry["pivot_x"].stderr, got.geometry["pivot_z"].stderr * np.sin(theta).max()) / 350.0
    assert np.max(np.abs(got.position[:, 0] - theta)) < common + 5 * 0.2 / 350.0
    np.testing.assert_allclose(got.sigma[:, 0], 0.2 / 350.0, rtol=0.05)


def test_pull_of_the_angle_is_one_when_the_pivot_is_given():
    theta, world = swing(np.random.default_rng(1))
    got = observed("pendulum", world, {"pivot_x": given(437.0), "pivot_z": given(-42.0)})
    pull = (got.position[:, 0] - theta) / got.sigma[:, 0]
    assert 0.9 < pull.std() < 1.1
    assert got.geometry["pivot_x"] == given(437.0)
    assert got.geometry["arc_radius"].value == pytest.approx(350.0, abs=0.1)


def test_stated_pivot_may_be_called_y_and_its_error_is_kept():
    _, world = swing(np.random.default_rng(1))
    got = observed("pendulum", world, {"pivot_x": given(437.0, stderr=2.0), "pivot_y": given(-42.0, stderr=3.0)})
    assert (got.geometry["pivot_x"].stderr, got.geometry["pivot_z"].stderr) == (2.0, 3.0)


@pytest.mark.parametrize(("settings", "share"), [({}, 0.004), ({"ball_radius": given(0.05, "m")}, 0.001)])
def test_radius_by_the_period_allows_for_the_inertia_of_the_bob(settings, share):
    rng, t_s = np.random.default_rng(4), np.arange(300) / 30
    world = in_plane(t_s, on_arc(pendulum_angle(t_s, 0.15), 1.0), 0.002, unit="m", rng=rng)
    got = observed("pendulum", world, settings)
    refined = PHENOMENA["pendulum"].refine(fit(got, "pendulum"), got)["arc_radius"]
    assert refined.value == pytest.approx(1.0, abs=0.01)
    assert share < refined.stderr / refined.value < share + 0.002


def test_stated_radius_fixes_the_pivot_of_a_small_arc():
    theta, world = swing(np.random.default_rng(2), amplitude_deg=1.5)
    with pytest.raises(DataError, match=r"too small to fix the pivot.*--mark pivot="):
        observed("pendulum", world)
    got = observed("pendulum", world, {"arc_radius": given(350.0, stderr=5.0)})
    assert got.geometry["arc_radius"] == given(350.0, stderr=5.0)
    assert got.geometry["pivot_z"].stderr == pytest.approx(5.0, rel=0.02)
    assert np.max(np.abs(got.position[:, 0] - theta)) < 0.005


def test_wrong_radius_scales_small_angles_and_leaves_the_frequency():
    theta, world = swing(np.random.default_rng(3), amplitude_deg=8.0)
    right = observed("pendulum", world, {"arc_radius": given(350.0)}).position[:, 0]
    wrong = observed("pendulum", world, {"arc_radius": given(420.0)}).position[:, 0]
    slope = np.polyfit(right, wrong, 1)[0]
    assert slope == pytest.approx(350.0 / 420.0, rel=0.01)
    assert np.std(wrong - slope * right) < 0.005 * np.std(theta)


def test_slack_cord_after_a_release_at_ninety_degrees_is_release():
    t_s = np.arange(300) / 60
    theta = pendulum_angle(t_s, np.radians(80), 0.54)
    arc = on_arc(theta, 350.0)
    sag = 40.0 * (1 - np.arange(12) / 12)  # falls freely inside the arc until the cord is taut
    arc[:12] *= (1 - sag / 350.0)[:, None]
    got = observed("pendulum", in_plane(t_s, arc, 0.2, rng=np.random.default_rng(4)))
    release, motion = (
        next(segment for segment in got.segments if segment.label == label) for label in ("release", "motion")
    )
    assert (release.start, release.stop) == (0, 12)
    assert motion.start == 12
    assert "px inside it: the cord is not taut" in release.reason
    assert not got.valid[:11].any()
    assert abs(got.geometry["arc_radius"].value - 350.0) < 4 * got.geometry["arc_radius"].stderr


def test_samples_off_the_arc_in_mid_swing_are_left_out_and_named():
    _, world = swing(np.random.default_rng(5))
    position = world.position.copy()
    position[100:106, 1] += 6.0  # six in a row, too many for a false detection between good neighbours
    got = observed("pendulum", world.with_(position=position))
    assert not got.valid[100:106].any()
    assert got.valid.sum() >= 290
    assert "left out, off the arc by up to" in next(
        segment.reason for segment in got.segments if segment.label == "motion"
    )


def test_swing_over_the_top_is_unwrapped():
    t_s = np.arange(200) / 100
    theta = 5.0 * t_s
    got = PHENOMENA["pendulum"].observe(
        [in_plane(t_s, on_arc(theta, 300.0), 0.1)], {"pivot_x": given(0.0), "pivot_z": given(0.0)}
    )
    np.testing.assert_allclose(got.position[:, 0], theta, atol=1e-9)


def test_long_gap_in_a_swing_is_not_taken_for_a_turn():
    _, world = swing(np.random.default_rng(6), amplitude_deg=85.0, n=400)
    valid = np.ones(400, bool)
    valid[110:170] = False
    world = world.with_(valid=valid, position=np.where(valid[:, None], world.position, np.nan))
    got = observed("pendulum", world)
    assert np.nanmax(np.abs(got.position[:, 0])) < 1.6


def test_ball_radius_reaches_the_geometry():
    _, world = swing(np.random.default_rng(7))
    radius = given(0.0335, "m")
    assert observed("pendulum", world, {"ball_radius": radius}).geometry["ball_radius"] is radius


# --------------------------------------------------------------------------- slide


@pytest.mark.parametrize("angle_deg", [15, 29, 45, 80])
@pytest.mark.parametrize("side", [1, -1])
def test_slide_gives_the_way_downhill_and_the_angle_of_the_board(angle_deg, side):
    t_s = np.arange(150) / 100
    block = down_a_board(t_s, 0.3, 400.0, np.radians(angle_deg), 1e9) * [side, 1]
    got = observed("sliding-cone", in_plane(t_s, block, 0.2, rng=np.random.default_rng(angle_deg)))
    angle = got.geometry["angle"]
    assert abs(angle.value - np.radians(angle_deg)) < 4 * angle.stderr
    assert angle.unit == "rad"
    motion = got.mask("motion")
    first = np.flatnonzero(motion)[0]
    assert got.position[first, 0] == 0
    true = 200.0 * np.clip(t_s - 0.3, 0, None) ** 2
    np.testing.assert_allclose(got.position[motion, 0], true[motion] - true[first], atol=1.5)
    np.testing.assert_allclose(got.sigma, 0.2)
    assert got.geometry["across_scatter"].value == pytest.approx(0.2, rel=0.3)


def test_stated_angle_overrides_the_measured_one_and_both_are_reported():
    t_s = np.arange(150) / 100
    world = in_plane(t_s, down_a_board(t_s, 0.0, 400.0, 0.5, 1e9), 0.2, rng=np.random.default_rng(1))
    got = observed("sliding-cone", world, {"angle": given(0.52, "rad")})
    assert got.geometry["angle"].value == 0.52
    assert got.geometry["angle_of_motion"].value == pytest.approx(0.5, abs=0.01)


def test_motion_that_is_not_straight_is_no_slide():
    _, world = swing(np.random.default_rng(1))
    with pytest.raises(DataError, match="not along a straight line: it scatters by"):
        PHENOMENA["sliding-cone"].observe([world], {})


# --------------------------------------------------------------------------- flight


def test_dropping_ball_gives_the_height():
    t_s = np.arange(150) / 100
    ball, _ = bouncing_ball(t_s, 2.0, 9.81)
    world = in_plane(t_s, ball, 0.001, unit="m", rng=np.random.default_rng(1))
    got = observed("dropping-ball", world)
    assert [(quantity.name, quantity.unit) for quantity in got.quantities] == [("z", "m")]
    np.testing.assert_array_equal(got.position[:, 0], world.position[:, 1])
    assert got.smoothed is None
    motion = got.mask("motion")
    acceleration = 2 * np.polyfit(t_s[motion], got.position[motion, 0], 2)[0]
    assert acceleration == pytest.approx(-9.81, rel=0.01)


def test_last_sample_of_a_drop_before_the_floor_is_left_out_and_that_is_reported():
    t_s = np.arange(150) / 100
    ball, _ = bouncing_ball(t_s, 2.0, 9.81)
    world = segment(in_plane(t_s, ball, 0.001, unit="m", rng=np.random.default_rng(1)), kind="flight")
    got = PHENOMENA["dropping-ball"].observe([world], {})
    drop = next(segment for segment in got.segments if segment.label == "motion")
    assert np.flatnonzero(got.valid != world.valid).tolist() == [drop.stop - 1]
    assert drop.reason.endswith("without its last sample, which has the floor behind it")
    ends = world.with_(segments=(Segment("motion", 0, 60),))  # nothing ends this fall
    assert PHENOMENA["dropping-ball"].observe([ends], {}).valid.all()


def test_projectile_gives_x_and_z():
    t_s = np.arange(100) / 100
    ball, _ = bouncing_ball(t_s, 1.0, 9.81, speed_x=2.0, launch=2.0)
    got = observed("projectile", in_plane(t_s, ball, 0.001, unit="m", rng=np.random.default_rng(1)))
    assert [quantity.name for quantity in got.quantities] == ["x", "z"]
    assert got.position.shape == (100, 2)


def test_numbered_quantities_lose_their_number():
    t_s = np.arange(50) / 100
    ball, _ = bouncing_ball(t_s, 5.0, 9.81, speed_x=2.0)
    world = in_plane(t_s, ball, 0.001, unit="m").with_(quantities=(Quantity("x1", "m"), Quantity("z1", "m")))
    assert [quantity.name for quantity in observed("projectile", world).quantities] == ["x", "z"]


# --------------------------------------------------------------------------- bad input

RESTING = in_plane(np.arange(9) / 10, np.ones((9, 2)), 0.1, segments=(Segment("rest", 0, 9),))
MIXED = Trajectory([0, 1], (Quantity("x", "m"), Quantity("z", "px")), np.ones((2, 2)), np.ones((2, 2)), [True, True])
_, SWING = swing(np.random.default_rng(0))


@pytest.mark.parametrize("name", ["pendulum", "sliding-cone", "dropping-ball", "projectile"])
@pytest.mark.parametrize(
    ("world", "message"),
    [
        ([], "needs the trajectory of one body, but none was given"),
        ([RESTING], "the motion has 0 samples, at least"),
        ([MIXED], "needs x and z in the same unit, but the trajectory has x in m, z in px"),
        (
            [SWING.with_(quantities=(Quantity("x", "px"),), position=np.ones((300, 1)), sigma=np.ones((300, 1)))],
            "x and z",
        ),
    ],
)
def test_observe_refuses_with_the_reason(name, world, message):
    with pytest.raises(DataError, match=message):
        PHENOMENA[name].observe(world, {})


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"pivot_x": given(1.0)}, "needs both pivot_x and pivot_z"),
        ({"pivot_z": given(1.0)}, "needs both pivot_x and pivot_z"),
        ({"arc_radius": given(0.5, "m")}, "arc_radius is given in m, but positions are in px: give the scale"),
        ({"arc_radius": given(-1.0)}, "a length must be above zero"),
    ],
)
def test_pendulum_refuses_settings_with_the_reason(settings, message):
    with pytest.raises(DataError, match=message):
        observed("pendulum", SWING, settings)


# --------------------------------------------------------------------------- real clips


def real(path, name, fps=None):
    (body,) = track(open_video(recording(path), fps=fps))[:1]
    return observed(name, to_world(body, uncalibrated()), hand=body.hand)


def span(trajectory, label):
    return next((segment.start, segment.stop - 1) for segment in trajectory.segments if segment.label == label)


@pytest.mark.slow
def test_gif_of_a_pendulum_leaves_the_hand_out_and_finds_the_pivot():
    got = real("iris_footage/pendulum.gif", "pendulum")
    assert span(got, "hand")[0] == 0
    assert span(got, "hand")[1] in (2, 3)
    assert span(got, "motion")[0] in (3, 4, 5)
    assert span(got, "motion")[1] == 39
    assert 410 < got.geometry["pivot_x"].value < 445
    assert -65 < got.geometry["pivot_z"].value < -30
    assert np.all(np.isfinite(smooth(got).smoothed.velocity[5:]))


@pytest.mark.slow
def test_gif_of_a_sliding_cup_shows_the_board_at_29_degrees():
    got = real("iris_footage/Sliding_cone.gif", "sliding-cone")
    assert 13 <= span(got, "motion")[0] <= 18
    assert 28 <= span(got, "motion")[1] <= 31
    assert np.degrees(got.geometry["angle"].value) == pytest.approx(29.0, abs=0.5)


@pytest.mark.slow
def test_christmas_ball_swings_in_all_frames_below_a_pivot_out_of_the_image():
    got = real("juangomez_pendulum/pendulum.mp4", "pendulum")
    assert got.n - np.diff(span(got, "motion")) <= 5
    radius = got.geometry["arc_radius"]
    assert abs(radius.value - 1.7 * 640) < 3 * radius.stderr
    assert got.geometry["pivot_z"].value > 500


@pytest.mark.slow
@pytest.mark.parametrize(("clip", "last"), [("30Deg_2_726mps", 345), ("60Deg_2_699mps", 331)])
def test_steel_ball_flies_until_its_first_contact(clip, last):
    got = real(f"phystrack/Projectile_Motion__{clip}.MP4", "projectile", fps=240.0)
    assert abs(span(got, "motion")[1] - last) <= 4


@pytest.mark.slow
@pytest.mark.parametrize(("clip", "angle_deg", "last"), [("R1", 22.0, 378), ("R3", 26.7, 254)])
def test_wooden_block_slides_to_the_end_of_the_board(clip, angle_deg, last):
    got = real(f"phystrack/SlidingFriction_{clip}.MP4", "sliding-cone", fps=240.0)
    assert np.degrees(got.geometry["angle"].value) == pytest.approx(angle_deg, abs=0.3)
    assert abs(span(got, "motion")[1] - last) <= 3
