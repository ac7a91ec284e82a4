"""Predictions at any times: right beyond the data, with a band that holds the truth as often as it says."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid import (
    DataError,
    FitError,
    OdeModel,
    Parameter,
    Quantity,
    Trajectory,
    diagnose,
    discover,
    fit,
    predict,
    simulate,
)

T_S = np.arange(240) / 60
LATER_S = np.linspace(4.0, 8.0, 41)
NOISE_RAD = 2e-3


def angles(t_s, drag=0.0):
    """Angle of a pendulum of 0.6 m, by SciPy."""

    def slope(t, state):
        return state[1], -9.80665 / 0.6 * np.sin(state[0]) - 0.1 * state[1] - drag * abs(state[1]) * state[1]

    span = (0.0, float(np.max(t_s)) + 1e-9)
    solved = solve_ivp(slope, span, (0.8, 0.3), dense_output=True, rtol=1e-10, atol=1e-10)
    return solved.sol(t_s)[0]


def clip(seed=0, drag=0.0, valid=None):
    theta = (angles(T_S, drag) + NOISE_RAD * np.random.default_rng(seed).standard_normal(T_S.size))[:, None]
    valid = np.ones(T_S.size, dtype=bool) if valid is None else valid
    return Trajectory(T_S, (Quantity("theta", "rad"),), theta, np.full_like(theta, np.nan), valid)


def test_motion_is_continued_beyond_the_data_within_its_band():
    found = predict(fit(clip(), "pendulum"), LATER_S)
    error = np.abs(found.observed[:, 0] - angles(LATER_S))
    assert np.all(error < 5 * found.stderr[:, 0])
    assert np.all(found.stderr > 0)
    assert found.stderr[-1] > found.stderr[0]


def test_band_holds_the_truth_as_often_as_it_says():
    inside = []
    for seed in range(30):
        found = predict(fit(clip(seed), "pendulum"), [6.0])
        inside.append(found.lower[0, 0] < angles(np.array([6.0]))[0] < found.upper[0, 0])
    assert np.mean(inside) > 0.8  # 95 % expected: 30 draws give less than 80 % once in a thousand


def test_times_of_the_fit_give_what_the_fit_says():
    fitted = fit(clip(), "pendulum")
    np.testing.assert_allclose(predict(fitted, T_S).observed, fitted.predicted, atol=1e-6)


def test_any_order_and_single_times():
    fitted = fit(clip(), "pendulum")
    forth, back = predict(fitted, [1.0, 5.0]), predict(fitted, [5.0, 1.0])
    np.testing.assert_allclose(forth.observed, back.observed[::-1], atol=1e-9)
    np.testing.assert_allclose(predict(fitted, 5.0).observed[0], forth.observed[1], atol=1e-9)


def test_before_the_fitted_motion_nothing_is_known():
    fitted = fit(clip(valid=T_S > 0.5), "pendulum")
    found = predict(fitted, [0.1, 1.0])
    assert np.isnan(found.observed[0]).all()
    assert np.isfinite(found.observed[1]).all()


def test_equation_that_lacks_something_has_a_wider_band():
    wrong, right = (fit(clip(drag=drag), "pendulum") for drag in (0.2, 0.0))
    assert wrong.status == "misfit"
    wide, narrow = (predict(fitted, LATER_S) for fitted in (wrong, right))
    assert np.median(wide.stderr) > 5 * np.median(narrow.stderr)
    assert np.mean(np.abs(wide.observed[:, 0] - angles(LATER_S, 0.2)) < 2 * wide.stderr[:, 0]) > 0.9


def test_diagnosis_and_discovery_predict_with_what_they_found():
    dragged = clip(drag=0.2)
    for found in (diagnose(dragged, "pendulum", effects=["quadratic-drag"]), discover(dragged, resampled=5)):
        np.testing.assert_allclose(predict(found, LATER_S).observed[:, 0], angles(LATER_S, 0.2), atol=0.02)


def test_simulation_of_a_fit_with_another_length():
    fitted = fit(clip(), "pendulum")
    values = {name: estimate.value for name, estimate in fitted.estimates.items()} | {"length": 0.3}
    expected = simulate("pendulum", T_S, values).observed
    np.testing.assert_allclose(simulate(fitted, T_S, {"length": 0.3}).observed, expected)


def driven(t, state, params, inputs):
    return (params[0] * inputs[0] - 0.5 * state[0],)


LEVEL, PUMP = Quantity("h", "V"), Quantity("u", "V")
TANK = OdeModel(
    name="tank",
    summary="a tank with a pump",
    equation="",
    source="the test",
    states=(LEVEL,),
    parameters=(Parameter("pump", "1/s", "k", default=1.0),),
    observed=(LEVEL,),
    inputs=(PUMP,),
    rhs=driven,
    guess=lambda trajectory: {"h_0": 0.0},
)


def test_driven_model_needs_its_inputs_from_the_begin_of_the_fit_on():
    pumped = np.sin(T_S)[:, None]
    level = simulate(TANK, T_S, {"pump": 2.0, "h_0": 0.1}, inputs=pumped).observed
    level = level + 1e-3 * np.random.default_rng(0).standard_normal(level.shape)
    record = Trajectory(T_S, (LEVEL,), level, np.full_like(level, np.nan), level[:, 0] < np.inf, (PUMP,), pumped)
    fitted = fit(record, TANK)
    longer_s = np.arange(400) / 60
    found = predict(fitted, longer_s, inputs=np.sin(longer_s)[:, None])
    truth = simulate(TANK, longer_s, {"pump": 2.0, "h_0": 0.1}, inputs=np.sin(longer_s)[:, None]).observed
    assert np.all(np.abs(found.observed - truth) < 5 * found.stderr + 1e-6)
    with pytest.raises(DataError, match="is driven: give inputs"):
        predict(fitted, longer_s)
    with pytest.raises(DataError, match="begin at 0 s, where the fit begins"):
        predict(fitted, longer_s[5:], inputs=np.sin(longer_s)[5:, None])


def test_fit_that_failed_predicts_nothing():
    with pytest.raises(FitError, match="no estimates to predict with"):
        predict(fit(clip(valid=T_S < 0.04), "pendulum"), [1.0])
    with pytest.raises(DataError, match="not finite"):
        predict(fit(clip(), "pendulum"), [1.0, np.nan])
