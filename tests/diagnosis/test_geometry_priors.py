"""Geometry that was measured with an error keeps that error as a prior while the diagnosis frees it."""

import numpy as np
import pytest

from fitters.compose_effects import with_effect
from fitters.ode import FitRequest, simulate, solve
from iris_sysid.diagnosis.refit import with_free_geometry
from iris_sysid.diagnosis.score_test import screen
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Estimate, Trajectory
from validation.independent.effects import filmed
from validation.independent.motions import MOTIONS

PENDULUM = MODELS["pendulum"]
VALUES = {"length": 0.6, "damping": 0.05, "x0": 0.8, "v0": 0.2}
PIVOT = {name: Estimate(0.0, 5e-4, "1", "assumed", "circle") for name in ("pivot_across", "pivot_along")}
NOISE = 5e-4


def clip_of(clean, t_s, geometry, seed=0):
    theta = clean + NOISE * np.random.default_rng(seed).standard_normal(clean.shape)
    return Trajectory(
        t_s, PENDULUM.observed, theta, np.full_like(theta, np.nan), np.ones(t_s.size, bool), geometry=geometry
    )


def tilted(tilt_rad, seed=0):
    motion = MOTIONS["pendulum"]
    t_s = motion.times()
    return clip_of(filmed("tilt_rad", motion, VALUES, t_s, tilt_rad, {}), t_s, PIVOT, seed)


def pull_of(fitted):
    """The largest distance of the pivot from where it was measured, in standard errors of that."""
    return max(abs(fitted.estimates[name].value / PIVOT[name].stderr) for name in PIVOT)


def test_pivot_stays_within_its_error_where_the_camera_is_tilted():
    _, fitted = with_free_geometry(FitRequest(tilted(0.2), PENDULUM))
    assert set(PIVOT) <= set(fitted.free)
    assert pull_of(fitted) < 8.0
    assert pull_of(solve(FitRequest(tilted(0.2), PENDULUM, free=list(PIVOT)))) > 15.0  # without the prior
    assert np.all(fitted.rms > 2 * NOISE)  # what the pivot does not swallow is left to be explained


def test_fitted_geometry_of_a_clip_without_an_effect_is_no_better_known_than_the_data_and_the_prior_together():
    _, fitted = with_free_geometry(FitRequest(tilted(0.0), PENDULUM))
    assert fitted.ok, fitted.message
    for name in PIVOT:
        assert fitted.estimates[name].stderr < PIVOT[name].stderr
        assert abs(fitted.estimates[name].value) < 4 * fitted.estimates[name].stderr


def test_score_of_an_effect_that_geometry_imitates_has_the_size_and_error_of_a_refit_with_that_prior():
    """A zero offset and the vertical are the same to the data: only the prior of the vertical tells them apart."""
    example = PENDULUM.example
    theta = simulate(PENDULUM, example.t_s, dict(example.values)).observed + 0.03
    vertical = {"vertical": Estimate(0.0, 5e-3, "rad", "assumed", "spirit level")}
    trajectory = clip_of(theta, example.t_s, vertical)
    clip, fitted = with_free_geometry(FitRequest(trajectory, PENDULUM))
    score = screen([EFFECTS["zero-offset"]], fitted, trajectory).scores["zero-offset"]
    refit = solve(clip.with_(model=with_effect(PENDULUM, EFFECTS["zero-offset"])))
    offset = refit.estimates["zero_offset"]
    assert score.size == pytest.approx(offset.value, rel=0.02)
    assert score.stderr == pytest.approx(offset.stderr, rel=0.1)
    assert offset.value == pytest.approx(0.03, abs=3e-4)


@pytest.mark.parametrize("weight", [0.5, 2.0])
def test_rows_of_the_priors_make_the_residual_orthogonal_to_the_jacobian(weight):
    prior = {"gravity": Estimate(9.7, 0.02 * weight, "m/s^2")}
    clip = tilted(0.0).with_(geometry={})
    fitted = solve(FitRequest(clip, PENDULUM, fixed={**prior, "length": 0.6}, free=["gravity"]))
    unit = np.full((fitted.n, 1), fitted.noise[0])
    residual = np.concatenate([(fitted.residual[fitted.used] / unit).ravel(), fitted.prior_residual])
    jacobian = fitted.informed_jacobian(unit)
    k = fitted.free.index("gravity")
    data, known = jacobian[:-1, k] @ residual[:-1], jacobian[-1, k] * residual[-1]
    assert abs(known) > 1.0
    assert data == pytest.approx(-known, rel=1e-2)
