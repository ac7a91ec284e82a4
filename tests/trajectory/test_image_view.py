"""The view of a trajectory leads from its coordinates back to the pixels that were tracked."""

import numpy as np
import pytest

from iris_sysid import Estimate, observe, scale, uncalibrated
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import Track

SIZE = (1280, 720)
T_S = np.arange(120) / 60


def track(xy_px, **more):
    rng = np.random.default_rng(0)
    seen = xy_px + 0.05 * rng.standard_normal(xy_px.shape)
    n = len(seen)
    return Track(
        t_s=T_S[:n], xy_px=seen, sigma_px=np.full((n, 2), 0.05), valid=np.ones(n, bool), frame=np.arange(n), **more
    )


def swing():
    theta = 0.6 * np.cos(4.4 * T_S)
    return np.column_stack([700 + 400 * np.sin(theta), 120 + 400 * np.cos(theta)])


def throw():
    t_s = T_S[:50]
    return np.column_stack([200 + 600 * t_s, 500 - 900 * t_s + 1100 * t_s**2])


def fall():
    t_s = T_S[:40]
    return np.column_stack([np.full(t_s.size, 640.0), 80 + 1100 * t_s**2])


def slide():
    way = 60 * T_S + 120 * T_S**2
    return np.column_stack([200 + 0.8 * way, 100 + 0.6 * way])


@pytest.mark.parametrize(
    ("phenomenon", "motion"),
    [("pendulum", swing), ("projectile", throw), ("dropping-ball", fall), ("sliding-cone", slide)],
)
@pytest.mark.parametrize("calibration", [scale(400, 1.0), uncalibrated()], ids=["m", "px"])
def test_view_shows_the_coordinates_where_the_body_was_tracked(phenomenon, motion, calibration):
    body = track(motion())
    _, trajectory = observe([body], calibration, phenomenon, image_size=SIZE)
    view = trajectory.view
    assert trajectory.sensor == "camera"
    assert view.size_px == SIZE
    assert view.axis_px == (639.5, 359.5)
    assert view.measured
    used = trajectory.valid & trajectory.mask("motion")
    np.testing.assert_allclose(view.points_px(trajectory.position[used]), body.xy_px[used], atol=1.0)


def test_view_knows_where_the_pivot_comes_from():
    body, calibration = track(swing()), scale(400, 1.0)
    marked = observe([body], calibration, "pendulum", marks_px={"pivot": (700.0, 120.0)})[1]
    on_arc = observe([body], calibration, "pendulum")[1]
    known = observe([body], calibration, "pendulum", {"arc_radius": Estimate(1.0, 0.001, "m", "direct")})[1]
    assert [clip.view.pivot for clip in (marked, on_arc, known)] == ["marked", "arc", "arc-of-known-radius"]
    for clip in (marked, on_arc, known):
        np.testing.assert_allclose(clip.view.origin_px, (700, 120), atol=2)
        np.testing.assert_allclose(np.hypot(*clip.view.right_px), 400, rtol=5e-3)


def test_picture_of_unknown_size_lies_about_the_motion():
    view = observe([track(throw())], uncalibrated(), "projectile")[1].view
    low, high = throw().min(axis=0), throw().max(axis=0)
    np.testing.assert_allclose(view.axis_px, (low + high) / 2, atol=1)
    assert view.size_px[1] > np.max(high - low)


def test_brightness_and_radius_have_no_view():
    lamp = track(np.full((120, 2), 50.0), intensity=200 * np.exp(-T_S))
    assert observe([lamp], uncalibrated(), "led", image_size=SIZE)[1].view is None
    assert PHENOMENA["led"].measures == "intensity"
