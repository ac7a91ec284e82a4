"""A finished fit goes on in lmfit: the same optimum, its report, its intervals, ties between parameters."""

from dataclasses import replace

import lmfit
import numpy as np
import pytest

from iris_sysid import MODELS, FitError, Quantity, Trajectory, fit, lmfit_minimizer, simulate

NOISE = 1e-3
TRUE = {"length": 0.5, "damping": 0.1, "theta_0": 0.4, "omega_0": 0.0}


@pytest.fixture(scope="module")
def clip():
    t_s = np.arange(0, 6, 1 / 60)
    theta = simulate(MODELS["pendulum"], t_s, TRUE).observed
    theta = theta + NOISE * np.random.default_rng(3).standard_normal(theta.shape)
    quantity = Quantity("theta", "rad", "theta")
    return Trajectory(t_s, (quantity,), theta, np.full_like(theta, NOISE), np.ones(t_s.size, dtype=bool))


@pytest.fixture(scope="module")
def fitted(clip):
    return fit(clip, MODELS["pendulum"])


def test_lmfit_stays_at_the_optimum_of_the_fit(clip, fitted):
    minimised = lmfit_minimizer(fitted, clip).minimize()
    for name in fitted.free:
        assert abs(minimised.params[name].value - fitted.estimates[name].value) < 0.05 * fitted.estimates[name].stderr


def test_lmfit_interval_agrees_for_white_noise(clip, fitted):
    minimizer = lmfit_minimizer(fitted, clip)
    minimised = minimizer.minimize()
    ends = lmfit.conf_interval(minimizer, minimised, p_names=["length"], sigmas=[0.95])["length"]
    low, high = fitted.estimates["length"].interval
    assert ends[0][1] == pytest.approx(low, abs=0.25 * (high - low))
    assert ends[-1][1] == pytest.approx(high, abs=0.25 * (high - low))


def test_lmfit_report_names_every_parameter(clip, fitted):
    report = lmfit.fit_report(lmfit_minimizer(fitted, clip).minimize())
    assert all(name in report for name in fitted.free)


def test_lmfit_expression_ties_a_parameter(clip, fitted):
    minimizer = lmfit_minimizer(fitted, clip)
    minimizer.params["damping"].expr = "0.2 * length"
    minimised = minimizer.minimize()
    assert minimised.params["damping"].value == pytest.approx(0.2 * minimised.params["length"].value)
    assert minimised.nvarys == len(fitted.free) - 1


def test_lmfit_of_a_failed_fit_is_refused(clip, fitted):
    failed = replace(fitted, status="diverged")
    with pytest.raises(FitError, match="has no estimates to start from"):
        lmfit_minimizer(failed, clip)
