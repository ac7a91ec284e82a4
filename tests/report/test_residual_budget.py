"""What a residual is made of, on the page of a fit: simulated residuals whose parts are known."""

import re
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import EFFECTS, MODELS, Trajectory, fit, simulate, with_effects
from iris_sysid.report.residual_budget import residual_budget

SWING = {"length": 0.5, "damping": 0.05, "theta_0": 0.8, "omega_0": 0.0}
FALL = {"gravity": 9.81, "z_0": 2.0, "vz_0": 0.0}
NOISE = 1e-3


def moved(name, start, drag, samples=300, noise=NOISE, seed=0):
    """A motion with quadratic drag, its noise, and the fit without drag."""
    model, t_s = MODELS[name], np.arange(samples) / 60
    true = simulate(with_effects(model, [EFFECTS["quadratic-drag"]]), t_s, {**start, "quadratic_drag": drag}).observed
    seen = true + noise * np.random.default_rng(seed).standard_normal(true.shape)
    trajectory = Trajectory(t_s, model.observed, seen, np.full_like(seen, np.nan), np.ones(samples, bool))
    return trajectory, fit(trajectory, model)


def shares(bars):
    return {re.sub(r".* %\)? ", "", name): share for name, share, _ in bars[0].parts}


@pytest.mark.parametrize("seed", range(5))
def test_residual_of_noise_is_called_noise(seed):
    statements, bars = residual_budget(*moved("pendulum", SWING, 0.0, seed=seed))
    assert statements == ["The residual is noise: nothing is missing that these data could show."]
    assert shares(bars) == {"noise": 100.0}


@pytest.mark.parametrize("drag", [0.02, 0.05, 0.2])
def test_share_of_an_implanted_drag_is_its_share_of_the_residual(drag):
    _, clean = moved("pendulum", SWING, drag, noise=NOISE / 100)
    missing = np.mean(clean.residual[clean.used] ** 2)
    statements, bars = residual_budget(*moved("pendulum", SWING, drag))
    found = shares(bars)
    assert found["force by velocity"] == pytest.approx(100 * missing / (missing + NOISE**2), abs=8)
    assert sum(found.values()) == pytest.approx(100)
    assert "depends on the velocity like drag" in statements[0]
    assert "iris-sysid diagnose" in statements[0]


def test_residual_above_the_noise_without_a_form_is_not_called_noise():
    """A short fall: its drag is a curve of 60 samples, which the split takes for noise with a memory."""
    trajectory, fitted = moved("free-fall", FALL, 0.005, samples=60, seed=1)
    assert fitted.status == "misfit"
    statements, bars = residual_budget(trajectory, fitted)
    found = shares(bars)
    assert found["of unknown form"] > 50
    assert sum(found.values()) == pytest.approx(100)
    assert "no form" in statements[0]


def test_fit_of_few_samples_or_without_values_has_no_parts():
    assert residual_budget(*moved("pendulum", SWING, 0.0, samples=11)) == ([], [])
    assert residual_budget(*moved("pendulum", SWING, 0.0, samples=3)) == ([], [])


def test_bar_of_several_quantities_says_whose_size_it_gives():
    start = {"gravity": 9.81, "x_0": 0.0, "z_0": 2.0, "vx_0": 3.0, "vz_0": 1.0}
    _, bars = residual_budget(*moved("projectile", start, 0.1))
    assert bars[0].title.startswith("The residual of all, in x: ")


def test_residual_of_a_run_that_leaves_the_motion_has_no_budget():
    trajectory, fitted = moved("pendulum", SWING, 0.0)
    lost = replace(fitted, predicted=np.zeros_like(fitted.predicted), residual=fitted.predicted + fitted.residual)
    assert residual_budget(trajectory, lost) == ([], [])
