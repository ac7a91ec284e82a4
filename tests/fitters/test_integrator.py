"""The integrator against closed forms, its order, uneven times, inputs, and its sensitivities."""

import operator
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from fitters.integrator.compile_rhs import compiled_rhs
from fitters.integrator.dormand_prince import ORDER, kernel
from fitters.integrator.initial_value_problem import initial_value_problem
from fitters.ode import sensitivity, simulate
from iris_sysid.errors import DataError, FitError
from iris_sysid.types import OdeModel, Parameter, Quantity

TRUTH = {"length": 0.5, "damping": 0.1, "gravity": 9.81, "theta_0": 1.5, "omega_0": -1.0}


def model_of(rhs, states=("y",), parameters=("rate",), inputs=(), **more) -> OdeModel:
    return OdeModel(
        name="made-up",
        summary="",
        equation="",
        source="",
        states=tuple(Quantity(name, "1") for name in states),
        parameters=tuple(Parameter(name, "1", name) for name in parameters),
        observed=(Quantity(states[0], "1"),),
        rhs=rhs,
        guess=lambda trajectory: {},
        inputs=tuple(Quantity(name, "1") for name in inputs),
        **more,
    )


def swing(t, state, params):
    theta, omega = state
    length, damping, gravity = params
    return omega, -damping * omega - gravity / length * np.sin(theta)


PENDULUM = model_of(swing, states=("theta", "omega"), parameters=("length", "damping", "gravity"))


def decay(t, state, params):
    return (-params[0] * state[0],)


def test_simulate_exponential_decay_equals_its_closed_form():
    t_s = np.linspace(0.0, 4.0, 30)
    states, observed = simulate(model_of(decay), t_s, {"rate": 1.3, "y_0": 2.0})
    np.testing.assert_allclose(states[:, 0], 2.0 * np.exp(-1.3 * t_s), atol=2e-9)
    np.testing.assert_array_equal(observed, states)


def test_simulate_large_undamped_pendulum_has_the_period_of_the_elliptic_integral():
    amplitude, length, gravity = np.deg2rad(150.0), 0.7, 9.8
    period_s = 4 * np.sqrt(length / gravity) * ellipk(np.sin(amplitude / 2) ** 2)
    values = {"length": length, "damping": 0.0, "gravity": gravity, "theta_0": amplitude, "omega_0": 0.0}
    states, _ = simulate(PENDULUM, [0.0, period_s / 4, period_s, 5 * period_s], values)
    np.testing.assert_allclose(states[:, 0], [amplitude, 0.0, amplitude, amplitude], atol=1e-6)


def test_global_error_falls_with_the_order_of_the_method():
    t_s = np.array([0.0, 2.0])
    values = np.array([TRUTH["length"], 0.1, 9.81, 1.5, -1.0])
    reference = solve_ivp(
        lambda t, y: PENDULUM.rhs(t, tuple(y), tuple(values[:3])), t_s, values[3:], rtol=3e-14, atol=1e-15,
        method="DOP853",
    )  # fmt: skip
    problem = initial_value_problem(PENDULUM, t_s, None, "linear")
    steps_s = 2.0 / np.array([10, 14, 20, 28, 40])
    errors = [
        np.abs(problem.with_step(step).states(values[:, None])[-1, :, 0] - reference.y[:, -1]).max() for step in steps_s
    ]
    slope = np.polyfit(np.log(steps_s), np.log(errors), 1)[0]
    assert slope == pytest.approx(ORDER, abs=0.5)


def test_uneven_times_give_what_even_times_give():
    rng = np.random.default_rng(1)
    even = np.linspace(0.0, 10.0, 601)
    uneven = np.sort(np.concatenate([[0.0, 10.0], even[1:-1][rng.random(599) < 0.3]]))
    all_states = simulate(PENDULUM, even, TRUTH).states
    some_states = simulate(PENDULUM, uneven, TRUTH).states
    np.testing.assert_allclose(some_states, all_states[np.searchsorted(even, uneven)], atol=1e-7)


def test_coarse_times_are_bridged_by_smaller_steps():
    coarse = simulate(PENDULUM, [0.0, 5.0, 10.0], TRUTH).states
    fine = simulate(PENDULUM, np.linspace(0.0, 10.0, 2001), TRUTH).states
    np.testing.assert_allclose(coarse, fine[[0, 1000, 2000]], atol=1e-6)


