"""A finished fit goes on in lmfit: the same optimum, its report, its intervals, ties between parameters."""

from dataclasses import replace

import lmfit
import numpy as np
import pytest

from iris_sysid import MODELS, DataError, FitError, Quantity, Trajectory, fit, lmfit_minimizer, simulate

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


def test_lmfit_report_of_a_tied_fit_has_the_tied_value(clip, capsys):
    tied = lmfit.create_params(length={"value": 0.4, "min": 0.1, "max": 2.0}, damping={"expr": "0.2 * length"})
    result = fit(clip, "pendulum", parameters=tied)
    minimizer = lmfit_minimizer(result, clip)
    damping = minimizer.params["damping"]
    assert (damping.expr, damping.value) == ("0.2 * length", pytest.approx(result.estimates["damping"].value))
    assert damping.stderr == result.estimates["damping"].stderr
    lmfit.report_fit(minimizer.params)
    assert "== '0.2 * length'" in capsys.readouterr().out
    minimised = minimizer.minimize()
    assert minimised.params["damping"].value == pytest.approx(0.2 * minimised.params["length"].value)
    assert minimised.nvarys == len(result.free)


def test_lmfit_of_a_failed_fit_is_refused(clip, fitted):
    failed = replace(fitted, status="diverged")
    with pytest.raises(FitError, match="has no estimates to start from"):
        lmfit_minimizer(failed, clip)


def test_lmfit_reports_the_fit_itself(fitted, clip, capsys):
    parameters = lmfit_minimizer(fitted, clip).params
    length = fitted.estimates["length"]
    assert parameters["length"].stderr == length.stderr
    assert parameters["length"].correl["damping"] == pytest.approx(
        fitted.covariance[0, 1] / np.sqrt(fitted.covariance[0, 0] * fitted.covariance[1, 1])
    )
    lmfit.report_fit(parameters)
    assert f"{length.value:.5f}" in capsys.readouterr().out


def test_lmfit_parameters_hold_bound_and_start_a_fit(clip):
    parameters = lmfit.create_params(
        length={"value": 0.8, "min": 0.3, "max": 2.0}, damping={"value": 0.1, "vary": False}, theta_0=0.3, omega_0=0.0
    )
    result = fit(clip, "pendulum", parameters=parameters)
    assert result.free == ("length", "theta_0", "omega_0")
    assert result.estimates["damping"].value == 0.1
    assert (result.model.parameter("length").lower, result.model.parameter("length").upper) == (0.3, 2.0)
    assert result.estimates["length"].value == pytest.approx(0.5, abs=4 * result.estimates["length"].stderr)
    parameters["length"].min = 0.55
    assert fit(clip, "pendulum", parameters=parameters).status == "at-bound"


def test_lmfit_parameters_free_a_constant(clip):
    parameters = lmfit.create_params(gravity=9.7, length={"value": 0.5, "vary": False})
    result = fit(clip, "pendulum", parameters=parameters)
    assert "gravity" in result.free
    assert result.estimates["gravity"].value == pytest.approx(9.80665, abs=4 * result.estimates["gravity"].stderr)


def test_lmfit_expression_ties_parameters_in_a_fit(clip, fitted):
    parameters = lmfit.Parameters()
    parameters.add("length", value=0.6)
    parameters.add("damping", expr="0.2 * length")
    result = fit(clip, "pendulum", parameters=parameters)
    assert result.ok, result.message
    assert result.free == ("length", "theta_0", "omega_0")
    length, damping = result.estimates["length"], result.estimates["damping"]
    assert damping.value == pytest.approx(0.2 * length.value)
    assert damping.stderr == pytest.approx(0.2 * length.stderr, rel=1e-3)
    assert damping.unit == "1/s"
    by_lmfit = lmfit_minimizer(fitted, clip)
    by_lmfit.params["damping"].expr = "0.2 * length"
    assert by_lmfit.minimize().params["length"].value == pytest.approx(length.value, abs=0.05 * length.stderr)


def test_lmfit_expression_may_use_a_parameter_of_its_own(clip):
    parameters = lmfit.Parameters()
    parameters.add("stiffness", value=15.0, min=1.0)
    parameters.add("length", expr="9.80665 / stiffness")
    result = fit(clip, "pendulum", parameters=parameters)
    assert result.estimates["length"].value == pytest.approx(0.5, abs=4 * result.estimates["length"].stderr)
    assert "stiffness" in result.free


@pytest.mark.parametrize(
    ("name", "more", "match"),
    [
        ("mass", {"value": 1.0}, "parameters: model 'pendulum' has no parameter 'mass'"),
        ("theta_0", {"expr": "length"}, "theta_0 cannot be tied: it is not a parameter"),
        (
            "damping",
            {"expr": "length if length > 1 else 2"},
            "if cannot name anything",
        ),
    ],
)
def test_lmfit_parameters_that_cannot_be_kept_are_refused(clip, name, more, match):
    parameters = lmfit.Parameters()
    parameters.add("length", value=0.6)
    parameters.add(name, **more)
    with pytest.raises((FitError, DataError), match=match):
        fit(clip, "pendulum", parameters=parameters)


def test_lmfit_samples_the_posterior_of_a_fit(fitted, clip):
    pytest.importorskip("emcee")
    minimizer = lmfit_minimizer(fitted, clip)
    sampled = minimizer.emcee(steps=40, nwalkers=12, burn=10, seed=0, progress=False)
    assert sampled.params["length"].value == pytest.approx(0.5, abs=0.001)
