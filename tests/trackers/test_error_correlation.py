"""Autocorrelation of position errors, measured from the lobes of the outline."""

import tracemalloc

import numpy as np
import pytest
from scipy.signal import lfilter

from iris_sysid.errors import DataError
from iris_sysid.types import ErrorAutocorrelation
from trackers._uncertainty.error_correlation import outline_autocorrelation, outline_lobes, outline_scatter

PARTIAL = (0.5, 0.15)  # as of a ball of 10 px in H.264 at a phone's bit rate
RADIUS = np.full(64, 10.0)
COEFFICIENTS = (0.425, 0.15)  # of the autoregression with those partial autocorrelations


def correlated(rng, count, width=1):
    """Noise (count, width) of unit innovations with those partial autocorrelations."""
    noise = rng.standard_normal((count + 100, width))
    return lfilter([1.0], [1.0, *(-value for value in COEFFICIENTS)], noise, axis=0)[100:]


def falling(count):
    frame = np.arange(count)
    return frame, np.column_stack([np.full(count, 100.0), 50 + 0.4 * frame**1.5])


def bent_disc(x, y, radius, bend, finer=16):
    """Share of each pixel (64, 64) inside of the outline radius + bend(angle)."""
    fine = (np.arange(64 * finer) + 0.5) / finer - 0.5
    across, down = np.meshgrid(fine - x, fine - y)
    inside = np.hypot(across, down) < radius + bend(np.arctan2(down, across))
    return inside.reshape(64, finer, 64, finer).mean(axis=(1, 3)).astype(np.float32)


def test_lobes_of_an_outline_are_its_fourier_amplitudes():
    share = bent_disc(31.3, 30.6, 12.0, lambda angle: 0.3 * np.cos(3 * angle) - 0.2 * np.sin(5 * angle))
    np.testing.assert_allclose(outline_lobes(share, 31.3, 30.6, np.pi * 144), [0.3, 0, 0, -0.2], atol=0.02)


@pytest.mark.parametrize("bend", [lambda angle: 0 * angle, lambda angle: 2 * np.cos(2 * angle)])
def test_disc_and_streak_have_no_odd_lobes(bend):
    share = bent_disc(31.3, 30.6, 12.0, bend)
    np.testing.assert_allclose(outline_lobes(share, 31.3, 30.6, float(share.sum())), 0, atol=0.03)


def measured(rng, count=30, drift=0.0, noise=correlated):
    """Partial autocorrelations (count, 2) of simulated outlines, and their standard errors."""
    clips = [outline_autocorrelation(*falling(64), 0.05 * (noise(rng) + drift), RADIUS) for _ in range(count)]
    return np.array([clip.partial for clip in clips]), np.array([clip.stderr for clip in clips])


def test_autocorrelation_of_the_lobes_is_that_of_the_noise_they_were_made_from():
    values, stderrs = measured(np.random.default_rng(0), noise=lambda rng: correlated(rng, 64, 4))
    np.testing.assert_allclose(values.mean(axis=0), PARTIAL, atol=0.06)
    np.testing.assert_allclose(values.std(axis=0) / stderrs.mean(axis=0), 1.0, atol=0.35)


def test_shading_that_changes_with_the_position_is_no_autocorrelation():
    drift = np.linspace(-1, 1, 64)[:, np.newaxis] ** 2
    values, _ = measured(np.random.default_rng(1), 10, drift, lambda rng: rng.standard_normal((64, 4)))
    assert values[:, 0].mean() < 0.15


def test_outlier_lobes_in_front_of_a_floor_do_not_hide_the_autocorrelation():
    rng, (frame, xy_px) = np.random.default_rng(2), falling(64)
    lobes = 0.05 * correlated(rng, 64, 4)
    lobes[60:] += 0.8 * rng.standard_normal((4, 4))
    assert outline_autocorrelation(frame, xy_px, lobes, RADIUS).partial[0] > 0.3


@pytest.mark.parametrize(
    ("count", "speed", "lobe"),
    [(64, 0.0, 0.05), (30, 1.0, 0.05), (64, 1.0, 5.0)],
    ids=["resting body", "short track", "no disc"],
)
def test_outline_determines_no_autocorrelation_for(count, speed, lobe):
    rng, (frame, xy_px) = np.random.default_rng(3), falling(count)
    lobes = lobe * correlated(rng, count, 4)
    assert outline_autocorrelation(frame, speed * xy_px, lobes, np.full(count, 10.0)) is None


def test_error_autocorrelation_with_a_model_error_adds_in_quadrature():
    stated = ErrorAutocorrelation((0.5, 0.1), (0.3, 0.4)).with_model_error(0.3)
    assert stated.partial == (0.5, 0.1)
    assert stated.stderr == pytest.approx((0.4243, 0.5), abs=1e-4)


@pytest.mark.parametrize(
    ("partial", "stderr", "match"),
    [
        ((), (), "at least one"),
        ((0.5,), (), "as many"),
        ((1.0,), (0.1,), "between -1 and 1"),
        ((0.5,), (0.0,), "positive"),
    ],
)
def test_error_autocorrelation_refuses_what_is_not_possible(partial, stderr, match):
    with pytest.raises(DataError, match=match):
        ErrorAutocorrelation(partial, stderr)


def test_scatter_of_a_long_track_takes_memory_in_proportion_to_its_length():
    count = 40_000
    frame = np.arange(count)
    lobes = 0.1 * np.random.default_rng(0).standard_normal((count, 4))
    xy_px = np.column_stack([200 + 100 * np.sin(0.02 * frame), np.full(count, 100.0)])
    tracemalloc.start()
    assert outline_scatter(frame, xy_px, lobes, np.full(count, 10.0)) == pytest.approx(0.1, rel=0.1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40 * lobes.nbytes  # a thousand times, where each stretch held a copy of all
