"""Standard errors of a track are raised to its scatter: of what moves, and as much as errors that last hide."""

import numpy as np
import pytest
from scipy.signal import lfilter

from trackers._uncertainty.excess_scatter import Steadiness, with_scatter

COUNT = 300
T_S = np.arange(COUNT) / 60


def path(t_s):
    return 100 + 80 * np.cos(4 * t_s)


def lasting(rng, memory, count=COUNT):
    """Noise (count,) of standard deviation 1 and that autocorrelation from one sample to the next."""
    noise = rng.standard_normal(count + 100) * np.sqrt(1 - memory**2)
    return lfilter([1.0], [1.0, -memory], noise)[100:]


def factors(make, known, trials=30):
    told = np.full(COUNT, 0.05)
    every = [with_scatter(T_S, make(np.random.default_rng(seed)), told, known) for seed in range(trials)]
    return np.median(every, axis=1) / 0.05


@pytest.mark.parametrize("memory", [0.0, 0.3, 0.6])
def test_errors_are_raised_to_their_size_whatever_their_memory(memory):
    moving = np.ones(COUNT, dtype=bool)
    found = factors(lambda rng: path(T_S) + 0.1 * lasting(rng, memory), Steadiness(moving, (memory, 0.0)))
    np.testing.assert_allclose(found.mean(), 2.0, rtol=0.12)


def test_memory_that_is_not_known_hides_part_of_the_scatter():
    moving = np.ones(COUNT, dtype=bool)
    known, unknown = (
        factors(lambda rng: path(T_S) + 0.1 * lasting(rng, 0.6), Steadiness(moving, memory))
        for memory in ((0.6, 0.0), ())
    )
    assert unknown.mean() < 0.85 * known.mean()


def test_what_rests_with_its_errors_frozen_does_not_count():
    moving = T_S < 1.5

    def make(rng):
        values = path(np.minimum(T_S, 1.5)) + 0.1 * rng.standard_normal(COUNT)
        return np.where(moving, values, values[moving][-1])

    assert factors(make, Steadiness(np.ones(COUNT, dtype=bool))).max() < 1.1
    np.testing.assert_allclose(factors(make, Steadiness(moving)).mean(), 2.0, rtol=0.12)


def test_errors_that_are_true_stay_about_as_they_are():
    known = Steadiness(np.ones(COUNT, dtype=bool))
    found = factors(lambda rng: path(T_S) + 0.05 * rng.standard_normal(COUNT), known)
    assert found.min() == 1.0
    assert found.mean() < 1.1
