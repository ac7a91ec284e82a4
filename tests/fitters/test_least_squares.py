"""The parts of the least squares by themselves, and a minimum that has a closed form."""

import numpy as np
import pytest

from fitters.integrator.initial_value_problem import first_steps
from fitters.ode.least_squares import FINE, MAX_RESIDUAL, ROUGH, Target, Unknowns, _Objective, minimise, reweighted
from tests.fitters.curve_fit import _Curve

X = np.linspace(0.0, 2.0, 21)
SLOPE, OFFSET = 1.7, -0.4


def line(x, b):
    return b[0] * x + b[1]


def target_of(observed, sigma=0.1) -> Target:
    observed = np.asarray(observed, dtype=np.float64).reshape(X.size, -1)
    return Target(observed, np.full_like(observed, sigma), np.ones(X.size, dtype=bool))


def unknowns_of(lower=(-np.inf, -np.inf), upper=(np.inf, np.inf), expected=(0.0, 0.0), precision=(0.0, 0.0)):
    arrays = (np.array(each, dtype=np.float64) for each in (lower, upper, expected, precision))
    return Unknowns(np.array([0, 1]), ("slope", "offset"), *arrays)


def minimised(observed, unknowns=None, start=(0.0, 0.0), **more):
    return minimise(_Curve(line, X), target_of(observed), unknowns or unknowns_of(), np.array(start), **more)


def noisy(seed=0):
    return SLOPE * X + OFFSET + 0.1 * np.random.default_rng(seed).standard_normal(X.size)


# --------------------------------------------------------------------------- the data


def test_weighted_values_are_in_sigmas_of_their_own_sample_and_quantity_by_time():
    observed = np.arange(6.0).reshape(3, 2)
    target = Target(observed, np.array([[1.0, 2.0], [4.0, 5.0], [8.0, 10.0]]), np.array([True, False, True]))
    assert target.weighted(observed).tolist() == [0.0, 0.5, 0.5, 0.5]
    slopes = np.stack([observed, 10.0 * observed], axis=2)
    assert target.weighted(slopes).tolist() == [[0.0, 0.0], [0.5, 5.0], [0.5, 5.0], [0.5, 5.0]]


def test_parts_of_the_data_keep_values_errors_and_marks_together():
    target = Target(np.arange(5.0)[:, None], np.arange(5.0)[:, None] + 10.0, np.arange(5) % 3 == 0)
    first, every = target.first(2), target.every(2)
    assert (first.observed[:, 0].tolist(), first.sigma[:, 0].tolist()) == ([0.0, 1.0], [10.0, 11.0])
    assert (every.observed[:, 0].tolist(), every.sigma[:, 0].tolist()) == ([0.0, 2.0, 4.0], [10.0, 12.0, 14.0])
    assert (first.used.tolist(), every.used.tolist()) == ([True, False], [True, False, False])
    assert target.size == pytest.approx([1.5])


def test_error_that_is_negligible_is_a_hundredth_of_the_noise_and_a_ten_thousandth_of_the_motion_at_most():
    observed = np.array([[0.2, 0.0], [-0.4, 0.0]])
    fine = Target(observed, np.array([[2e-3, 1e-2], [2e-3, 1e-2]]), np.array([True, True]))
    assert fine.negligible == pytest.approx(1e-2 * 2e-3 / 0.4)
    still = Target(observed, np.array([[2e-3, 1e-5], [2e-3, 1e-5]]), np.array([True, True]))
    assert still.negligible == pytest.approx(1e-2 * 1e-5)  # of what does not move the size counts as one
    assert Target(observed, np.full((2, 2), 1.0), np.array([True, True])).negligible == 1e-4


def test_robust_weights_leave_a_small_residual_and_grow_with_a_large_one():
    solution = minimised(SLOPE * X + OFFSET)
    outlier = np.zeros((X.size, 1))
    outlier[3, 0] = 0.1 * 2.0 * np.sqrt(15.0)  # sqrt(1 + 15) = 4, whose square root widens sigma
    moved = Target(solution.predicted + outlier, np.full((X.size, 1), 0.1), np.ones(X.size, dtype=bool))
    sigma = reweighted(moved, solution).sigma[:, 0]
    assert sigma[3] == pytest.approx(0.2)
    assert np.delete(sigma, 3) == pytest.approx(0.1)


# --------------------------------------------------------------------------- the unknowns


def test_priors_are_residuals_in_their_own_errors():
    unknowns = unknowns_of(expected=(2.0, 5.0), precision=(10.0, 0.0))
    assert unknowns.measured.tolist() == [0]
    assert unknowns.prior_rows.tolist() == [[10.0, 0.0]]
    assert unknowns.prior_residual(np.array([1.5, 7.0])).tolist() == [5.0]
    assert unknowns.weighing_priors(0.5).prior_residual(np.array([1.5, 7.0])).tolist() == [2.5]


def test_unknowns_without_one_or_with_some_keep_what_belongs_to_each():
    unknowns = unknowns_of(lower=(-1.0, -2.0), upper=(1.0, 2.0), expected=(0.1, 0.2), precision=(3.0, 4.0))
    for kept in (unknowns.without(0), unknowns.only(["offset"])):
        assert (kept.which.tolist(), kept.names) == ([1], ("offset",))
        parts = (kept.lower, kept.upper, kept.expected, kept.precision)
        assert [part.tolist() for part in parts] == [[-2.0], [2.0], [0.2], [4.0]]


