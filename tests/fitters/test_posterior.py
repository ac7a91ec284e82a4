"""Draws from the posterior of a fit scatter as the fit says, and stay inside the bounds."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import DataError, FitError, Quantity, Trajectory, fit, model_from_equation, sample_posterior

pytest.importorskip("emcee")
DECAY = model_from_equation("z' = -k*z + c", bounds={"k": (0.0, 10.0), "c": (0.0, 10.0)})


def record(c=0.3, correlation=0.0, noise=2e-3, n=200, seed=0):
    t_s = np.arange(n) / 50
    rng, errors = np.random.default_rng(seed), np.zeros(n)
    for k in range(n):
        errors[k] = correlation * errors[k - 1] + np.sqrt(1 - correlation**2) * noise * rng.standard_normal()
    z = (c / 0.8 + (1 - c / 0.8) * np.exp(-0.8 * t_s) + errors)[:, None]
    return Trajectory(t_s, (Quantity("z", "m"),), z, np.full_like(z, np.nan), np.ones(n, bool))


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_draws_scatter_as_the_covariance_of_the_fit(correlation):
    clip = record(correlation=correlation)
    fitted = fit(clip, DECAY)
    sampled = sample_posterior(fitted, clip, steps=800)
    found = sampled.summary()
    errors = np.sqrt(np.diag(fitted.covariance))
    np.testing.assert_allclose(found["stdev"], errors, rtol=0.15)
    values = np.array([fitted.estimates[name].value for name in fitted.free])
    assert np.all(np.abs(found["mean"] - values) < 0.3 * errors)
    correlations = np.corrcoef(sampled.chain.T)
    np.testing.assert_allclose(correlations, fitted.covariance / np.outer(errors, errors), atol=0.1)
    assert 0.2 < sampled.accepted < 0.8
    assert (found["effective_draws"] < len(sampled.chain)).all()


def test_draws_of_one_seed_are_the_same_and_of_another_are_not():
    clip = record(n=60)
    fitted = fit(clip, DECAY)
    first, again, other = (sample_posterior(fitted, clip, steps=100, seed=seed).chain for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_no_draw_is_outside_a_bound():
    clip = record(c=0.002, noise=2e-2, seed=1)
    fitted = fit(clip, DECAY)
    sampled = sample_posterior(fitted, clip, steps=200)
    drawn = sampled.chain[:, sampled.names.index("c")]
    assert fitted.estimates["c"].value < fitted.estimates["c"].stderr  # the bound is near
    assert (drawn >= 0).all()
    assert (drawn < 0.2 * fitted.estimates["c"].stderr).any()


def test_a_short_chain_has_not_converged():
    clip = record(n=60)
    assert not sample_posterior(fit(clip, DECAY), clip, steps=100).converged


def test_what_cannot_be_sampled_is_refused(monkeypatch):
    clip = record(n=60)
    fitted = fit(clip, DECAY)
    with pytest.raises(FitError, match="no estimates"):
        sample_posterior(replace(fitted, status="diverged"), clip)
    with pytest.raises(DataError, match="give at least 100 steps, and 6 walkers for 3 free values"):
        sample_posterior(fitted, clip, walkers=5)
    with pytest.raises(FitError, match="k, c, z_0 cannot be sampled: the fit gives no standard error"):
        sample_posterior(replace(fitted, covariance=np.full((3, 3), np.nan)), clip)
    monkeypatch.setitem(sys.modules, "emcee", None)
    with pytest.raises(DataError, match=r"pip install 'iris-sysid\[posterior\]'"):
        sample_posterior(fitted, clip)
