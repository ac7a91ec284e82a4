"""Errors of a place that last over frames: told by the outline's lobes, allowed for by fits too short to see them."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fitters.noise.autoregression import coefficients_of
from fitters.noise.sandwich_covariance import inverse_normal, quantile_975, random_uncertainty
from fitters.ode import fit
from iris_sysid.calibration.pixel_scale import to_world, uncalibrated
from iris_sysid.registry import MODELS
from iris_sysid.types import Estimate, Quantity, Track, Trajectory
from trackers._uncertainty.error_correlation import lobes, memory

PARTIAL = (0.5, 0.15)  # as of a ball of 10 px in H.264 at a phone's bit rate
STATED = tuple(Estimate(value, 0.15, "1") for value in PARTIAL)


def lasting(rng, count, width=1):
    """Noise (count, width) of unit innovations with those partial autocorrelations."""
    noise = rng.standard_normal((count + 100, width))
    return lfilter([1.0], np.append(1.0, -coefficients_of(np.array(PARTIAL))[-1]), noise, axis=0)[100:]


def falling(count):
    frame = np.arange(count)
    return frame, np.column_stack([np.full(count, 100.0), 50 + 0.4 * frame**1.5])


# --------------------------------------------------------------------------- the outline


def bent_disc(x, y, radius, bend, finer=16):
    """Share of each pixel (64, 64) inside of the outline radius + bend(angle)."""
    fine = (np.arange(64 * finer) + 0.5) / finer - 0.5
    across, down = np.meshgrid(fine - x, fine - y)
    inside = np.hypot(across, down) < radius + bend(np.arctan2(down, across))
    return inside.reshape(64, finer, 64, finer).mean(axis=(1, 3)).astype(np.float32)


def test_lobes_of_an_outline_are_its_fourier_amplitudes():
    share = bent_disc(31.3, 30.6, 12.0, lambda angle: 0.3 * np.cos(3 * angle) - 0.2 * np.sin(5 * angle))
    np.testing.assert_allclose(lobes(share, 31.3, 30.6, np.pi * 144), [0.3, 0, 0, -0.2], atol=0.02)


@pytest.mark.parametrize("bend", [lambda angle: 0 * angle, lambda angle: 2 * np.cos(2 * angle)])
def test_disc_and_streak_have_no_odd_lobes(bend):
    share = bent_disc(31.3, 30.6, 12.0, bend)
    np.testing.assert_allclose(lobes(share, 31.3, 30.6, float(share.sum())), 0, atol=0.03)


def test_memory_of_the_lobes_is_that_of_the_noise_they_were_made_from():
    rng = np.random.default_rng(0)
    found = [memory(*falling(64), 0.05 * lasting(rng, 64, 4), np.full(64, 10.0)) for _ in range(30)]
    values, stderrs = np.moveaxis(np.array(found), 2, 0)
    np.testing.assert_allclose(values.mean(axis=0), PARTIAL, atol=0.06)
    np.testing.assert_allclose(values.std(axis=0) / stderrs.mean(axis=0), 1.0, atol=0.35)


def test_shading_that_changes_with_the_place_is_no_memory():
    rng, (frame, xy_px) = np.random.default_rng(1), falling(64)
    drift = np.linspace(-1, 1, 64)[:, np.newaxis] ** 2
    found = [memory(frame, xy_px, 0.05 * (rng.standard_normal((64, 4)) + drift), np.full(64, 10.0)) for _ in range(10)]
    assert np.mean(found, axis=0)[0, 0] < 0.15


def test_wild_lobes_in_front_of_a_floor_do_not_hide_the_memory():
    rng, (frame, xy_px) = np.random.default_rng(2), falling(64)
    bends = 0.05 * lasting(rng, 64, 4)
    bends[60:] += 0.8 * rng.standard_normal((4, 4))
    assert memory(frame, xy_px, bends, np.full(64, 10.0))[0][0] > 0.3


@pytest.mark.parametrize(
    ("count", "way", "bent"), [(64, 0.0, 0.05), (30, 1.0, 0.05), (64, 1.0, 5.0)], ids=["rests", "short", "no disc"]
)
def test_outline_says_nothing_of_a_body_that(count, way, bent):
    rng, (frame, xy_px) = np.random.default_rng(3), falling(count)
    assert memory(frame, way * xy_px, bent * lasting(rng, count, 4), np.full(count, 10.0)) == []


# --------------------------------------------------------------------------- the fit


def pulls(memory_of, count, clips=200):
    """Errors of the curvature of parabolas through lasting noise over their standard errors, and the limits of 95 %."""
    rng, u = np.random.default_rng(4), np.linspace(-1, 1, count)
    columns = np.vander(u, 3)
    bread = inverse_normal(columns)
    pull, limit = [], []
    for _ in range(clips):
        noise = lasting(rng, count)
        values = bread @ columns.T @ noise
        found = random_uncertainty(np.arange(count) / 60, noise - columns @ values, columns[:, None], bread, memory_of)
        pull.append(values[0, 0] / np.sqrt(found.covariance[0, 0]))
        limit.append(quantile_975(found.degrees[0]))
    return np.array(pull), np.array(limit)


def test_intervals_of_a_short_fit_hold_the_truth_where_the_memory_is_known():
    pull, limit = pulls(STATED, 25)
    assert 0.92 <= np.mean(np.abs(pull) < limit) <= 0.985  # 95 % of 200 is known to 1.5 %
    assert np.sqrt(np.mean(pull**2)) == pytest.approx(1.0, abs=0.15)


def test_residual_of_a_short_fit_does_not_show_the_memory():
    pull, _ = pulls((), 25)
    assert np.sqrt(np.mean(pull**2)) > 1.5


def test_long_residual_speaks_for_itself():
    alone, _ = pulls((), 200, clips=3)
    told, _ = pulls(tuple(Estimate(0.9, 0.1, "1") for _ in range(2)), 200, clips=3)
    np.testing.assert_array_equal(alone, told)


def test_memory_of_a_track_reaches_the_fit_of_its_fall():
    count, rng = 25, np.random.default_rng(5)
    t_s = np.arange(count) / 60
    xy_px = np.column_stack([np.zeros(count), 0.5 * 3000 * t_s**2 + 0.1 * lasting(rng, count)[:, 0]])
    known = {"error_memory": [(0.5, 0.1), (0.15, 0.1)]}
    fits = []
    for origin in (known, {}):
        track = Track(t_s, xy_px, np.full((count, 2), 0.1), np.ones(count, bool), np.arange(count), origin=origin)
        world = to_world(track, uncalibrated())
        fall = Trajectory(
            t_s,
            (Quantity("z", "px", "z"),),
            world.position[:, 1:],
            world.sigma[:, 1:],
            world.valid,
            geometry=world.geometry,
        )
        fits.append(fit(fall, MODELS["free-fall"]).estimates["gravity"])
    assert fits[0].value == pytest.approx(fits[1].value, rel=1e-6)
    assert 1.3 < fits[0].stderr / fits[1].stderr < 3
