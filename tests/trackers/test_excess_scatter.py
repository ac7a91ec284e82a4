"""Standard errors of a track are raised to its scatter about smooth motion, autocorrelation allowed for."""

import numpy as np
import pytest
from scipy.signal import lfilter

from iris_sysid.types import ErrorAutocorrelation
from trackers._uncertainty.excess_scatter import ErrorModel, with_scatter

COUNT = 300
T_S = np.arange(COUNT) / 60
MOVING = np.ones(COUNT, dtype=bool)


def position(t_s):
    return 100 + 80 * np.cos(4 * t_s)


def correlated(rng, correlation, count=COUNT):
    """Noise (count,) of standard deviation 1 and that autocorrelation from one sample to the next."""
    noise = rng.standard_normal(count + 100) * np.sqrt(1 - correlation**2)
    return lfilter([1.0], [1.0, -correlation], noise)[100:]


def factors(make, errors, trials=30):
    """By what factor (trials,) the standard errors of 0.05 px are raised."""
    stated = np.full(COUNT, 0.05)
    raised = [with_scatter(T_S, make(np.random.default_rng(seed)), stated, errors) for seed in range(trials)]
    return np.median(raised, axis=1) / 0.05


def known(correlation):
    return ErrorModel(MOVING, ErrorAutocorrelation((correlation, 0.0), (0.1, 0.1)))


@pytest.mark.parametrize("correlation", [0.0, 0.3, 0.6])
def test_errors_are_raised_to_their_size_at_any_autocorrelation(correlation):
    raised = factors(lambda rng: position(T_S) + 0.1 * correlated(rng, correlation), known(correlation))
    np.testing.assert_allclose(raised.mean(), 2.0, rtol=0.12)


def test_unknown_autocorrelation_hides_part_of_the_scatter():
    allowed_for, unknown = (
        factors(lambda rng: position(T_S) + 0.1 * correlated(rng, 0.6), errors)
        for errors in (known(0.6), ErrorModel(MOVING))
    )
    assert unknown.mean() < 0.85 * allowed_for.mean()


def test_resting_body_with_frozen_errors_does_not_count():
    moving = T_S < 1.5

    def make(rng):
        values = position(np.minimum(T_S, 1.5)) + 0.1 * rng.standard_normal(COUNT)
        return np.where(moving, values, values[moving][-1])

    assert factors(make, ErrorModel(MOVING)).max() < 1.1
    np.testing.assert_allclose(factors(make, ErrorModel(moving)).mean(), 2.0, rtol=0.12)


def test_correct_errors_stay_about_as_they_are():
    raised = factors(lambda rng: position(T_S) + 0.05 * rng.standard_normal(COUNT), ErrorModel(MOVING))
    assert raised.min() == 1.0
    assert raised.mean() < 1.1