def test_prediction_is_smooth_in_the_parameters():
    problem = initial_value_problem(PENDULUM, np.linspace(0.0, 20.0, 601), None, "linear")
    values = np.array([0.5, 0.1, 9.81, 1.5, -1.0])
    problem = problem.planned(values, 1e-8)
    lengths = 0.5 + 1e-9 * np.arange(9)
    ends = [problem.predicted(np.concatenate([[length], values[1:]]))[-1, 0] for length in lengths]
    assert np.max(np.abs(np.diff(ends, 2))) < 1e-12


def over_the_rim(t, state, params, inputs):
    (level,) = state
    return (inputs[0] - params[0] * max(level - 1.0, 0.0),)


def test_kinked_equation_is_solved_to_what_the_noise_leaves_visible_and_no_finer():
    t_s = np.arange(0.0, 200.0, 2.0)
    inflow = 0.05 * np.sin(0.1 * t_s)[:, None] + 0.01
    model, values = model_of(over_the_rim, inputs=("u",)), np.array([1.0, 0.5])
    problem = initial_value_problem(model, t_s, inflow, "zero-order")
    negligible = 1e-5
    planned, exact = problem.planned(values, 1e-8, negligible), problem.planned(values, 1e-8)
    finest = problem.with_step(1e-3).predicted(values)
    errors = [np.max(np.abs(each.predicted(values) - finest)) / np.max(finest) for each in (planned, exact)]
    assert errors[1] < 5e-8 < errors[0] < negligible
    assert planned.ends.size < exact.ends.size


def stiffer_below(t, state, params):
    place, speed = state
    return (speed, -20.0 * place * (1.0 + params[0] * (place < 0.0)))


def test_steps_are_shortened_only_where_the_equation_has_its_kink():
    t_s = np.arange(0.0, 20.0, 1 / 60)
    problem = initial_value_problem(model_of(stiffer_below, states=("x", "v")), t_s, None, "linear")
    values, negligible = np.array([1.0, 0.3, 0.0]), 1e-6
    planned = problem.planned(values, 1e-8, negligible)
    place = planned.predicted(values)[:, 0]
    crossings = np.flatnonzero(np.diff(np.sign(place)))
    lengths = np.diff(planned.ends)
    short = planned.ends[:-1][lengths < np.median(lengths) / 4]
    assert 0 < short.size <= 10 * crossings.size
    assert np.max(np.min(np.abs(short[:, None] - crossings), axis=1)) <= 2
    finest = problem.with_step(1e-4).predicted(values)
    assert np.max(np.abs(finest[:, 0] - place)) < negligible * np.max(np.abs(place))


def test_steps_beside_a_kink_are_graded_because_it_moves():
    t_s = np.arange(0.0, 20.0, 1 / 60)
    problem = initial_value_problem(model_of(stiffer_below, states=("x", "v")), t_s, None, "linear")
    planned = problem.planned(np.array([1.0, 0.3, 0.0]), 1e-8)
    lengths = np.diff(planned.ends)
    assert lengths.min() < 0.1 < 2.0 < lengths.max()
    assert np.all(lengths[:-1] <= 3.0 * lengths[1:] * (1 + 1e-9))
    moved = np.array([1.0, 0.301, 0.0])
    finest = problem.with_step(1e-4).predicted(moved)
    assert np.max(np.abs(planned.predicted(moved) - finest)) < 1e-6 * np.max(np.abs(finest))


@pytest.mark.parametrize("duration_s", [1.0, 30.0, 300.0])
def test_planned_steps_are_as_exact_as_asked_for_however_long_the_record(duration_s):
    problem = initial_value_problem(PENDULUM, np.arange(0.0, duration_s, 1 / 30), None, "linear")
    values = np.array([0.5, 0.1, 9.81, 1.5, -1.0])
    finest = problem.with_step(1e-3).states(values[:, None])
    for tolerance in (1e-6, 1e-8):
        error = np.abs(problem.planned(values, tolerance).states(values[:, None]) - finest).max(axis=(0, 2))
        assert np.all(error < 3 * tolerance * np.abs(finest).max(axis=(0, 2)))


def test_smooth_equation_is_solved_as_exactly_whatever_the_noise_hides():
    problem = initial_value_problem(PENDULUM, np.linspace(0.0, 20.0, 201), None, "linear")
    values = np.array([0.5, 0.1, 9.81, 1.5, -1.0])
    np.testing.assert_array_equal(
        problem.planned(values, 1e-8, negligible=1e-4).ends, problem.planned(values, 1e-8).ends
    )


