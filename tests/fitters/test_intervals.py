"""Intervals by profile likelihood and by block bootstrap, beside the robust ones of the same call."""

import lmfit
import numpy as np
import pytest
from scipy.signal import lfilter

from fitters.noise.autoregression import Autoregression
from fitters.ode import fit, simulate
from fitters.ode.intervals import block_length, disagreements
from iris_sysid.errors import FitError
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

DECAY, PENDULUM = MODELS["exponential-decay"], MODELS["pendulum"]
SWING = {"length": 0.6, "damping": 0.08, "theta_0": 0.9, "omega_0": 0.2}


def clip_of(model, values, t_s, noise, rho=0.0, seed=0):
    seen = simulate(model, t_s, values).observed
    white = np.random.default_rng(seed).standard_normal((t_s.size + 300, seen.shape[1]))
    seen = seen + noise * np.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], white, axis=0)[300:]
    return Trajectory(t_s, model.observed, seen, np.full_like(seen, np.nan), np.ones(t_s.size, bool))


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_all_three_intervals_of_a_nearly_linear_fit_agree_with_white_and_with_correlated_noise(rho):
    result = fit(clip_of(PENDULUM, SWING, np.arange(900) / 60, 2e-3, rho), PENDULUM, uncertainty=["all"])
    assert set(result.intervals) == {"robust", "profile", "bootstrap"}
    for name in SWING:
        low, high = result.intervals["robust"][name]
        assert result.intervals["profile"][name] == pytest.approx((low, high), abs=0.06 * (high - low))
        assert result.intervals["bootstrap"][name] == pytest.approx((low, high), abs=0.2 * (high - low))
    assert result.intervals["robust"]["length"] == pytest.approx(result.estimates["length"].interval)


def test_profile_of_a_curved_fit_is_lopsided_as_that_of_lmfit_and_the_message_says_so():
    """A slow decay seen for a short time with its background free: the rate has a long upper tail."""
    t_s = np.arange(60) / 30
    values = {"decay_rate": 0.6, "intensity_0": 1.0, "background": 0.2}
    clip = clip_of(DECAY, values, t_s, 0.04, seed=2)
    result = fit(clip, DECAY, free=["background"], uncertainty=["profile"])

    def residual(parameters):
        rate, height, floor = (parameters[name].value for name in ("rate", "height", "floor"))
        return height * np.exp(-rate * t_s) + floor - clip.position[:, 0]

    start = lmfit.create_params(rate=0.6, height=1.0, floor=0.2)
    minimizer = lmfit.Minimizer(residual, start)
    minimised = minimizer.minimize()
    ends = lmfit.conf_interval(minimizer, minimised, p_names=["rate"], sigmas=[0.95])["rate"]
    low, high = result.intervals["profile"]["decay_rate"]
    assert low == pytest.approx(ends[0][1], abs=0.1 * (ends[2][1] - ends[0][1]))
    assert high == pytest.approx(ends[2][1], abs=0.1 * (ends[2][1] - ends[0][1]))
    assert "the profile interval of background" in result.message


def test_disagreement_is_flagged_with_both_intervals_and_what_to_trust():
    intervals = {"robust": {"a": (0.9, 1.1)}, "profile": {"a": (0.9, 1.3)}, "bootstrap": {"a": (0.89, 1.11)}}
    (text,) = disagreements(intervals)
    assert text.startswith("the profile interval of a, 0.9 to 1.3, disagrees with the robust one, 0.9 to 1.1")


def test_blocks_grow_with_the_noise_autocorrelation():
    def noise(rho):
        return Autoregression(np.array([rho]), np.array([rho]), 1.0, 1000)

    white = Autoregression(np.zeros(0), np.zeros(0), 1.0, 1000)
    lengths = [block_length([residual], 1000) for residual in (white, noise(0.5), noise(0.9))]
    assert lengths[0] == 1
    # AR(1): G = 2 sum k rho^k R(0) = 2 rho / (1 - rho)^2, spectrum (1 + rho) / (1 - rho), both over R(0)
    rho = 0.9
    expected = (1.5 * (2 * rho / (1 - rho) ** 2 / ((1 + rho) / (1 - rho))) ** 2 * 1000) ** (1 / 3)
    assert lengths[2] == pytest.approx(expected, abs=1)
    assert lengths[0] < lengths[1] < lengths[2]


def test_default_call_computes_no_other_interval():
    assert fit(clip_of(PENDULUM, SWING, np.arange(200) / 60, 2e-3), PENDULUM).intervals == {}


def test_unknown_way_to_an_interval_is_refused_with_those_there_are():
    with pytest.raises(FitError, match="there is no jackknife; there are: robust, profile, bootstrap, all"):
        fit(clip_of(PENDULUM, SWING, np.arange(200) / 60, 2e-3), PENDULUM, uncertainty=["jackknife"])
