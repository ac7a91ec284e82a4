"""Steps, parts, inputs and difference steps of an initial value problem, one by one."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.integrator import initial_value_problem as module
from fitters.integrator.initial_value_problem import (
    MAX_STEPS,
    RESPONSE,
    adapted_steps,
    difference_steps,
    first_steps,
    initial_value_problem,
    value_names,
)
from fitters.ode import simulate
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Quantity
from tests.fitters.test_integrator import PENDULUM, decay, filling, model_of

VALUES = np.array([0.5, 0.1, 9.81, 1.5, -1.0])  # of the pendulum
UNEVEN_S = np.array([0.0, 1.0, 1.5, 4.0])
TANK = model_of(filling, inputs=("u",))


def test_values_are_the_parameters_and_then_the_initial_states():
    assert value_names(PENDULUM) == ("length", "damping", "gravity", "theta_0", "omega_0")


def test_a_new_problem_has_one_step_a_sample_and_copies_of_its_times_and_inputs():
    t_s, inputs = UNEVEN_S.copy(), np.ones((4, 1))
    problem = initial_value_problem(TANK, t_s, inputs, "linear")
    t_s[1], inputs[0] = 9.0, 9.0
    np.testing.assert_array_equal(problem.t_s, UNEVEN_S)
    np.testing.assert_array_equal(problem.inputs, np.ones((4, 1)))
    np.testing.assert_array_equal(problem.ends, [0.0, 1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("longest_s", "counts"),
    [(10.0, [1, 1, 1]), (1.0, [1, 1, 3]), (0.5, [2, 1, 5]), (0.3, [4, 2, 9]), (1e-9, [MAX_STEPS[1]] * 3)],
)
def test_each_interval_has_the_fewest_equal_steps_that_are_short_enough(longest_s, counts):
    problem = initial_value_problem(model_of(decay), UNEVEN_S, None, "linear").with_step(longest_s)
    expected = np.concatenate([k + np.arange(count) / count for k, count in enumerate(counts)])
    np.testing.assert_array_equal(problem.ends, [*expected, 3.0])
    np.testing.assert_array_equal(problem.substeps, counts)


def test_halved_steps_end_where_the_whole_ones_do_and_in_their_middles():
    problem = replace(initial_value_problem(PENDULUM, UNEVEN_S, None, "linear"), ends=np.array([0.0, 0.5, 3.0]))
    np.testing.assert_array_equal(problem.halved().ends, [0.0, 0.25, 0.5, 1.75, 3.0])


@pytest.mark.parametrize(
    ("start", "stop", "ends"),
    [(0, 3, [0.0, 0.5, 2.0, 2.5, 3.0]), (1, 3, [0.0, 1.0, 1.5, 2.0]), (0, 2, [0.0, 0.5, 2.0]), (2, 2, [0.0])],
)
def test_a_part_keeps_the_steps_inside_and_cuts_the_one_that_reaches_out(start, stop, ends):
    whole = initial_value_problem(TANK, UNEVEN_S, np.arange(4.0)[:, None], "linear")
    part = replace(whole, ends=np.array([0.0, 0.5, 2.0, 2.5, 3.0])).part(start, stop)
    np.testing.assert_array_equal(part.ends, ends)
    np.testing.assert_array_equal(part.t_s, UNEVEN_S[start : stop + 1])
    np.testing.assert_array_equal(part.inputs[:, 0], np.arange(start, stop + 1))


def test_the_first_samples_and_every_second_one():
    problem = initial_value_problem(model_of(decay), UNEVEN_S, None, "linear").with_step(0.5)
    first, second = problem.first(2), problem.every(2)
    np.testing.assert_array_equal(first.t_s, [0.0, 1.0])
    np.testing.assert_array_equal(first.ends, [0.0, 0.5, 1.0])
    np.testing.assert_array_equal(second.t_s, [0.0, 1.5])
    np.testing.assert_array_equal(second.ends, [0.0, 1.0])


LEVELS = [[0.0], [1.0], [1.0], [1.0], [2.0], [5.0]]


@pytest.mark.parametrize(
    ("hold", "inputs", "more", "latest"),
    [
        ("zero-order", LEVELS, {}, [1, 4, 4, 4, 5]),
        ("linear", LEVELS, {}, [1, 2, 3, 4, 5]),
        ("zero-order", LEVELS, {"drive": lambda t_s, inputs, params: inputs}, [1, 2, 3, 4, 5]),
        ("linear", None, {}, [5, 5, 5, 5, 5]),
        ("zero-order", None, {}, [5, 5, 5, 5, 5]),
    ],
)
def test_a_step_ends_where_an_input_may_jump(hold, inputs, more, latest):
    model = model_of(filling, inputs=("u",), **more) if inputs else model_of(decay)
    problem = initial_value_problem(model, np.arange(6.0), inputs, hold)
    np.testing.assert_array_equal(problem._latest_ends(), latest)


def test_derivatives_of_the_states_are_those_of_the_equation_with_the_inputs_that_act():
    doubled = model_of(filling, inputs=("u",), drive=lambda t_s, inputs, params: inputs * 2.0 * params[0])
    problem = initial_value_problem(doubled, UNEVEN_S, [[1.0], [2.0], [3.0], [4.0]], "linear")
    states, rates = np.array([[1.0], [0.5], [0.2], [0.1]]), np.array([[1.5, 3.0]])
    levels = np.arange(1.0, 5.0)[:, None]
    expected = 2.0 * rates * levels - rates * states
    np.testing.assert_allclose(problem.slopes_of(states, rates)[:, 0, :], expected, rtol=1e-14)
    np.testing.assert_allclose(problem.slopes(states, rates[:, 1])[:, 0], expected[:, 1], rtol=1e-14)
    known = problem.driven(rates[:, 0])
    assert known.model.drive is None
    np.testing.assert_array_equal(known.inputs, 3.0 * levels)
    np.testing.assert_array_equal(known.states(np.array([[1.5], [1.0]])), problem.states(np.array([[1.5], [1.0]])))


def test_columns_whose_values_move_times_or_inputs_are_solved_each_with_its_own():
    model = model_of(
        filling,
        inputs=("u",),
        parameters=("rate", "stretch"),
        warp=lambda t_s, params: t_s * params[1],
        drive=lambda t_s, inputs, params: inputs * params[1],
    )
    problem = initial_value_problem(model, np.linspace(0.0, 1.0, 11), np.ones((11, 1)), "zero-order").with_step(0.01)
    columns = np.array([[0.7, 0.7, 0.9, 0.7], [1.0, 2.0, 1.0, -1.0], [0.0, 0.0, 1.0, 0.0]])
    states = problem.states(columns)[:, 0]
    rate, stretch, start = columns[:, :3]
    level = stretch / rate
    expected = level + (start - level) * np.exp(-rate * stretch * problem.t_s[:, None])
    np.testing.assert_allclose(states[:, :3], expected, rtol=1e-9, atol=1e-12)
    assert np.all(np.isnan(states[:, 3]))  # time would run backwards
    for stretch in (-1.0, 0.0):  # backwards, and at rest: there is nothing to plan
        np.testing.assert_array_equal(problem.planned(np.array([0.7, stretch, 0.0]), 1e-8).ends, problem.ends)


def test_predictions_in_batches_equal_those_at_once(monkeypatch):
    problem = initial_value_problem(PENDULUM, np.linspace(0.0, 1.0, 20), None, "linear")
    columns = VALUES[:, None] * np.linspace(1.0, 1.2, 7)
    whole = problem.predictions(columns)
    assert whole.shape == (20, 1, 7)
    np.testing.assert_array_equal(whole[:, :, 5], problem.predicted(columns[:, 5]))
    of_all, batches = module.InitialValueProblem.states, []

    def counted(problem, columns):
        batches.append(columns.shape[1])
        return of_all(problem, columns)

    monkeypatch.setattr(module.InitialValueProblem, "states", counted)
    for numbers in (1, 3 * 20 * 2):  # one column a batch even where none has room; three a batch
        monkeypatch.setattr(module, "BATCH_NUMBERS", numbers)
        np.testing.assert_array_equal(problem.predictions(columns), whole)
    assert batches == [*[1] * 7, 3, 3, 1]


def test_rough_sensitivities_are_one_sided_with_a_hundredth_of_the_step():
    t_s = np.linspace(0.0, 3.0, 40)
    problem = initial_value_problem(model_of(decay), t_s, None, "linear").with_step(0.01)
    values, which, steps = np.array([1.3, 2.0]), np.array([1, 0]), np.array([0.1, 0.1])
    exact = np.column_stack([np.exp(-1.3 * t_s), -t_s * 2.0 * np.exp(-1.3 * t_s)])
    rough = problem.rough_sensitivity(values, which, steps, problem.predicted(values))[:, 0]
    central = problem.sensitivity(values, which, steps)[:, 0]
    shift = (np.expm1(-1e-3 * t_s) / 1e-3) * 2.0 * np.exp(-1.3 * t_s)
    np.testing.assert_allclose(rough[:, 1], shift, atol=1e-9)
    np.testing.assert_allclose(central[:, 1], -np.sinh(0.1 * t_s) / 0.1 * 2.0 * np.exp(-1.3 * t_s), atol=1e-11)
    np.testing.assert_allclose(rough[:, 0], exact[:, 0], atol=1e-9)


def test_first_difference_steps_are_relative_to_values_that_are_not_small():
    steps = first_steps(np.array([2.0, -30.0, 0.0, 1e-5]), np.array([1, 0, 2, 3]))
    np.testing.assert_allclose(steps, [3e-4, 2e-5, 1e-8, 1e-8], rtol=1e-14)


def test_adapted_steps_move_the_prediction_by_the_same_part_of_the_motion():
    slopes = np.zeros((3, 2, 6))
    slopes[1, 0], slopes[2, 1] = [-4.0, 0.1, 0.0, np.nan, 1e9, 1e-12], [2.0, 1.0, 0.0, np.nan, 0.0, 0.0]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a column without any number
        slopes[0, :, 3] = slopes[2, :, 3] = np.nan
        adapted = adapted_steps(np.full(6, 1e-4), slopes, np.array([2.0, 0.1]))
    # responses 20 and 10 a unit; none and no number keep the step; and no more than two or five powers of ten at once
    np.testing.assert_allclose(adapted, [RESPONSE / 20, RESPONSE / 10, 1e-4, 1e-4, 1e-6, 1e1], rtol=1e-12)
    still = adapted_steps(np.array([1e-4]), np.full((1, 1, 1), 5.0), np.array([0.0]))
    np.testing.assert_allclose(still, RESPONSE / 5.0, rtol=1e-12)


def test_difference_steps_move_the_prediction_by_a_ten_thousandth_of_its_size():
    problem = initial_value_problem(PENDULUM, np.linspace(0.0, 10.0, 301), None, "linear").planned(VALUES, 1e-8)
    which = np.array([0, 2, 3])
    steps = difference_steps(problem, VALUES, which)
    moved = np.abs(problem.sensitivity(VALUES, which, steps)[:, 0] * steps).max(axis=0)
    np.testing.assert_allclose(moved, RESPONSE * np.abs(problem.predicted(VALUES)).max(), rtol=1e-3)


def test_the_error_of_the_steps_is_relative_to_the_size_of_each_state():
    problem = initial_value_problem(model_of(decay), np.array([0.0, 1.0, 3.0]), None, "linear")
    small, large = (problem.step_error(np.array([1.3, size])) for size in (1e-6, 1e3))
    assert small == pytest.approx(large, rel=1e-6)
    coarse, fine = (each.predicted(np.array([1.3, 1e3])) for each in (problem, problem.halved()))
    assert large == pytest.approx(np.abs(coarse - fine).max() / 1e3, rel=1e-9)
    assert problem.step_error(np.array([1.3, 0.0])) == 0.0
    explosive = model_of(lambda t, state, params: (params[0] * state[0] ** 2,))
    assert initial_value_problem(explosive, np.linspace(0, 3, 20), None, "linear").step_error(np.ones(2)) == np.inf


@pytest.mark.parametrize("tolerance", [1e-6, 1e-9])
def test_equal_steps_are_shortened_until_they_are_exact_enough_and_no_further(monkeypatch, tolerance):
    monkeypatch.setattr(module, "PLANNED", 6)  # of 6 samples
    problem = initial_value_problem(PENDULUM, 0.3 * np.arange(6.0), None, "linear")
    planned = problem._planned_through_events(VALUES, tolerance)
    counts = planned.substeps
    assert np.all(counts == counts[0])
    assert planned.step_error(VALUES) <= tolerance
    assert problem.with_step(0.3 / (counts[0] / 2)).step_error(VALUES) > tolerance
    np.testing.assert_array_equal(planned._planned_through_events(VALUES, 1.0).ends, problem.ends)


def test_equal_steps_are_given_up_where_the_solution_diverges(monkeypatch):
    monkeypatch.setattr(module, "PLANNED", 20)  # of 20 samples
    explosive = model_of(lambda t, state, params: (params[0] * state[0] ** 2,))
    problem = initial_value_problem(explosive, np.linspace(0.0, 3.0, 20), None, "linear")
    assert set(problem._planned_through_events(np.ones(2), 1e-8).substeps) == {16}  # a quarter, and one more


def test_where_the_solution_diverges_there_is_one_step_a_sample():
    explosive = model_of(lambda t, state, params: (params[0] * state[0] ** 2,))
    planned = initial_value_problem(explosive, np.linspace(0.0, 3.0, 31), None, "linear").planned(np.ones(2), 1e-8)
    np.testing.assert_array_equal(planned.ends[planned.ends > 15.5], np.arange(16.0, 31.0))  # it diverges at 10
    assert np.all(np.diff(planned.ends) > 0)


def test_two_samples_are_bridged_by_as_many_steps_as_it_takes():
    problem = initial_value_problem(PENDULUM, np.array([0.0, 2.0]), None, "linear")
    planned = problem.planned(VALUES, 1e-8)
    np.testing.assert_allclose(planned.predicted(VALUES), problem.with_step(1e-3).predicted(VALUES), atol=1e-7)


def test_observed_states_are_found_by_name():
    second = replace(PENDULUM, observed=(Quantity("omega", "rad/s"), Quantity("theta", "rad")))
    problem = initial_value_problem(second, np.array([0.0, 1.0]), None, "linear")
    np.testing.assert_array_equal(problem.observe(np.array([[1.0, 2.0], [3.0, 4.0]]), VALUES), [[2.0, 1.0], [4.0, 3.0]])


def test_an_observation_is_given_times_states_and_parameters():
    def seen(t_s, states, params):
        return (t_s + states[:, 0] * params[0])[:, None]

    problem = initial_value_problem(replace(PENDULUM, observe=seen), np.array([0.0, 1.0]), None, "linear")
    np.testing.assert_array_equal(problem.observe(np.ones((2, 2)), VALUES), [[0.5], [1.5]])


@pytest.mark.parametrize(
    ("observe", "match"),
    [
        (lambda t_s, states: states, r"observe of model 'made-up' raises TypeError: .*\(n, 2\), params \(3,\)\)"),
        (lambda t_s, states, params: states, r"must return an array \(3, 1\), not \(3, 2\)"),
    ],
)
def test_a_wrong_observation_says_how_it_is_called(observe, match):
    problem = initial_value_problem(replace(PENDULUM, observe=observe), np.arange(3.0), None, "linear")
    with pytest.raises(FitError, match=match):
        problem.predicted(VALUES)


def test_hidden_states_follow_along_the_own_ones_from_zero():
    def lagging(t, state, params):
        return (-params[0] * state[0], state[0])

    model = model_of(lagging, states=("y", "sum"))
    problem = initial_value_problem(replace(model, hidden=1), np.linspace(0.0, 2.0, 201), None, "linear")
    own = np.exp(-0.7 * problem.t_s)[:, None]
    followed = problem.with_hidden(own, np.array([0.7]))
    np.testing.assert_array_equal(followed[:, :1], own)
    np.testing.assert_allclose(followed[:, 1], (1.0 - own[:, 0]) / 0.7, atol=2e-3)
    plain = initial_value_problem(model, problem.t_s, None, "linear")
    assert plain.with_hidden(own, np.array([0.7])) is own


@pytest.mark.parametrize("n", [4, 5, 2000])
def test_the_first_samples_are_no_more_than_there_are(n):
    problem = initial_value_problem(PENDULUM, UNEVEN_S, np.empty((4, 0)), "linear")
    np.testing.assert_array_equal(problem.first(n).ends, problem.ends)


def test_a_motion_of_one_sample_is_its_initial_state():
    assert simulate(PENDULUM, [0.0], dict(zip(value_names(PENDULUM), VALUES, strict=True))).states.tolist() == [
        [1.5, -1.0]
    ]


@pytest.mark.parametrize("when_s", [0.31, 1.2, 1.53, 1.9])
def test_no_step_passes_over_a_blow(when_s):
    """A constant acceleration allows steps of any length; the blow lasts one of 120 samples."""
    incline = with_effects(MODELS["incline"], [EFFECTS["impact"]])
    t_s = np.arange(120) / 60
    blow = {"impact": 0.02, "impact_time": when_s, "impact_width": 1 / 60}
    seen = simulate(incline, t_s, {"acceleration": 1.5, "s_0": 0.0, "v_0": 0.3, **blow}, tolerance=1e-5)
    late = t_s > when_s + 0.1
    expected = 0.3 * t_s + 0.75 * t_s**2 + 0.02 * (t_s - when_s)
    np.testing.assert_allclose(seen.observed[late, 0], expected[late], rtol=0, atol=1e-5)
