"""What the data determine: Hessian against finite differences, null directions, the residual of the equation."""

import numpy as np
import pytest

from fitters.ode import FitOptions, fit, simulate
from fitters.ode.identifiability import identifiability, scaled_condition
from iris_sysid.errors import FitError
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

PENDULUM = MODELS["pendulum"]
NAMES = ("length", "damping", "theta_0", "omega_0")
TRUTH = {"length": 0.6, "damping": 0.08, "theta_0": 0.9, "omega_0": 0.2}
NOISE = 2e-3


def clip_of(model, values, t_s, noise=0.0, seed=0):
    position = simulate(model, t_s, values).observed
    position = position + noise * np.random.default_rng(seed).standard_normal(position.shape)
    return Trajectory(t_s, model.observed, position, np.full_like(position, np.nan), np.ones(t_s.size, bool))


@pytest.fixture(scope="module")
def swing():
    return clip_of(PENDULUM, TRUTH, np.arange(600) / 60, NOISE)


@pytest.fixture(scope="module")
def fitted(swing):
    return fit(swing, PENDULUM)


def test_hessian_equals_differences_of_the_likelihood_itself(swing, fitted):
    determined = identifiability(fitted)
    best = np.array([fitted.estimates[name].value for name in NAMES])
    steps = 0.3 * np.sqrt(np.diag(np.linalg.inv(fitted.fisher)))

    def minus_log_likelihood(values):
        seen = simulate(PENDULUM, swing.t_s, dict(zip(NAMES, values, strict=True))).observed
        return np.sum((swing.position - seen) ** 2) / (2 * fitted.rms[0] ** 2)

    for i in range(4):
        for j in range(4):
            a, b = np.eye(4)[i] * steps[i], np.eye(4)[j] * steps[j]
            corners = [minus_log_likelihood(best + s * a + r * b) * s * r for s in (1, -1) for r in (1, -1)]
            expected = sum(corners) / (4 * steps[i] * steps[j])
            scale = np.sqrt(determined.hessian[i, i] * determined.hessian[j, j])
            assert determined.hessian[i, j] == pytest.approx(expected, abs=0.01 * scale)


def test_hessian_at_the_optimum_of_good_data_is_close_to_the_fisher_information(fitted):
    determined = identifiability(fitted)
    assert determined.names == fitted.free
    assert determined.hessian_condition == pytest.approx(determined.condition, rel=0.05)
    assert scaled_condition(fitted.fisher) == pytest.approx(determined.condition, rel=1e-6)


def test_null_direction_of_the_apparent_radius_is_reported_in_words():
    model = MODELS["apparent-radius"]
    clip = clip_of(model, {"r0_f": 60.0, "h_0": 0.8, "v_0": 0.1}, np.arange(200) / 240, 0.05)
    result = fit(clip, model, free=["gravity"])
    assert result.status == "singular"
    assert "scale together" in result.identifiability.undetermined[0]
    for name in ("r0_f", "gravity", "h_0"):
        assert name in result.identifiability.undetermined[0]
    assert "Give one of" in result.message
    assert fit(clip, model, free=["gravity"], fixed={"h_0": 0.8}).ok


def test_determined_fit_has_no_null_direction_and_names_what_it_tells_apart_least():
    """A short piece of a swing hardly tells the length from the speed at its start."""
    result = fit(clip_of(PENDULUM, TRUTH, np.arange(60) / 240, 1e-4), PENDULUM)
    assert result.identifiability.undetermined == ()
    assert "are the least distinguishable" in result.identifiability.weakest


def test_gradient_falls_by_orders_of_magnitude_along_the_iterations(swing):
    result = fit(swing, PENDULUM, start=TRUTH | {"length": 0.7}, options=FitOptions(local=True))
    gradients = result.identifiability.gradients
    assert len(gradients) > 2
    assert gradients[-1] < 1e-3 * gradients[0]


def test_residual_of_the_equation_equals_one_step_of_the_pendulum_from_the_measured_angles(swing, fitted):
    """As the benchmark defines R: a step from the position and its backward difference, acceleration included."""
    theta, step_s = swing.position[:, 0], 1 / 60
    length, damping = (fitted.estimates[name].value for name in ("length", "damping"))
    speed = (theta[2:] - theta[:-2]) / (2 * step_s)
    acceleration = -9.80665 / length * np.sin(theta[1:-1]) - damping * speed
    expected = np.mean((theta[2:] - 2 * theta[1:-1] + theta[:-2] - step_s**2 * acceleration) ** 2)
    determined = fitted.identifiability
    assert determined.ode_residual[0] == pytest.approx(expected, rel=0.02)
    assert determined.ode_residual[0] == pytest.approx(6 * NOISE**2, rel=0.15)
    assert determined.ode_residual_noise[0] == pytest.approx(6 * NOISE**2, rel=0.15)


def test_residual_of_a_first_order_equation_is_that_of_one_step():
    model = MODELS["exponential-decay"]
    result = fit(clip_of(model, {"decay_rate": 0.9, "intensity_0": 1.0}, np.arange(600) / 200, 1e-3), model)
    assert result.identifiability.ode_residual[0] == pytest.approx(2e-6, rel=0.2)


def test_failed_fit_has_nothing_to_identify():
    result = fit(clip_of(PENDULUM, TRUTH, np.arange(4) / 60), PENDULUM)
    assert result.status == "too-short"
    with pytest.raises(FitError, match="too-short"):
        identifiability(result)