def test_start_is_moved_inside_its_bounds_by_a_millionth_of_their_distance():
    moved = unknowns_of(lower=(0.0, 0.0), upper=(4.0, np.inf)).inside(np.array([9.0, -3.0]))
    assert moved == pytest.approx([4.0 - 4e-6, 1e-6], rel=1e-12)
    low = unknowns_of(lower=(-4.0, 0.0), upper=(0.0, np.inf)).inside(np.array([-9.0, 3.0]))
    assert low == pytest.approx([-4.0 + 4e-6, 3.0], rel=1e-12)
    assert unknowns_of(lower=(0.0, -9.0), upper=(4.0, 9.0)).inside(np.array([2.0, 3.0])).tolist() == [2.0, 3.0]


# --------------------------------------------------------------------------- the minimum


def test_minimum_of_a_line_is_that_of_the_normal_equations():
    observed = noisy()
    solution = minimised(observed)
    assert solution.values == pytest.approx(np.polyfit(X, observed, 1), rel=1e-7)
    residual = (observed - np.polyval(solution.values, X)) / 0.1
    assert solution.rms == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-9)
    assert solution.predicted[:, 0] == pytest.approx(np.polyval(solution.values, X))
    assert (solution.converged, solution.fine) == (True, True)
    assert solution.gradients[0] > 0.1 > 1e-6 > solution.gradients[-1]


def test_prior_draws_the_minimum_as_one_more_observation_does():
    observed, stderr = noisy(), 0.02
    solution = minimised(observed, unknowns_of(expected=(2.0, 0.0), precision=(1 / stderr, 0.0)))
    design = np.vstack([np.column_stack([X, np.ones(X.size)]) / 0.1, [1 / stderr, 0.0]])
    expected = np.linalg.lstsq(design, np.append(observed / 0.1, 2.0 / stderr))[0]
    assert solution.values == pytest.approx(expected, rel=1e-6)
    residual = (observed - np.polyval(expected, X)) / 0.1
    assert solution.rms == pytest.approx(np.sqrt(np.mean(residual**2)), rel=1e-6)  # of the data, without the prior


def test_jacobian_is_the_derivative_of_the_residual():
    unknowns = unknowns_of(expected=(2.0, 5.0), precision=(10.0, 0.0))
    start = np.array([1.0, 2.0])
    objective = _Objective(_Curve(line, X), target_of(noisy()), unknowns, start, first_steps(start, unknowns.which))
    sides = [[objective.residual(start + sign * step) for sign in (1, -1)] for step in 1e-4 * np.eye(2)]
    expected = np.array([(up - down) / 2e-4 for up, down in sides]).T
    np.testing.assert_allclose(objective.jacobian(start), expected, atol=1e-6)
    expected_gradient = np.linalg.norm(2 * objective.residual(start) @ expected * start / (X.size + 1))
    assert objective.gradients == pytest.approx([expected_gradient])


def test_outlier_moves_a_robust_minimum_less():
    observed = SLOPE * X + OFFSET
    observed[18] += 5.0
    plain, robust = (minimised(observed, loss=loss).values for loss in ("linear", "soft_l1"))
    assert abs(robust[0] - SLOPE) < 0.15 * abs(plain[0] - SLOPE)


def test_bounds_hold_and_the_best_inside_is_found():
    solution = minimised(noisy(), unknowns_of(upper=(1.0, np.inf)))
    assert solution.values[0] == pytest.approx(1.0, abs=1e-3)
    assert solution.values[1] == pytest.approx(np.mean(noisy() - X), abs=2e-3)


def test_samples_that_are_not_used_do_not_count():
    observed = SLOPE * X + OFFSET
    observed[5] = 1e6
    target = target_of(observed)
    used = np.arange(X.size) != 5
    solution = minimise(_Curve(line, X), Target(target.observed, target.sigma, used), unknowns_of(), np.zeros(2))
    assert solution.values == pytest.approx([SLOPE, OFFSET], rel=1e-6)
    assert solution.rms < 1e-5


def test_rough_accuracy_is_said_and_continues_the_gradients():
    solution = minimised(noisy(), accuracy=ROUGH, gradients=(7.0,))
    assert not solution.fine
    assert solution.gradients[0] == 7.0
    assert (FINE.fine, ROUGH.fine) == (True, False)


def test_solution_that_diverges_at_the_start_is_no_solution():
    solution = minimise(_Curve(lambda x, b: x * np.nan, X), target_of(noisy()), unknowns_of(), np.ones(2))
    assert (solution.rms, solution.converged) == (np.inf, False)
    assert "diverges" in solution.message


def test_residual_beyond_all_numbers_is_limited_and_no_solution():
    solution = minimise(_Curve(lambda x, b: 1e150 + 0 * x * b[0], X), target_of(noisy()), unknowns_of(), np.ones(2))
    assert (solution.rms, solution.converged) == (np.inf, False)
    objective = _Objective(
        _Curve(lambda x, b: 1e150 + 0 * x * b[0], X), target_of(noisy()), unknowns_of(), np.ones(2), np.ones(2)
    )
    assert np.all(objective.residual(np.ones(2)) == MAX_RESIDUAL)
