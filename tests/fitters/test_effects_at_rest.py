"""Effects that change what pulls back, and not the damping: SciPy integrates the truth."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.compose_effects import with_effects
from fitters.effect_sensitivity import sensitivities
from iris_sysid import EFFECTS, MODELS, Trajectory, fit, model_from_equation, simulate

PENDULUM = MODELS["pendulum"]
T_S = np.arange(300) / 60
START = {"theta_0": 0.7, "omega_0": 0.3}
DAMPED = {"length": 0.5, "damping": 0.3, **START}


def seen(theta):
    return Trajectory(T_S, PENDULUM.observed, theta, np.full_like(theta, np.nan), np.ones(T_S.size, dtype=bool))


def test_drift_changes_the_pull_and_not_the_damping():
    def rates(t, state):
        x, v = state
        return v, -(PENDULUM.parameter("gravity").default / 0.5) * (1.0 + 0.05 * t) * math.sin(x) - 0.3 * v

    truth = solve_ivp(rates, (0.0, T_S[-1]), (0.7, 0.3), t_eval=T_S, rtol=1e-10, atol=1e-12).y[:1].T
    model = with_effects(PENDULUM, ["parameter-drift"])
    found = simulate(model, T_S, {**DAMPED, "parameter_drift": 0.05, "drift_start": 0.0}).observed
    np.testing.assert_allclose(found, truth, atol=1e-6)


@pytest.mark.parametrize("name", ["parameter-drift", "slack-tether", "clearance"])
def test_effect_on_the_pull_acts_before_another_one_whatever_their_order(name):
    slopes = []
    for order in ([name, "coulomb-friction"], ["coulomb-friction", name]):
        model = with_effects(PENDULUM, order)
        values = {parameter.name: 0.7 for parameter in model.parameters}
        slopes.append(model.rhs(0.9, (-0.4, 0.8), tuple(values[each.name] for each in model.parameters)))
    np.testing.assert_allclose(*slopes, rtol=1e-13)


def test_where_nothing_pulls_back_the_whole_force_changes():
    coasting = model_from_equation("x'' = -c*x'", units={"x": "m", "c": "1/s"})
    model = with_effects(coasting, ["parameter-drift"])
    params = {
        "c": 2.0,
        "parameter_drift": 0.1,
        "drift_start": 0.0,
        "drift_settling": 0.0,
        "drift_damping": 0.0,
        "drift_span": 1.0,
    }
    _, slope = model.rhs(3.0, (1.0, 0.5), tuple(params[each.name] for each in model.parameters))
    assert slope == pytest.approx(-2.0 * 0.5 * (1.0 + 0.1 * 3.0))


@pytest.mark.parametrize(
    ("name", "shape"), [("parameter-drift", (0.0, 0.0, 0.0, 1.0)), ("slack-tether", (-1.0,)), ("clearance", (0.05,))]
)
def test_first_order_change_is_that_of_the_simulation(name, shape):
    theta = simulate(PENDULUM, T_S, DAMPED).observed
    fitted = fit(seen(theta), PENDULUM)
    model, effect = with_effects(PENDULUM, [name]), EFFECTS[name]
    size, *others = (parameter.name for parameter in effect.parameters)
    given = {
        **{each: estimate.value for each, estimate in fitted.estimates.items()},
        **dict(zip(others, shape, strict=True)),
    }
    higher, lower = (simulate(model, T_S, {**given, size: change}).observed for change in (1e-4, -1e-4))
    expected = (higher - lower)[fitted.used] / 2e-4
    found = sensitivities(effect, [shape], fitted, seen(theta))[0]
    np.testing.assert_allclose(found, expected, atol=0.01 * np.max(np.abs(expected)))
