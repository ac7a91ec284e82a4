"""Angle, level and light by the trackers of what does not move along: exact on drawn clips, with errors that hold."""

import numpy as np
import pytest

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.registry import TRACKERS
from iris_sysid.types import TrackOptions, Transfer
from tests._changing import AXIS, SHAPE, WALLS, draining, fading, turning
from tests._drawn import DrawnClip, moving_disc, noisy, swing
from trackers._uncertainty.local_polynomial import excess_scatter


def tracked(name, clip, **options):
    (track,) = TRACKERS[name].track(clip, TrackOptions(**options))
    return track


def pull_sd(error, sigma):
    return float(np.std(error / sigma))


def test_orientation_is_found_within_a_tenth_of_a_degree_over_more_than_a_turn():
    angle = np.radians(20 - 7.0 * np.arange(80))
    track = tracked("orientation", turning(angle))
    error = track.angle_rad - angle
    error -= np.median(error)  # the zero is the direction of the middle, which all frames share
    assert track.valid.all()
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.1
    assert pull_sd(error, track.sigma_angle_rad) < 1.6
    assert np.hypot(*(np.array(track.origin["axis_px"]) - AXIS)) < 0.2


def test_orientation_follows_a_swing_to_and_fro():
    angle = np.radians(60 * np.cos(2 * np.pi * np.arange(90) / 50))
    error = tracked("orientation", turning(angle)).angle_rad - angle
    assert np.degrees(np.std(error)) < 0.1


def test_orientation_refuses_what_moves_without_turning():
    path = np.column_stack([np.linspace(20, 140, 40), np.full(40, 50.0)])
    with pytest.raises(TrackingError, match="does not rotate about a point in the image"):
        tracked("orientation", moving_disc(path, 8, SHAPE))


def test_orientation_refuses_more_than_one_body():
    with pytest.raises(DataError, match="follows one body"):
        tracked("orientation", turning(np.linspace(0, 3, 20)), bodies=2)


@pytest.mark.parametrize(("slope", "climb"), [(0.0, 0.0), (0.03, 0.0), (0.0, 3.0)])
def test_level_is_found_within_a_tenth_of_a_pixel_tilted_or_climbing_the_walls(slope, climb):
    level = 30 + 60 * (1 - (1 - np.linspace(0, 0.9, 80)) ** 2)
    track = tracked("level", draining(level, slope=slope, climb=climb))
    error = track.xy_px[:, 1] - level
    assert track.valid.all()
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert track.xy_px[0, 0] == pytest.approx((sum(WALLS) - 1) / 2, abs=2.0)


def test_errors_of_the_level_are_as_large_as_stated():
    level = np.linspace(30.0, 90.0, 150)
    track = tracked("level", draining(level, noise=3.0))
    assert 0.8 < pull_sd(track.xy_px[:, 1] - level, track.sigma_px[:, 1]) < 1.2


def test_level_that_leaves_the_image_is_a_gap():
    level = np.linspace(60.0, 130.0, 80)  # the image ends at 119.5
    track = tracked("level", draining(level))
    assert not track.valid[level > 121].any()
    assert track.valid[level < 110].all()


@pytest.mark.parametrize("name", ["orientation", "level", "intensity"])
def test_clip_in_which_nothing_changes_is_refused(name):
    with pytest.raises(TrackingError, match=r"nothing in the clip|no surface moves"):
        tracked(name, DrawnClip(noisy([np.full(SHAPE, 90.0)] * 20, 2.0)))


def test_level_refuses_what_passes_by():
    with pytest.raises(TrackingError, match="not the surface of a liquid"):
        tracked("level", moving_disc(swing(40, (80, 60), (60, 0), period=20), 14, SHAPE))


def test_light_is_found_within_half_a_percent_with_errors_as_stated():
    clip, light = fading(150)
    track = tracked("intensity", clip, transfer=Transfer("linear"))
    line = np.polyfit(light, track.intensity, 1)
    error = track.intensity - np.polyval(line, light)
    assert np.sqrt(np.mean(error**2)) < 0.005 * line[0]
    assert 0.8 < pull_sd(error, track.sigma_intensity) < 1.2


def test_light_refuses_what_moves():
    with pytest.raises(TrackingError, match="does not change as a whole"):
        tracked("intensity", moving_disc(swing(40, (80, 60), (40, 20), period=37.3), 9, SHAPE))


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_scatter_about_a_smooth_path_is_distinguished_from_the_stated_error(factor):
    rng, t_s = np.random.default_rng(1), np.arange(400) / 60
    values = np.exp(-t_s) + factor * 1e-3 * rng.normal(size=400)
    assert np.mean(excess_scatter(t_s, values, np.full(400, 1e-3))) == pytest.approx(factor, rel=0.1)


def test_smooth_path_that_swings_fast_is_not_taken_for_scatter():
    rng, t_s = np.random.default_rng(2), np.arange(400) / 60
    values = np.sin(2 * np.pi * 1.5 * t_s) + 1e-3 * rng.normal(size=400)
    assert np.mean(excess_scatter(t_s, values, np.full(400, 1e-3))) < 1.2
