"""The minimiser that compares models: against SciPy's on a motion of many periods, at bounds, and where it must end."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.optimize import least_squares

from fitters.ode.accelerated_least_squares import accelerated_least_squares
from iris_sysid.types import Array

FREE = np.full(3, np.inf)
T_S = np.linspace(0.0, 60.0, 1500)


class Oscillation:
    """A damped oscillation of many periods as a residual."""

    def __init__(self) -> None:
        self.observed = self.motion(np.array([1.0, 0.02, 3.0])) + 1e-3 * np.random.default_rng(1).normal(size=T_S.size)

    def motion(self, x: Array) -> Array:
        return np.asarray(x[0] * np.exp(-x[1] * T_S) * np.cos(x[2] * T_S))

    def residual(self, x: Array) -> Array:
        return np.asarray((self.motion(x) - self.observed) / 1e-3)

    def jacobian(self, x: Array) -> Array:
        decay, phase = np.exp(-x[1] * T_S), x[2] * T_S
        columns = (np.cos(phase), -x[0] * T_S * np.cos(phase), -x[0] * T_S * np.sin(phase))
        return np.asarray(decay[:, None] * np.stack(columns, axis=1) / 1e-3)


def bent(x: Array) -> Array:
    """A residual that falls along a curved valley to (1, 1)."""
    return np.array([1e3 * (x[1] - x[0] ** 2), 1.0 - x[0]])


def bent_slopes(x: Array) -> Array:
    return np.array([[-2e3 * x[0], 1e3], [-1.0, 0.0]])


def test_an_oscillation_ends_where_scipy_ends() -> None:
    ours, theirs = Oscillation(), Oscillation()
    start = np.array([0.8, 0.05, 3.02])
    end = accelerated_least_squares(ours.residual, ours.jacobian, start, (-FREE, FREE), 1e-10, 200)
    found = least_squares(theirs.residual, start, theirs.jacobian, x_scale="jac", ftol=1e-12, xtol=1e-12)
    assert end.converged
    np.testing.assert_allclose(end.x, found.x, rtol=1e-6)
    np.testing.assert_allclose(end.residual, ours.residual(end.x))


def test_a_curved_valley_takes_fewer_residuals_than_straight_steps() -> None:
    count = [0, 0]

    def counted(which: int, x: Array) -> Array:
        count[which] += 1
        return bent(x)

    start, free = np.array([-5.0, 25.0]), np.full(2, np.inf)
    end = accelerated_least_squares(partial(counted, 0), bent_slopes, start, (-free, free), 1e-10, 1000)
    least_squares(partial(counted, 1), start, bent_slopes, x_scale="jac", ftol=1e-10, max_nfev=1000)
    np.testing.assert_allclose(end.x, 1.0, atol=1e-4)
    assert count[0] < 0.7 * count[1]


def test_a_value_ends_at_its_bound_and_the_others_at_their_minimum_there() -> None:
    slopes = np.array([[1.0, 0.5], [0.0, 1.0]])
    target, bounds = np.array([3.0, 2.0]), (np.full(2, -np.inf), np.array([1.0, np.inf]))

    def residual(x: Array) -> Array:
        return np.asarray(slopes @ x - target)

    def jacobian(_x: Array) -> Array:
        return slopes

    end = accelerated_least_squares(residual, jacobian, np.zeros(2), bounds, 1e-12, 100)
    held = np.linalg.lstsq(slopes[:, 1:], target - slopes[:, 0], rcond=None)[0]
    assert end.converged
    np.testing.assert_allclose(end.x, [1.0, held[0]], rtol=1e-5)


@pytest.mark.parametrize("far", [np.nan, 1e100])
def test_where_the_prediction_diverges_it_goes_back(far: float) -> None:
    def residual(x: Array) -> Array:
        return np.where(x > 2.0, far, x**3 - 1.0)

    with np.errstate(all="ignore"):
        end = accelerated_least_squares(
            residual,
            lambda x: np.diag(3.0 * x**2),
            np.array([0.3]),
            (-np.full(1, np.inf), np.full(1, np.inf)),
            1e-9,
            100,
        )
    np.testing.assert_allclose(end.x, 1.0, rtol=1e-4)


def test_it_ends_with_the_evaluations_and_says_so() -> None:
    start, free = np.array([-5.0, 25.0]), np.full(2, np.inf)
    end = accelerated_least_squares(bent, bent_slopes, start, (-free, free), 1e-10, 5)
    assert not end.converged
    assert "evaluations" in end.message
    assert float(np.sum(end.residual**2)) < float(np.sum(bent(start) ** 2))


def test_a_minimum_at_the_start_stays() -> None:
    end = accelerated_least_squares(bent, bent_slopes, np.ones(2), (-np.ones(2), np.full(2, 9.0)), 1e-10, 100)
    assert end.converged
    np.testing.assert_array_equal(end.x, 1.0)
