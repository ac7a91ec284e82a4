"""Constants measured elsewhere, with their standard error, as priors of a fit."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fitters.ode import FitOptions, fit, simulate
from iris_sysid.errors import FitError
from iris_sysid.registry import MODELS
from iris_sysid.types import Estimate, Trajectory

PENDULUM, FALL = MODELS["pendulum"], MODELS["free-fall"]
TRUTH = {"length": 0.6, "damping": 0.08, "theta_0": 0.9, "omega_0": 0.2, "gravity": 9.80}
NOISE = 2e-3


def clip_of(model, values, t_s, noise):
    position = simulate(model, t_s, values).observed + noise
    return Trajectory(t_s, model.observed, position, np.full_like(position, np.nan), np.ones(t_s.size, bool))


def swing(seed, rho=0.0, gravity=TRUTH["gravity"]):
    t_s = np.arange(600) / 60
    white = np.random.default_rng(seed).standard_normal((t_s.size + 300, 1))
    noise = NOISE * lfilter([1.0], [1.0, -rho], white, axis=0)[300:] * np.sqrt(1 - rho**2)
    return clip_of(PENDULUM, TRUTH | {"gravity": gravity}, t_s, noise)


def fall(seed, noise=2e-3):
    t_s = np.arange(60) / 240
    values = {"gravity": 9.8, "z_0": 1.5, "vz_0": -0.3}
    return clip_of(FALL, values, t_s, noise * np.random.default_rng(seed).standard_normal((t_s.size, 1)))


def test_gravity_and_length_of_a_pendulum_with_a_prior_on_gravity_equal_the_fit_with_gravity_known_so_well():
    known = Estimate(9.79, 0.01, "m/s^2")
    held = fit(swing(1), PENDULUM, fixed={"gravity": known})
    prior = fit(swing(1), PENDULUM, fixed={"gravity": known}, free=["gravity"])
    assert prior.ok, prior.message
    assert "gravity" in prior.free
    for name in ("length", "damping"):
        assert prior.estimates[name].value == pytest.approx(held.estimates[name].value, rel=1e-6)
        assert prior.estimates[name].stderr == pytest.approx(held.estimates[name].stderr, rel=1e-3)
    assert prior.estimates["gravity"].value == pytest.approx(9.79, abs=1e-6)
    assert prior.estimates["gravity"].stderr == pytest.approx(0.01, rel=1e-3)


def test_budget_keeps_the_share_of_the_prior_apart_and_the_covariance_holds_both():
    prior = fit(swing(2), PENDULUM, fixed={"gravity": Estimate(9.79, 0.01, "m/s^2")}, free=["gravity"])
    length = prior.budget["length"]
    assert length["gravity"] == pytest.approx(0.6 * 0.01 / 9.79, rel=2e-2)
    assert np.hypot(length["random"], length["gravity"]) == pytest.approx(prior.estimates["length"].stderr)
    assert prior.budget["gravity"]["gravity"] == pytest.approx(0.01, rel=1e-3)
    for name in ("length", "gravity"):
        k = prior.free.index(name)
        assert np.sqrt(prior.covariance[k, k]) == pytest.approx(prior.estimates[name].stderr, rel=1e-6)


def test_prior_that_the_data_can_better_agrees_with_the_closed_form_of_two_weighted_measurements():
    alone = fit(fall(3), FALL, options=FitOptions(unseen_drag=False))
    expected, stderr = 9.5, alone.estimates["gravity"].stderr
    both = fit(fall(3), FALL, fixed={"gravity": Estimate(expected, stderr, "m/s^2")}, free=["gravity"])
    middle = (alone.estimates["gravity"].value + expected) / 2  # equal weights
    assert both.estimates["gravity"].value == pytest.approx(middle, abs=0.05 * stderr)
    assert both.estimates["gravity"].stderr == pytest.approx(stderr / np.sqrt(2), rel=0.05)
    assert both.budget["gravity"]["gravity"] == pytest.approx(stderr / 2, rel=0.05)
    assert both.budget["gravity"]["random"] == pytest.approx(stderr / 2, rel=0.05)


def test_criteria_count_the_prior_as_one_more_sample():
    known = Estimate(9.8, 0.5, "m/s^2")
    alone, both = fit(fall(4), FALL), fit(fall(4), FALL, fixed={"gravity": known}, free=["gravity"])
    pull = (both.estimates["gravity"].value - known.value) / known.stderr
    assert both.aic - alone.aic == pytest.approx(pull**2, abs=0.05)
    count = 3 + 1
    assert both.bic - alone.bic == pytest.approx(pull**2 + count * np.log(61 / 60), abs=0.05)


def test_prior_wrong_by_many_standard_errors_raises_aic_by_its_square():
    alone = fit(fall(5), FALL)
    value = alone.estimates["gravity"].value
    far = fit(fall(5), FALL, fixed={"gravity": Estimate(value + 1.0, 0.1, "m/s^2")}, free=["gravity"])
    assert far.aic - alone.aic > 20.0


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_intervals_of_a_pendulum_cover_when_gravity_is_measured_anew_each_time(rho):
    hits = []
    for seed in range(40):
        prior = Estimate(TRUTH["gravity"] + 0.05 * np.random.default_rng([seed, 1]).standard_normal(), 0.05, "m/s^2")
        result = fit(swing(seed, rho), PENDULUM, fixed={"gravity": prior}, free=["gravity"])
        hits.append([low <= TRUTH[n] <= high for n in TRUTH for low, high in [result.estimates[n].interval]])
    assert np.all(np.mean(hits, axis=0) > 0.84), np.mean(hits, axis=0)


def test_prior_on_what_correlated_data_know_less_well_than_white_noise_would_gets_more_weight():
    """With rho = 0.9 the slow noise hides the fall: the estimate lies nearer to the prior than least squares has it."""
    t_s = np.arange(200) / 240
    white = np.random.default_rng(6).standard_normal((t_s.size + 300, 1))
    noise = 5e-3 * lfilter([1.0], [1.0, -0.9], white, axis=0)[300:] * np.sqrt(1 - 0.9**2)
    clip = clip_of(FALL, {"gravity": 9.8, "z_0": 1.5, "vz_0": -0.3}, t_s, noise)
    alone = fit(clip, FALL).estimates["gravity"]
    prior = Estimate(alone.value + 2 * alone.stderr, alone.stderr, "m/s^2")
    both = fit(clip, FALL, fixed={"gravity": prior}, free=["gravity"]).estimates["gravity"]
    share = (both.value - alone.value) / (prior.value - alone.value)
    assert share == pytest.approx(0.5, abs=0.12)


def test_exact_value_cannot_be_both_fixed_and_free_and_the_error_says_how_to_make_it_a_prior():
    with pytest.raises(FitError, match=r"gravity cannot be both fixed and free.*standard error"):
        fit(swing(7), PENDULUM, fixed={"gravity": 9.8}, free=["gravity"])


def test_source_of_an_estimate_names_its_prior():
    known = Estimate(9.79, 0.01, "m/s^2", source="gravimeter")
    result = fit(swing(8), PENDULUM, fixed={"gravity": known}, free=["gravity"])
    assert result.estimates["gravity"].source == "fitted, with the prior 9.79 +- 0.01 m/s^2 (gravimeter)"
