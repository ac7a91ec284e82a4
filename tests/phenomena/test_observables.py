"""Observables other than position: angle, light, level and radius of a track, segmented, fit the truth."""

import numpy as np
import pytest

from iris_sysid import PHENOMENA, DataError, Estimate
from iris_sysid.calibration.pixel_scale import scale, uncalibrated
from iris_sysid.pipeline.one_clip import observe_and_fit
from iris_sysid.types import Track

T_S = np.arange(240) / 60
MOVED_S = np.maximum(T_S - 0.5, 0.0)  # at rest for half a second


def track_of(sigma, xy_px=(100.0, 80.0), **columns):
    n = T_S.size
    place = np.broadcast_to(np.array(xy_px).T, (n, 2)) if np.ndim(xy_px[1]) == 0 else np.column_stack(xy_px)
    errors = {f"sigma_{name}": np.full(n, sigma) for name in columns}
    return Track(T_S, place, np.full((n, 2), sigma), np.ones(n, bool), np.arange(n), **columns, **errors)


def fitted(name, track, calibration=None, **settings):
    return observe_and_fit([track], calibration or uncalibrated(), PHENOMENA[name], settings)[2]


def noise(sigma):
    return np.random.default_rng(0).normal(0, sigma, T_S.size)


def test_rate_of_a_fading_lamp_is_found_above_its_background():
    fit = fitted("led", track_of(0.1, intensity=40 + 180 * np.exp(-2.0 * MOVED_S) + noise(0.1)))
    low, high = fit.estimates["decay_rate"].interval
    assert low < 2.0 < high
    assert fit.estimates["background"].value == pytest.approx(40, abs=0.2)


def test_outflow_and_hole_of_a_draining_vessel_are_found():
    level = (np.sqrt(0.2) - 0.03 * MOVED_S / 2) ** 2
    row = 500 - 1000 * (0.1 + level) + noise(0.05)
    fit = fitted("torricelli", track_of(0.05, (np.full(T_S.size, 300.0), row)), scale(1000.0, 1.0))
    low, high = fit.estimates["outflow"].interval
    assert low < 0.03 < high


def test_gravity_of_a_falling_ball_follows_from_the_stated_distance():
    distance = 0.75 + 9.7 * MOVED_S**2 / 2
    fit = fitted("falling-ball", track_of(0.02, radius_px=90 / distance + noise(0.02)), h0=Estimate(0.75, 0.0, "m"))
    low, high = fit.estimates["gravity"].interval
    assert low < 9.7 < high


def test_track_without_what_is_measured_is_refused_with_the_tracker_to_use():
    with pytest.raises(DataError, match=r"needs the angle of the body.*use the tracker orientation"):
        fitted("rotating-cone", track_of(0.1, intensity=np.ones(T_S.size)))


def test_interval_of_an_outflow_allows_for_errors_that_the_rows_of_a_surface_have_in_common():
    level = (np.sqrt(0.2) - 0.03 * MOVED_S / 2) ** 2
    row, inside = 500 - 1000 * (0.1 + level), 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        common = np.interp(row, np.arange(150.0, 500.0, 16.0), rng.normal(0, 0.0175, 22))
        seen = row + common + rng.normal(0, 0.05, T_S.size)
        fit = fitted("torricelli", track_of(0.05, (np.full(T_S.size, 300.0), seen)), scale(1000.0, 1.0))
        low, high = fit.estimates["outflow"].interval
        assert fit.budget["outflow"]["surface"] > 0.5 * fit.budget["outflow"]["random"]
        inside += low < 0.03 < high
    assert inside >= 17
