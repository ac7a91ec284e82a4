"""The text of a fit, and the covariance that its errors and correlations are of."""

import re

import numpy as np
import pytest

from iris_sysid import MODELS, Estimate, FitError, Trajectory, fit, fit_report, simulate

PENDULUM = MODELS["pendulum"]
VALUES = {"length": 0.6, "damping": 0.1, "theta_0": 0.6, "omega_0": 0.0}


def swing(samples=240):
    t_s = np.arange(samples) / 60
    theta = simulate(PENDULUM, t_s, VALUES).observed
    theta = theta + 1e-3 * np.random.default_rng(3).standard_normal(theta.shape)
    return Trajectory(t_s, PENDULUM.observed, theta, np.full_like(theta, np.nan), np.ones(samples, bool))


@pytest.fixture(scope="module")
def fitted():
    return fit(swing(), PENDULUM, fixed={"gravity": Estimate(9.81, 0.05, "m/s^2")})


def test_total_covariance_has_the_squared_standard_errors_on_its_diagonal(fitted):
    stated = [fitted.estimates[name].stderr for name in fitted.free]
    np.testing.assert_allclose(np.sqrt(np.diag(fitted.total_covariance)), stated, rtol=1e-12)


def test_known_value_with_an_error_makes_the_total_larger_than_the_random_part(fitted):
    k = fitted.free.index("length")
    assert fitted.budget["length"]["gravity"] > 10 * fitted.budget["length"]["random"]
    assert fitted.total_covariance[k, k] > 100 * fitted.covariance[k, k]
    assert np.linalg.eigvalsh(fitted.total_covariance).min() > 0


def test_report_has_the_headings_of_lmfit_and_every_value_with_its_error(fitted):
    text = fit_report(fitted)
    assert re.findall(r"^\[\[(\w+)", text, re.MULTILINE) == ["Model", "Fit", "Variables", "Constants", "Correlations"]
    value, stderr = re.search(r"length: +([\d.]+) \+/- ([\d.]+) m \(0\.5\d%\)", text).groups()
    assert float(value) == pytest.approx(fitted.estimates["length"].value, rel=1e-6)
    assert float(stderr) == pytest.approx(fitted.estimates["length"].stderr, rel=1e-2)
    assert "# data points      = 240" in text
    assert re.search(r"ball_radius: +not known$", text, re.MULTILINE)
    assert re.search(r"gravity: +9\.81 \+/- 0\.05 m/s\^2", text)


def test_correlations_are_listed_from_the_strongest_down_to_the_limit(fitted):
    values = [abs(float(text)) for text in re.findall(r"C\(.*\) = (\S+)", fit_report(fitted, min_correl=0.2))]
    assert values == sorted(values, reverse=True)
    assert min(values) >= 0.2
    assert "Correlations" not in fit_report(fitted, min_correl=1.1)


def test_fit_without_estimates_has_no_report():
    with pytest.raises(FitError, match=r"no estimates to report \(too-short\)"):
        fit_report(fit(swing(3), PENDULUM))
