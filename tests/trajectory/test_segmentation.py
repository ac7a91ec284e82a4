"""What happened is found where it happened, and nothing is found where nothing did."""

import numpy as np
import pytest

from iris_sysid import DataError
from iris_sysid.trajectory.segmentation import segment
from tests._motions import bouncing_ball, down_a_board, in_plane, on_arc, pendulum_angle


def spans(trajectory, label):
    return [(segment.start, segment.stop) for segment in trajectory.segments if segment.label == label]


def motion(trajectory):
    (span,) = spans(trajectory, "motion")
    return span


def reason(trajectory, label="motion"):
    return next(segment.reason for segment in trajectory.segments if segment.label == label)


# --------------------------------------------------------------------------- oscillation


@pytest.mark.parametrize("frames_per_s", [10, 30, 60, 240])
@pytest.mark.parametrize("amplitude_deg", [3, 20, 89])
@pytest.mark.parametrize("sigma", [0.02, 0.2, 1.0])
def test_swing_from_first_to_last_frame_is_all_motion(frames_per_s, amplitude_deg, sigma):
    t_s = np.arange(min(12 * frames_per_s, 600)) / frames_per_s
    arc = on_arc(pendulum_angle(t_s, np.radians(amplitude_deg)), 400.0)
    rng = np.random.default_rng([frames_per_s, amplitude_deg])
    got = segment(in_plane(t_s, arc, sigma, rng=rng), kind="oscillation")
    assert motion(got) == (0, t_s.size)
    assert got.valid.all()
    assert reason(got) == "from first sight; to the last sample"


def test_swing_without_stated_sigma_is_all_motion():
    t_s = np.arange(300) / 30
    arc = np.round(on_arc(pendulum_angle(t_s, 0.3), 400.0))  # whole pixels, as from a webcam
    world = in_plane(t_s, arc, np.nan)
    assert motion(segment(world, kind="oscillation")) == (0, 300)


def test_correlated_noise_is_not_taken_for_contact():
    rng = np.random.default_rng(3)
    t_s = np.arange(3000) / 60
    drift = np.zeros((3000, 2))
    for k in range(1, 3000):
        drift[k] = 0.9 * drift[k - 1] + 0.2 * rng.standard_normal(2)
    got = segment(in_plane(t_s, on_arc(pendulum_angle(t_s, 0.5), 300.0) + drift, 0.1), kind="oscillation")
    assert motion(got) == (0, 3000)


def test_held_bob_is_rest_until_it_is_let_go():
    rng = np.random.default_rng(1)
    t_s = np.arange(400) / 60
    theta = np.concatenate([np.full(100, 1.2), pendulum_angle(t_s[:300], 1.2)])
    got = segment(in_plane(t_s, on_arc(theta, 400.0), 0.1, rng=rng), kind="oscillation")
    ((first, last),) = spans(got, "rest")
    assert first == 0
    assert 98 <= last <= 106
    assert motion(got) == (last, 400)
    assert "it starts from rest" in reason(got)
    assert "px/s" in reason(got, "rest")


def test_hand_is_left_out_and_the_motion_follows_it():
    t_s = np.arange(200) / 30
    theta = pendulum_angle(t_s, 1.0)
    hand = np.zeros(200, bool)
    hand[[0, 1, 2, 4, 5]] = True  # a gap of one sample in the hand is the hand
    got = segment(in_plane(t_s, on_arc(theta, 400.0), 0.1, rng=np.random.default_rng(2)), hand=hand, kind="oscillation")
    assert spans(got, "hand") == [(0, 6)]
    assert motion(got) == (6, 200)
    assert "the hand lets go at 0.2 s" in reason(got)


def test_hand_that_catches_the_bob_ends_the_motion():
    t_s = np.arange(200) / 30
    hand = np.arange(200) >= 150
    world = in_plane(t_s, on_arc(pendulum_angle(t_s, 1.0), 400.0), 0.1, rng=np.random.default_rng(2))
    got = segment(world, hand=hand, kind="oscillation")
    assert motion(got) == (0, 150)
    assert "until a hand touches it at 5 s" in reason(got)


def test_single_frame_of_hand_within_the_swing_is_no_hand():
    t_s = np.arange(200) / 30
    hand = np.arange(200) == 90
    world = in_plane(t_s, on_arc(pendulum_angle(t_s, 1.0), 400.0), 0.1, rng=np.random.default_rng(2))
    assert motion(segment(world, hand=hand, kind="oscillation")) == (0, 200)