def test_many_columns_at_once_equal_one_at_a_time():
    problem = initial_value_problem(PENDULUM, np.linspace(0.0, 3.0, 100), None, "linear")
    columns = np.array([[0.5, 1.0, 2.0], [0.1, 0.0, 0.3], [9.8, 9.8, 1.6], [1.0, 2.0, 0.1], [0.0, 1.0, -1.0]])
    all_columns = problem.states(columns)
    for c in range(3):
        np.testing.assert_array_equal(all_columns[:, :, c], problem.states(columns[:, c : c + 1])[:, :, 0])


def filling(t, state, params, inputs):
    return (inputs[0] - params[0] * state[0],)


def test_linear_inputs_are_interpolated_between_samples():
    tank = model_of(filling, inputs=("u",))
    t_s = np.array([0.0, 0.7, 2.0, 2.5])
    observed = simulate(tank, t_s, {"rate": 0.0, "y_0": 1.0}, inputs=(3.0 * t_s)[:, None]).observed
    np.testing.assert_allclose(observed[:, 0], 1.0 + 1.5 * t_s**2, rtol=1e-12)


def test_zero_order_hold_keeps_the_input_until_the_next_sample():
    tank = model_of(filling, inputs=("u",))
    t_s = np.array([0.0, 1.0, 3.0])
    steps = np.array([[2.0], [5.0], [100.0]])
    observed = simulate(tank, t_s, {"rate": 0.0, "y_0": 0.0}, inputs=steps, hold="zero-order").observed
    np.testing.assert_allclose(observed[:, 0], [0.0, 2.0, 12.0], rtol=1e-12)


def test_sensitivity_equals_the_derivative_of_the_closed_form():
    t_s = np.linspace(0.0, 3.0, 50)
    slopes = sensitivity(model_of(decay), t_s, {"rate": 1.3, "y_0": 2.0}, ["rate", "y_0"])
    expected = np.column_stack([-t_s * 2.0 * np.exp(-1.3 * t_s), np.exp(-1.3 * t_s)])
    np.testing.assert_allclose(slopes[:, 0, :], expected, atol=1e-7)


def test_sensitivity_of_a_long_pendulum_equals_the_variational_equations():
    length, damping, gravity = 0.5, 0.1, 9.81

    def variational(t, y):
        theta, omega = y[:2]
        slopes = y[2:].reshape(2, 2)  # d (theta, omega) / d (length, theta_0)
        restoring = -gravity / length * np.cos(theta)
        forcing = np.array([gravity / length**2 * np.sin(theta), 0.0])
        rates = np.array([slopes[1], restoring * slopes[0] - damping * slopes[1] + forcing])
        return np.concatenate([[omega, -damping * omega - gravity / length * np.sin(theta)], rates.ravel()])

    t_s = np.linspace(0.0, 60.0, 3601)
    start = [1.5, -1.0, 0.0, 1.0, 0.0, 0.0]
    reference = solve_ivp(variational, (0, 60), start, t_eval=t_s, rtol=1e-11, atol=1e-12, method="DOP853").y
    slopes = sensitivity(PENDULUM, t_s, TRUTH, ["length", "theta_0"])[:, 0]
    error = np.max(np.abs(slopes - reference[2:4].T), axis=0) / np.max(np.abs(slopes), axis=0)
    assert np.all(error < 1e-6)


def test_solution_that_diverges_is_not_finite_and_raises_nothing():
    explosive = model_of(lambda t, state, params: (params[0] * state[0] ** 2,))
    observed = simulate(explosive, np.linspace(0.0, 3.0, 20), {"rate": 1.0, "y_0": 1.0}).observed
    assert np.isfinite(observed[0, 0])
    assert not np.isfinite(observed[-1, 0])


SIGNS = {"minus": operator.neg}  # numba cannot read a dictionary of functions


def not_for_numba(t, state, params):
    return (SIGNS["minus"](params[0] * state[0]),)


def test_model_that_numba_cannot_compile_runs_in_plain_python_with_the_same_steps():
    slow, fast = model_of(not_for_numba), model_of(decay)
    assert "numba cannot compile" in compiled_rhs(slow).note
    assert compiled_rhs(fast).note == ""
    t_s, values = np.linspace(0.0, 2.0, 20), {"rate": 0.7, "y_0": 1.5}
    np.testing.assert_allclose(simulate(slow, t_s, values).states, simulate(fast, t_s, values).states, rtol=1e-13)


def test_plain_python_arithmetic_errors_become_not_a_number():
    def divides(t, state, params):
        return (SIGNS["minus"](1.0) / (state[0] - state[0]),)

    observed = simulate(model_of(divides), [0.0, 1.0], {"rate": 0.7, "y_0": 1.5}).observed
    assert np.isnan(observed[-1, 0])


def test_same_function_is_compiled_once():
    assert compiled_rhs(model_of(decay)) is compiled_rhs(model_of(decay))


