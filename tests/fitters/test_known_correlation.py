"""Fits too short to see the autocorrelation of their noise take the one that the tracker measured."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fitters.noise.autoregression import Autoregression, coefficients_of
from fitters.noise.known_correlation import with_stated_size
from fitters.noise.sandwich_covariance import inverse_normal, quantile_975, random_uncertainty
from fitters.ode import fit
from iris_sysid.calibration.pixel_scale import to_world, uncalibrated
from iris_sysid.registry import MODELS
from iris_sysid.types import ErrorAutocorrelation, Quantity, Track, Trajectory

PARTIAL = (0.5, 0.15)  # as of a ball of 10 px in H.264 at a phone's bit rate
MEASURED = ErrorAutocorrelation(PARTIAL, (0.15, 0.15))


def correlated(rng, count, width=1, partial=PARTIAL):
    """Noise (count, width) of unit innovations with those partial autocorrelations."""
    noise = rng.standard_normal((count + 100, width))
    return lfilter([1.0], np.append(1.0, -coefficients_of(np.array(partial))[-1]), noise, axis=0)[100:]


def pulls(measured, count, clips=200, partial=PARTIAL, stated=None):
    """Errors of the curvature of parabolas through correlated noise over their standard errors; 95 % limits."""
    rng, u = np.random.default_rng(4), np.linspace(-1, 1, count)
    columns = np.vander(u, 3)
    bread = inverse_normal(columns)
    pull, limit = [], []
    for _ in range(clips):
        noise = correlated(rng, count, partial=partial)
        values = bread @ columns.T @ noise
        uncertainty = random_uncertainty(
            np.arange(count) / 60, noise - columns @ values, columns[:, None], bread, measured, stated
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


LASTING = (0.8, 0.1)  # longer than the outline shows: the curvature of a fall takes most of it for motion
LASTING_SD = 1 / np.sqrt(np.prod(1 - np.square(LASTING)))


def held(stated):
    """Share of the intervals that hold the truth where the noise lasts longer than was measured."""
    pull, limit = pulls(MEASURED, 25, clips=400, partial=LASTING, stated=stated)
    return np.mean(np.abs(pull) < limit)


def test_size_that_the_tracker_states_widens_an_interval_whose_noise_looks_like_motion():
    without, right = held(None), held(np.array([LASTING_SD]))
    assert without < 0.9
    assert right > without + 0.04


def test_smaller_size_than_the_residual_shows_is_not_believed():
    plain, _ = pulls(MEASURED, 25, clips=40, partial=LASTING)
    for unbelieved in (0.1, np.nan):
        pull, _ = pulls(MEASURED, 25, clips=40, partial=LASTING, stated=np.array([unbelieved]))
        np.testing.assert_array_equal(pull, plain)


def test_size_stated_for_white_noise_twice_too_large_widens_a_short_interval_by_less_than_a_third():
    rng, basis = np.random.default_rng(6), np.zeros((25, 0))
    process = Autoregression.of(rng.standard_normal(25), basis, np.zeros(0))
    raised = with_stated_size(process, 2 * process.sd)
    assert raised.sd == pytest.approx(process.sd * np.sqrt((25 + 4 * 4) / (25 + 4)), rel=1e-9)
    assert with_stated_size(Autoregression.of(rng.standard_normal(101), np.zeros((101, 0)), np.zeros(0)), 9.0).sd < 2


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
