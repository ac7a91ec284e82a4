"""What fits but is not named changes no value by more than its interval says: SciPy integrates the truth."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.ode import fit
from fitters.ode.error_budget import with_derived_errors
from iris_sysid.diagnosis.contributions import Contributions
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.open_world import WORSE
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

GRAVITY = 9.80665
THROW = MODELS["projectile"]
START = (0.1, 1.2, 2.9, 3.6)  # m, m/s


def clip(model, t_s, motion, noise, seed):
    place = motion + noise * np.random.default_rng(seed).standard_normal(motion.shape)
    return Trajectory(t_s, model.observed, place, np.full_like(place, np.nan), np.ones(t_s.size, dtype=bool))


def thrown(lift, seed, n=130):
    """A ball whose spin lifts it across its velocity, at 120 Hz; no effect of the library does that."""
    t_s = np.arange(n) / 120

    def rates(_t, state):
        return [state[2], state[3], -lift * state[3], -GRAVITY + lift * state[2]]

    motion = solve_ivp(rates, (0, t_s[-1]), START, t_eval=t_s, rtol=1e-9, atol=1e-10).y[:2].T
    return clip(THROW, t_s, motion, 0.0025, seed)


def test_error_of_a_derived_quantity_follows_those_of_its_values_where_these_are_widened():
    found = fit(thrown(0.0, 1), THROW)
    assert with_derived_errors(found).estimates == found.estimates
    wide = {name: replace(found.estimates[name], stderr=0.2, ci95=None) for name in ("vx_0", "vz_0")}
    widened = with_derived_errors(replace(found, estimates={**found.estimates, **wide})).estimates
    k, j = found.free.index("vx_0"), found.free.index("vz_0")
    correlation = found.total_covariance[k, j] / math.sqrt(found.total_covariance[k, k] * found.total_covariance[j, j])
    way = np.array([2.9, 3.6]) / math.hypot(2.9, 3.6)
    expected = 0.2 * math.sqrt(1 + 2 * correlation * way[0] * way[1])
    assert widened["launch_speed"].stderr == pytest.approx(expected, rel=0.02)
    assert widened["launch_angle"].stderr > 10 * found.estimates["launch_angle"].stderr


@pytest.mark.slow
def test_values_of_a_throw_with_a_lift_that_no_effect_has_are_in_their_intervals():
    found = diagnose(thrown(0.25, 15), THROW)
    assert not found.added
    truth = dict(zip(("x_0", "z_0", "vx_0", "vz_0"), START, strict=True))
    truth |= {"launch_speed": math.hypot(2.9, 3.6), "launch_angle": math.atan2(3.6, 2.9)}
    for name, value in truth.items():
        low, high = found.final.estimates[name].interval
        assert low <= value <= high, name


@pytest.mark.slow
def test_nothing_is_in_the_fit_where_the_residual_is_noise():
    """A lost frame fits this noise, without a name."""
    fall, t_s = MODELS["free-fall"], np.arange(88) / 120
    motion = 2.6 - GRAVITY * t_s[:, None] ** 2 / 2
    found = diagnose(clip(fall, t_s, motion, 0.003, 1), fall, free=["gravity"])
    assert (found.added, found.nuisances, found.findings) == ((), (), ())
    low, high = found.final.estimates["gravity"].interval
    assert low <= GRAVITY <= high


@pytest.mark.slow
def test_loss_beside_which_the_damping_adds_energy_has_no_name():
    """A magnet under the lowest point brakes there alone: dry friction fits only with a damping below zero."""
    swing, t_s = MODELS["pendulum"], np.arange(1200) / 50

    def rates(_t, state):
        angle, rate = state
        return [rate, -GRAVITY / 1.24 * math.sin(angle) - (0.012 + 0.35 * math.exp(-((angle / 0.12) ** 2))) * rate]

    motion = solve_ivp(rates, (0, t_s[-1]), (0.45, 0), t_eval=t_s, rtol=1e-9, atol=1e-10, max_step=0.04).y[:1].T
    found = diagnose(clip(swing, t_s, motion, 0.0035, 4), swing)
    assert not found.added
    assert "force-of-velocity" in {finding.component for finding in found.findings}
    assert not found.verdict.complete
    for name, value in {"length": 1.24, "damping": 0.012}.items():
        low, high = found.final.estimates[name].interval
        assert low <= value <= high, name


def test_effect_with_which_blocks_are_predicted_worse_has_no_name(monkeypatch):
    swing, t_s = MODELS["pendulum"], np.arange(400) / 60

    def rates(_t, state):
        return [state[1], -GRAVITY / 0.5 * math.sin(state[0]) - 0.1 * state[1] - 0.1 * state[1] * abs(state[1])]

    motion = solve_ivp(rates, (0, t_s[-1]), (0.8, 0), t_eval=t_s, rtol=1e-9, atol=1e-10).y[:1].T
    dragged = clip(swing, t_s, motion, 0.002, 1)
    assert [effect.name for effect in diagnose(dragged, swing, effects=["quadratic-drag"]).added] == ["quadratic-drag"]
    monkeypatch.setattr(Contributions, "removed", lambda self, model, effect: -0.1)
    worse = diagnose(dragged, swing, effects=["quadratic-drag"])
    assert not worse.added
    assert [(finding.word, finding.reason) for finding in worse.findings] == [("located", WORSE)]