def test_model_whose_samples_show_warped_times_is_integrated_at_those():
    stretched = model_of(decay, parameters=("rate", "stretch"), warp=lambda t_s, params: t_s * params[1])
    t_s = np.linspace(0.0, 2.0, 20)
    observed = simulate(stretched, t_s, {"rate": 0.7, "stretch": 1.1, "y_0": 1.5}).observed
    np.testing.assert_allclose(observed[:, 0], 1.5 * np.exp(-0.77 * t_s), rtol=1e-8)


@pytest.mark.parametrize(
    ("rhs", "match"),
    [
        (lambda t, state, params: (1.0, 2.0), "must return a tuple with one derivative a state \\(y\\), not 2 values"),
        (lambda t, state, params: 1.0, "not float"),
        (lambda t, state, params: (undefined_name,), "raises NameError"),  # noqa: F821
        (lambda t, state: (1.0,), "raises TypeError.*rhs\\(t, state, params\\)"),
    ],
)
def test_simulate_wrong_right_hand_side_says_what_it_must_return(rhs, match):
    with pytest.raises(FitError, match=match):
        simulate(model_of(rhs), [0.0, 1.0], {"rate": 1.0, "y_0": 1.0})


@pytest.mark.parametrize(
    ("t_s", "values", "more", "error", "match"),
    [
        ([0.0, 1.0], {"y_0": 1.0}, {}, FitError, "needs a value for rate"),
        ([0.0, 1.0], {"rate": 1.0, "y_0": 1.0, "rat": 1.0}, {}, FitError, "no parameter 'rat'; it has rate, y_0"),
        ([1.0, 0.0], {"rate": 1.0, "y_0": 1.0}, {}, DataError, "t_s must increase"),
        ([], {"rate": 1.0, "y_0": 1.0}, {}, DataError, "t_s is empty"),
    ],
)
def test_simulate_bad_call_says_what_is_wrong(t_s, values, more, error, match):
    with pytest.raises(error, match=match):
        simulate(model_of(decay), t_s, values, **more)


def test_simulate_missing_inputs_are_refused():
    with pytest.raises(DataError, match=r"inputs must have shape \(2, 1\)"):
        simulate(model_of(filling, inputs=("u",)), [0.0, 1.0], {"rate": 1.0, "y_0": 1.0})


def test_cost_grows_linearly_with_the_number_of_samples():
    problem = initial_value_problem(PENDULUM, np.arange(0.0, 2000.0, 1 / 60), None, "linear")
    assert problem.substeps.sum() == problem.t_s.size - 1
    longer = problem.with_step(1 / 120)
    assert longer.substeps.sum() == 2 * (problem.t_s.size - 1)


def test_kernel_with_no_place_on_disk_is_compiled_in_memory():
    namespace = {}
    exec("def twice(x):\n    return 2 * x", namespace)  # numba finds no file to cache it beside
    assert kernel()(namespace["twice"])(4) == 8


LONG_RECORD_S = np.delete(np.arange(0.0, 250.0, 0.01), np.s_[9000:9700])  # 25,000 samples, and 7 s without any


def test_long_record_is_solved_in_steps_over_many_samples():
    uneven = LONG_RECORD_S + np.random.default_rng(2).uniform(0.0, 0.009, LONG_RECORD_S.size)
    values = np.array([2.0, 0.02, 9.81, 1.0, 0.5])
    reference = solve_ivp(
        lambda t, y: PENDULUM.rhs(t, tuple(y), tuple(values[:3])), uneven[[0, -1]], values[3:], t_eval=uneven,
        rtol=1e-12, atol=1e-12, method="DOP853",
    )  # fmt: skip
    planned = initial_value_problem(PENDULUM, uneven, None, "linear").planned(values, 1e-8)
    assert planned.ends.size < uneven.size / 3
    np.testing.assert_allclose(planned.states(values[:, None])[:, :, 0], reference.y.T, atol=3e-8)


def test_continuous_extension_has_its_order():
    values = np.array([2.0, 0.02, 9.81, 1.0, 0.5])
    problem = initial_value_problem(PENDULUM, LONG_RECORD_S[:800], None, "linear")
    exact = problem.with_step(0.001).states(values[:, None])
    samples = np.array([17.0, 23.5, 34.0, 47.0])
    plans = [replace(problem, ends=np.append(np.arange(0.0, 799.0, step), 799.0)) for step in samples]
    errors = [np.abs(plan.states(values[:, None]) - exact).max() for plan in plans]
    assert np.polyfit(np.log(samples), np.log(errors), 1)[0] > 7.0