def test_gaps_do_not_end_the_motion():
    rng = np.random.default_rng(4)
    t_s = np.arange(300) / 30
    valid = rng.random(300) > 0.1
    valid[100:120] = False
    valid[[0, -1]] = True
    got = segment(in_plane(t_s, on_arc(pendulum_angle(t_s, 0.8), 400.0), 0.1, valid, rng=rng), kind="oscillation")
    assert motion(got) == (0, 300)


@pytest.mark.parametrize("size", [1, 2, 3])
def test_false_detections_are_left_out_and_named(size):
    t_s = np.arange(300) / 60
    arc = on_arc(pendulum_angle(t_s, 0.8), 400.0) + 0.1 * np.random.default_rng(5).standard_normal((300, 2))
    arc[100 : 100 + size] += [25.0, 10.0]
    got = segment(in_plane(t_s, arc, 0.1), kind="oscillation")
    assert motion(got) == (0, 300)
    np.testing.assert_array_equal(np.flatnonzero(~got.valid), np.arange(100, 100 + size))
    assert f"{size} left out that disagree with their neighbours, at 1.67" in reason(got)


def test_before_first_and_after_last_sight_there_is_no_segment():
    t_s = np.arange(200) / 60
    valid = (np.arange(200) >= 50) & (np.arange(200) < 150)
    got = segment(in_plane(t_s, on_arc(pendulum_angle(t_s, 0.8), 300.0), 0.1, valid, rng=np.random.default_rng(1)))
    assert [(segment.start, segment.stop) for segment in got.segments] == [(50, 150)]


# --------------------------------------------------------------------------- flight


@pytest.mark.parametrize("frames_per_s", [60, 120, 240])
@pytest.mark.parametrize("sigma", [0.05, 0.3])
def test_flight_ends_at_the_first_bounce(frames_per_s, sigma):
    t_s = np.arange(int(2.4 * frames_per_s)) / frames_per_s
    ball, bounces = bouncing_ball(t_s, 300.0, 1500.0, launch=300.0, speed_x=200.0)
    got = segment(in_plane(t_s, ball, sigma, rng=np.random.default_rng(frames_per_s)), kind="flight")
    start, stop = motion(got)
    assert start == 0
    assert abs(t_s[stop - 1] + 0.5 / frames_per_s - bounces[0]) <= 1.0 / frames_per_s
    assert "until velocity jumps by" in reason(got)
    contacts = np.array([t_s[start] for start, _ in spans(got, "contact")])
    assert np.min(np.abs(contacts - bounces[1])) < 2.0 / frames_per_s


def test_drop_from_rest_begins_at_the_release_which_is_no_contact():
    rng = np.random.default_rng(7)
    t_s = np.arange(200) / 120
    ball, bounces = bouncing_ball(np.clip(t_s - 0.5, 0.0, None), 800.0, 4000.0)
    got = segment(in_plane(t_s, ball, 0.1, rng=rng), kind="flight")
    start, stop = motion(got)
    assert 60 <= start <= 63
    assert abs(t_s[stop - 1] - 0.5 - bounces[0]) < 2 / 120
    assert spans(got, "rest") == [(0, start)]


def test_first_flight_is_taken_though_a_later_one_is_longer():
    t_s = np.arange(400) / 240
    ball, bounces = bouncing_ball(t_s, 150.0, 1000.0, restitution=0.95)
    assert bounces[1] - bounces[0] > bounces[0]
    got = segment(in_plane(t_s, ball, 0.1, rng=np.random.default_rng(1)), kind="flight")
    assert abs(t_s[motion(got)[1]] - bounces[0]) < 2 / 240


def test_two_flights_whose_bounce_was_not_seen_do_not_outweigh_the_first_fall():
    t_s = np.arange(150) / 60
    ball, bounces = bouncing_ball(t_s, 120.0, 1000.0, restitution=0.95)
    unseen = np.abs(t_s - bounces[1]) < 4 / 60
    got = segment(in_plane(t_s, ball, 0.1, ~unseen, rng=np.random.default_rng(4)), kind="flight")
    assert abs(t_s[motion(got)[1]] - bounces[0]) < 2 / 60


