"""Tracking errors are not taken for an effect, and samples are weighed by their stated errors."""

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.ode import fit, simulate
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.measurement_errors import resolvable_size, unit_noise
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Trajectory

PENDULUM = MODELS["pendulum"]
TRUTH = {"length": 0.5, "damping": 0.03, "theta_0": 0.7, "omega_0": 0.0}
STATED_RAD = 4e-4


def swing(hidden: dict[str, float], seed: int = 1) -> Trajectory:
    """Five seconds with white noise of a quarter of the stated error."""
    model = with_effects(PENDULUM, [EFFECTS[name] for name in hidden])
    sizes = {EFFECTS[name].parameters[0].name: size for name, size in hidden.items()}
    t_s = np.arange(300) / 60
    theta = simulate(model, t_s, {**TRUTH, **sizes}).observed
    theta = theta + 0.25 * STATED_RAD * np.random.default_rng(seed).standard_normal(theta.shape)
    return Trajectory(t_s, PENDULUM.observed, theta, np.full_like(theta, STATED_RAD), np.ones(t_s.size, dtype=bool))


def unstated(clip: Trajectory) -> Trajectory:
    return clip.with_(sigma=np.full_like(clip.sigma, np.nan))


@pytest.fixture(scope="module")
def shaded():
    """A track with a bias that depends on the position, no larger than its stated errors."""
    clip = swing({})
    return clip.with_(position=clip.position + STATED_RAD * np.cos(9.0 * clip.position))


def test_bias_below_the_stated_errors_gets_no_name(shaded):
    diagnosis = diagnose(shaded, PENDULUM)
    assert diagnosis.added == ()
    assert {finding.word for finding in diagnosis.findings} == {"located"}
    assert "the stated errors of the samples can hide it" in [finding.reason for finding in diagnosis.findings]


def test_the_same_bias_without_stated_errors_is_taken_for_an_effect(shaded):
    assert diagnose(unstated(shaded), PENDULUM).added != ()


def test_effect_above_the_stated_errors_is_named_and_one_below_has_a_limit_above_it():
    large, small = (diagnose(swing({"quadratic-drag": size}), PENDULUM) for size in (0.08, 0.003))
    assert [effect.name for effect in large.added] == ["quadratic-drag"]
    assert small.added == ()
    limits = {limit.effect: limit.upper_95 for limit in small.ruled_out}
    assert 0.003 < limits["quadratic-drag"] < 0.08
    assert diagnose(unstated(swing({"quadratic-drag": 0.003})), PENDULUM).added != ()


def test_samples_with_large_stated_errors_are_no_impact():
    clip, near = swing({}), slice(150, 154)
    position, sigma = clip.position.copy(), clip.sigma.copy()
    position[near] += 0.004
    sigma[near] = 0.004
    diagnosis = diagnose(clip.with_(position=position, sigma=sigma), PENDULUM)
    assert diagnosis.added == ()


def test_unit_of_a_residual_is_the_noise_scaled_by_the_stated_errors():
    clip = swing({})
    sigma = clip.sigma.copy()
    sigma[::10] *= 5.0
    fitted = fit(clip, PENDULUM)
    unit = unit_noise(fitted, clip.with_(sigma=sigma))
    np.testing.assert_allclose(unit[1::10], fitted.noise[0])
    np.testing.assert_allclose(unit[::10], 5.0 * fitted.noise[0])
    np.testing.assert_allclose(unit_noise(fitted, unstated(clip)), fitted.noise[0])


def test_change_is_resolved_from_three_stated_errors_in_three_samples():
    change = np.array([[8.0], [4.0], [-2.0], [1.0]])
    assert resolvable_size(change, np.full((4, 1), 0.5)) == pytest.approx(3.0 * 0.5 / 2.0)
    assert resolvable_size(change, np.zeros((4, 1))) == 0.0
    assert resolvable_size(0.0 * change, np.ones((4, 1))) == np.inf


def test_change_that_a_systematic_error_can_make_is_not_resolved():
    clip = swing({"zero-offset": 0.004})
    tilted = clip.with_(systematic={"vertical": np.full((1, 300, 1), 0.004)})
    offset = EFFECTS["zero-offset"]
    assert diagnose(clip, PENDULUM, effects=[offset]).added
    assert diagnose(tilted, PENDULUM, effects=[offset]).added == ()
