"""Fits too short to see the autocorrelation of their noise take the one that the tracker measured."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fitters.noise.autoregression import coefficients_of
from fitters.noise.sandwich_covariance import inverse_normal, quantile_975, random_uncertainty
from fitters.ode import fit
from iris_sysid.calibration.pixel_scale import to_world, uncalibrated
from iris_sysid.registry import MODELS
from iris_sysid.types import ErrorAutocorrelation, Quantity, Track, Trajectory

PARTIAL = (0.5, 0.15)  # as of a ball of 10 px in H.264 at a phone's bit rate
MEASURED = ErrorAutocorrelation(PARTIAL, (0.15, 0.15))


def correlated(rng, count, width=1):
    """Noise (count, width) of unit innovations with those partial autocorrelations."""
    noise = rng.standard_normal((count + 100, width))
    return lfilter([1.0], np.append(1.0, -coefficients_of(np.array(PARTIAL))[-1]), noise, axis=0)[100:]


def pulls(measured, count, clips=200):
    """Errors of the curvature of parabolas through correlated noise over their standard errors; 95 % limits."""
    rng, u = np.random.default_rng(4), np.linspace(-1, 1, count)
    columns = np.vander(u, 3)
    bread = inverse_normal(columns)
    pull, limit = [], []
    for _ in range(clips):
        noise = correlated(rng, count)
        values = bread @ columns.T @ noise
        uncertainty = random_uncertainty(
            np.arange(count) / 60, noise - columns @ values, columns[:, None], bread, measured
        )
        pull.append(values[0, 0] / np.sqrt(uncertainty.covariance[0, 0]))
        limit.append(quantile_975(uncertainty.degrees[0]))
    return np.array(pull), np.array(limit)


def test_intervals_of_a_short_fit_hold_the_truth_where_the_autocorrelation_is_measured():
    pull, limit = pulls(MEASURED, 25)
    assert 0.92 <= np.mean(np.abs(pull) < limit) <= 0.985  # 95 % of 200 is known to 1.5 %
    assert np.sqrt(np.mean(pull**2)) == pytest.approx(1.0, abs=0.15)


def test_residual_of_a_short_fit_does_not_show_the_autocorrelation():
    pull, _ = pulls(None, 25)
    assert np.sqrt(np.mean(pull**2)) > 1.5


def test_long_residual_outweighs_the_measured_autocorrelation():
    alone, _ = pulls(None, 200, clips=3)
    informed, _ = pulls(ErrorAutocorrelation((0.9, 0.9), (0.1, 0.1)), 200, clips=3)
    np.testing.assert_array_equal(alone, informed)


def test_error_autocorrelation_of_a_track_reaches_the_fit_of_its_fall():
    count, rng = 25, np.random.default_rng(5)
    t_s = np.arange(count) / 60
    xy_px = np.column_stack([np.zeros(count), 0.5 * 3000 * t_s**2 + 0.1 * correlated(rng, count)[:, 0]])
    fits = []
    for measured in (ErrorAutocorrelation(PARTIAL, (0.1, 0.1)), None):
        sigma_px, valid = np.full((count, 2), 0.1), np.ones(count, bool)
        track = Track(t_s, xy_px, sigma_px, valid, np.arange(count), error_autocorrelation=measured)
        world = to_world(track, uncalibrated())
        fall = Trajectory(
            t_s,
            (Quantity("z", "px", "z"),),
            world.position[:, 1:],
            world.sigma[:, 1:],
            world.valid,
            error_autocorrelation=world.error_autocorrelation,
        )
        fits.append(fit(fall, MODELS["free-fall"]).estimates["gravity"])
    assert fits[0].value == pytest.approx(fits[1].value, rel=1e-6)
    assert 1.3 < fits[0].stderr / fits[1].stderr < 3