def test_ball_that_enters_and_leaves_the_image_in_flight_is_all_motion():
    t_s = np.arange(40) / 60
    ball, _ = bouncing_ball(t_s, 600.0, 1500.0, speed_x=900.0)
    valid = (np.arange(40) >= 5) & (np.arange(40) < 33)
    got = segment(in_plane(t_s, ball, 0.2, valid, rng=np.random.default_rng(9)), kind="flight")
    assert motion(got) == (5, 33)


def test_bounce_just_before_the_end_is_cut_off():
    frames_per_s = 240
    t_s = np.arange(300) / frames_per_s
    ball, bounces = bouncing_ball(t_s, 300.0, 1500.0)
    end = int(bounces[0] * frames_per_s) + 3  # two samples after the bounce
    got = segment(in_plane(t_s[:end], ball[:end], 0.1, rng=np.random.default_rng(2)), kind="flight")
    assert end - 4 <= motion(got)[1] <= end - 1  # the first sample after the bounce is nearly on course
    assert "leaves its course" in reason(got)


def test_short_toss_of_eleven_frames_is_all_motion():
    t_s = np.arange(11) * 0.0667
    ball, _ = bouncing_ball(t_s, 900.0, 4000.0, speed_x=700.0, launch=900.0)
    got = segment(in_plane(t_s, ball, 0.1, rng=np.random.default_rng(3)), kind="flight")
    assert motion(got) == (0, 11)


# --------------------------------------------------------------------------- slide


@pytest.mark.parametrize("frames_per_s", [60, 240])
@pytest.mark.parametrize("angle_deg", [15, 29, 60])
def test_slide_runs_from_rest_to_the_end_of_the_board(frames_per_s, angle_deg):
    rng = np.random.default_rng([frames_per_s, angle_deg])
    t_s = np.arange(2 * frames_per_s) / frames_per_s
    block = down_a_board(t_s, 0.5, 600.0, np.radians(angle_deg), 300.0)
    got = segment(in_plane(t_s, block, 0.1, rng=rng), kind="slide")
    start, stop = motion(got)
    assert 0.5 <= t_s[start] < 0.6
    assert -2.5 / frames_per_s < t_s[stop - 1] - 1.5 < 0.5 / frames_per_s
    assert len(spans(got, "rest")) == 2


def test_slide_ends_where_the_body_falls_off_the_line():
    rng = np.random.default_rng(6)
    t_s = np.arange(60) / 20
    block = down_a_board(t_s, 0.0, 120.0, 0.5, 1e9)
    block[45:, 1] -= 3.0 * np.arange(1, 16) ** 2
    got = segment(in_plane(t_s, block, 0.3, rng=rng), kind="slide")
    assert motion(got)[0] <= 3
    assert 43 <= motion(got)[1] <= 47
    assert "until" in reason(got)


def test_slide_is_the_way_down_the_board_though_that_along_the_floor_is_seen_longer():
    t_s = np.arange(40) / 60
    down = np.minimum(t_s, 18 / 60)
    along = np.maximum(t_s - 18 / 60, 0.0)
    x = -180 * 2 * down**2 - 1200 * along
    z = -1000 * 2 * down**2 - 60 * along - 300 * along**2
    got = segment(in_plane(t_s, np.column_stack([x, z]), 0.1, rng=np.random.default_rng(12)), kind="slide")
    start, stop = motion(got)
    assert start <= 2
    assert 17 <= stop <= 20
    assert spans(got, "contact")


def test_carrying_and_setting_down_are_not_part_of_the_slide():
    t_s = np.arange(40) / 10
    slide = down_a_board(t_s, 1.2, 150.0, 0.5, 1e9)
    carried = np.column_stack([np.linspace(-80, 0, 10), np.linspace(120, 0, 10) ** 1.1])
    slide[:10] = carried
    hand = np.arange(40) < 11
    got = segment(in_plane(t_s, slide, 0.1, rng=np.random.default_rng(8)), hand=hand, kind="slide")
    start, stop = motion(got)
    assert 11 <= start <= 14
    assert stop == 40


# --------------------------------------------------------------------------- lost frames


def without_frames(first, lost, position):
    """Times of whole frames that run on over frames which are missing from the positions."""
    left = np.delete(position, np.arange(first, first + lost), axis=0)
    return np.arange(len(left)) / 60, left


