"""The median-background tracker on the real recordings: the body and not its shadow, cord or hand, and smoothly."""

import numpy as np
import pytest

from iris_sysid import open_video, read_osp
from iris_sysid.types import TrackOptions
from tests._project import recording
from trackers.median_background import track


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def real_track(name, **options):
    return track(open_video(recording(name)), TrackOptions(**options))


def residual_px(track, rows, window=11, degree=4):
    """Robust rms residual of local polynomials in time: jitter that no body can have."""
    parts = []
    for start in range(rows.start, rows.stop - window, window // 2):
        part = slice(start, start + window)
        t_s = track.t_s[part] - track.t_s[part].mean()
        fit = np.polynomial.Polynomial.fit
        parts.append([np.sum((x - fit(t_s, x, degree)(t_s)) ** 2) / (window - degree - 1) for x in track.xy_px[part].T])
    return np.sqrt(np.median(parts, axis=0))


@pytest.mark.slow
def test_christmas_ball_on_a_string_is_followed_smoothly():
    (track,) = real_track("juangomez_pendulum/pendulum.mp4")
    assert track.n_valid >= 304
    assert not track.hand.any()
    assert residual_px(track, slice(0, 305)).max() < 0.08
    assert np.ptp(track.xy_px[:, 0]) > 500


def test_iris_pendulum_is_the_ball_without_cord_and_hand():
    (track,) = real_track("iris_footage/pendulum.gif")
    assert track.valid[4:].all()
    assert track.hand[:4].all()
    assert not track.hand[4:].any()
    np.testing.assert_allclose(track.radius_px[4:], 25, atol=3.5)
    x, y = track.xy_px[14:].T
    columns = np.column_stack([2 * x, 2 * y, np.ones_like(x)])
    a, b, c = np.linalg.lstsq(columns, x**2 + y**2, rcond=None)[0]
    off_circle = np.hypot(x - a, y - b) - np.sqrt(c + a**2 + b**2)
    assert rms(off_circle) < 3  # the cord stretches and the camera shakes by that much


@pytest.mark.slow
def test_iris_sliding_cone_is_the_same_by_brightness_and_by_colour():
    (track,) = real_track("iris_footage/Sliding_cone.gif")
    (red,) = real_track("iris_footage/Sliding_cone.gif", colour="red")
    slide = slice(13, 30)
    for body in (track, red):
        assert body.hand[1:13].all()
        assert not body.hand[slide].any()
        assert body.valid[slide].all()
    np.testing.assert_allclose(track.xy_px[slide], red.xy_px[slide], atol=1.0)
    slope = np.polynomial.Polynomial.fit(*red.xy_px[slide].T, 1).convert().coef[1]
    assert np.degrees(np.arctan(-slope)) == pytest.approx(29, abs=1)  # the board as it stands in the image


@pytest.mark.slow
def test_iris_two_pendulums_are_the_light_and_the_dark_ball_throughout():
    tracks = real_track("iris_footage/Two_Moving_Pendulums.gif", bodies=2)
    dark, light = sorted(tracks, key=lambda body: np.nanmedian(body.intensity))
    for body in (dark, light):
        assert body.valid[10:].all()
        assert body.hand[:10].all()
    assert np.all(dark.intensity[10:] < light.intensity[10:])
    assert np.all(dark.xy_px[10:, 0] < light.xy_px[10:, 0])


@pytest.mark.parametrize(
    ("name", "flight", "rate_hz", "angle_deg"),
    [
        ("phystrack/Projectile_Motion__30Deg_2_726mps.MP4", slice(262, 325), 240.0, 30.0),
        ("phystrack/Projectile_Motion__60Deg_2_699mps.MP4", slice(200, 325), 240.0, 60.0),
    ],
)
def test_steel_ball_in_flight_is_the_ball_and_not_its_shadow(name, flight, rate_hz, angle_deg):
    (track,) = real_track(name)
    assert track.valid[flight].all()
    t_s = (track.frame[flight] - track.frame[flight][0]) / rate_hz
    across, down = (np.polynomial.Polynomial.fit(t_s, x, 2) for x in track.xy_px[flight].T)
    assert max(rms(track.xy_px[flight, 0] - across(t_s)), rms(track.xy_px[flight, 1] - down(t_s))) < 0.5
    assert down.convert().coef[2] * 2 / 9.79 == pytest.approx(315, rel=0.05)  # px/m, from gravity
    np.testing.assert_allclose(track.radius_px[flight], 3.2, atol=0.9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "slide"),
    [("phystrack/SlidingFriction_R1.MP4", slice(120, 390)), ("phystrack/SlidingFriction_R3.MP4", slice(85, 260))],
)
def test_block_on_the_incline_is_followed_smoothly(name, slide):
    (track,) = real_track(name)
    assert track.valid[slide].all()
    assert residual_px(track, slide).max() < 0.06


@pytest.mark.slow
def test_pucks_are_followed_through_their_collision_to_rest():
    resting, struck = sorted(real_track("phystrack/CaromPuck_HeadOn.MP4", bodies=2), key=lambda track: -track.n_valid)
    assert resting.n_valid == 752
    assert struck.valid[:274].all()
    assert np.ptp(resting.xy_px[320:], axis=0).max() < 0.7  # at rest where it stopped
    np.testing.assert_allclose(resting.radius_px[:270], struck.radius_px[:270], atol=1.5)


def test_tossed_ball_agrees_with_the_marks_made_by_hand():
    (track,) = real_track("tracker_balltoss/BallToss.trz")
    ((frames, marks),) = read_osp(recording("tracker_balltoss/BallToss.trz")).marks.values()
    assert track.valid[frames].all()
    assert rms(np.linalg.norm(track.xy_px[frames] - marks, axis=1)) <= 0.7