@pytest.mark.parametrize("lost", [1, 2, 3])
@pytest.mark.parametrize("first", [2, 3, 5, 6, 7, 12, 20, 24])
def test_frames_lost_in_a_slide_are_no_release_and_are_named(first, lost):
    t_s = np.arange(30) / 60
    slide = 3.0 * t_s[:, None] * [0.6, -0.8] * 100 + down_a_board(t_s, 0.0, 2000.0, np.arctan2(0.8, 0.6), 1e9)
    stamps, left = without_frames(first, lost, slide)
    got = segment(in_plane(stamps, left, 0.05, rng=np.random.default_rng([first, lost])), kind="slide")
    assert motion(got) == (0, len(left))
    assert f"ahead by the way of a lost frame or more at {stamps[first]:.3g} s" in reason(got)


@pytest.mark.parametrize("first", [4, 6, 9, 15])
def test_frame_lost_in_a_fall_is_no_release(first):
    t_s = np.arange(40) / 60
    ball, bounces = bouncing_ball(t_s, 900.0, 5000.0, launch=-300.0)
    stamps, left = without_frames(first, 1, ball)
    got = segment(in_plane(stamps, left, 0.05, rng=np.random.default_rng(first)), kind="flight")
    start, stop = motion(got)
    assert start == 0
    assert abs(stamps[stop - 1] + 1 / 60 - bounces[0]) < 2.5 / 60


@pytest.mark.parametrize("sigma", [0.02, 0.3])
def test_frame_is_not_lost_at_a_release_nor_where_a_ball_bounces(sigma):
    t_s = np.arange(240) / 240
    ball, bounces = bouncing_ball(np.clip(t_s - 0.2, 0.0, None), 400.0, 9000.0)
    got = segment(in_plane(t_s, ball, sigma, rng=np.random.default_rng(4)), kind="flight")
    assert len(bounces) > 1
    assert "lost" not in reason(got)


# --------------------------------------------------------------------------- any, labels, bad input


def test_longest_stretch_between_contacts_is_the_motion_of_any_kind():
    t_s = np.arange(300) / 100
    x = np.where(t_s < 1, 100 * t_s, 100 - 60 * (t_s - 1))
    got = segment(in_plane(t_s, np.column_stack([x, 0 * x]), 0.05, rng=np.random.default_rng(1)))
    assert motion(got) in [(100, 300), (101, 300), (99, 300)]
    assert spans(got, "release") == [(0, motion(got)[0])]
    assert "velocity jumps by 160 px/s at 1 s" in reason(got) or "velocity jumps by 1" in reason(got)


def test_the_whole_motion_begins_where_a_hold_ends_and_goes_on_over_its_bounces():
    t_s = np.arange(300) / 120
    ball, _ = bouncing_ball(t_s[:180], 150.0, 1500.0)
    world = in_plane(t_s, np.concatenate([np.tile(ball[0], (120, 1)), ball]), 0.1, rng=np.random.default_rng(1))
    at_rest = segment(world, kind="whole")
    assert 118 <= motion(at_rest)[0] <= 130
    assert motion(at_rest)[1] >= 295
    in_a_hand = segment(world, hand=np.arange(300) < 120, kind="whole")
    assert spans(in_a_hand, "hand") == [(0, 120)]
    assert motion(in_a_hand)[0] == 120


def test_segments_are_in_order_and_do_not_overlap():
    t_s = np.arange(400) / 240
    ball, _ = bouncing_ball(t_s, 150.0, 1500.0)
    got = segment(in_plane(t_s, ball, 0.1, rng=np.random.default_rng(1)), kind="flight")
    for earlier, following in zip(got.segments[:-1], got.segments[1:], strict=True):
        assert earlier.stop == following.start
    assert all(segment.reason for segment in got.segments)


def test_units_of_the_trajectory_are_in_the_reasons():
    t_s = np.arange(300) / 240
    ball, _ = bouncing_ball(t_s, 0.5, 9.81)
    got = segment(in_plane(t_s, ball, 0.0005, unit="m", rng=np.random.default_rng(1)), kind="flight")
    assert "m/s at 0.3" in reason(got)


def test_few_samples_are_motion():
    got = segment(in_plane(np.arange(3) / 10, np.arange(6).reshape(3, 2), 0.1))
    assert motion(got) == (0, 3)


MOVING = in_plane(np.arange(60) / 30, np.column_stack([np.arange(60.0), np.zeros(60)]), 0.1)


@pytest.mark.parametrize(
    ("world", "options", "message"),
    [
        (MOVING.with_(valid=np.zeros(60, bool)), {}, "none of the 60 samples is valid"),
        (MOVING, {"hand": np.ones(60, bool)}, "in a hand in all of the 60 samples.* --mark 1=x,y@frame"),
        (MOVING, {"hand": np.ones(59, bool)}, r"hand must have shape \(60,\)"),
        (MOVING, {"kind": "jump"}, "there are oscillation, slide, flight, any, whole"),
        (
            MOVING.with_(position=np.full((60, 2), 7.0)),
            {},
            "the body does not move: it stays within 1.5 times the noise",
        ),
    ],
)
def test_segment_refuses_with_the_reason(world, options, message):
    with pytest.raises(DataError, match=message):
        segment(world, **options)


@pytest.mark.slow
def test_false_contacts_in_two_hundred_clean_clips_are_none():
    rng = np.random.default_rng(0)
    left_out = total = 0
    for _ in range(200):
        frames_per_s = int(rng.choice([10, 30, 60, 240]))
        t_s = np.arange(int(rng.uniform(3, 12) * min(frames_per_s, 100))) / frames_per_s
        theta = pendulum_angle(t_s, np.radians(rng.uniform(3, 90)), rng.uniform(0.3, 1.7))
        sigma = 10 ** rng.uniform(-2, 0)
        noise = sigma * rng.standard_t(4, (t_s.size, 2)) / np.sqrt(2)  # longer tails than the normal
        got = segment(in_plane(t_s, on_arc(theta, rng.uniform(100, 900)) + noise, sigma), kind="oscillation")
        assert motion(got) == (0, t_s.size)
        left_out += np.sum(~got.valid)
        total += t_s.size
    assert left_out < 0.001 * total


def thrown(*parts, rate_hz=30.0):
    """Positions of flights at 1000 px/s^2 one after another, each by its samples and the velocity it begins with."""
    at, flights = np.zeros(2), []
    for samples, *velocity in parts:
        t_s = np.arange(samples + 1)[:, None] / rate_hz
        way = at + t_s * velocity - 0.5 * t_s**2 * [0.0, 1000.0]
        flights.append(way[:-1])
        at = way[-1]
    return np.concatenate(flights)


def test_a_flight_ends_where_a_net_takes_the_ball_though_a_bounce_follows_at_once():
    way = thrown((20, -500.0, 300.0), (6, 150.0, -200.0), (14, 250.0, 450.0))
    seen = ~np.isin(np.arange(40), [20, 26, 27])
    got = segment(in_plane(np.arange(40) / 30, way, 0.3, seen, rng=np.random.default_rng(0)), kind="flight")
    start, stop = motion(got)
    assert start == 0
    assert 18 <= stop <= 20


@pytest.mark.parametrize("rate_hz", [60, 240])
def test_a_flight_begins_where_the_hand_that_leads_it_lets_go(rate_hz):
    t_s = np.arange(1.5 * rate_hz) / rate_hz - 0.25
    led = np.expm1(np.minimum(t_s, 0.0) / 0.25)
    way = np.where(t_s < 0, led, 0.0)[:, None] * [75.0, 125.0] + np.maximum(t_s, 0.0)[:, None] * [300.0, 500.0]
    way[:, 1] -= 500.0 * np.maximum(t_s, 0.0) ** 2
    start, stop = motion(segment(in_plane(t_s, way, 0.1, rng=np.random.default_rng(1)), kind="flight"))
    assert abs(t_s[start]) < 0.02
    assert stop == t_s.size


def test_a_long_roll_on_the_floor_is_no_flight():
    flight, t_s = thrown((14, 250.0, 100.0)), np.arange(90) / 30
    roll = np.column_stack([150.0 * t_s - 12.0 * t_s**2, -2.0 * t_s**2]) + flight[-1] + [8.0, -6.0]
    got = segment(
        in_plane(np.arange(104) / 30, np.concatenate([flight, roll]), 0.3, rng=np.random.default_rng(0)), kind="flight"
    )
    start, stop = motion(got)
    assert start == 0
    assert stop <= 15
