"""A rough fit ends in a valley that is nearly level; a fine one goes on to its bottom."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from fitters.ode.least_squares import FINE, ROUGH, Accuracy, Solution, Target, Unknowns, minimise
from iris_sysid.types import Array

if TYPE_CHECKING:
    from fitters.integrator.initial_value_problem import InitialValueProblem

LEVEL, STEEP, SLOPE = 1.0, 10.0, 0.04  # what no value explains, the walls of the valley, and its fall
START, BOTTOM = (-1.0, 1.0), (1.0, 1.0)


class Valley:
    """Rosenbrock's curved valley above a level, with the interface that the solver needs."""

    def planned(self, values: Array, tolerance: float, negligible: float = 0.0) -> Valley:
        return self

    def predicted(self, values: Array) -> Array:
        return np.array([[LEVEL], [STEEP * (values[1] - values[0] ** 2)], [SLOPE * (1.0 - values[0])]])

    def rough_sensitivity(self, values: Array, which: NDArray[np.intp], steps: Array, predicted: Array) -> Array:
        return np.array([[[0.0, 0.0]], [[-2.0 * STEEP * values[0], STEEP]], [[-SLOPE, 0.0]]])


def ended(accuracy: Accuracy) -> Solution:
    """Where a fit from the far end of the valley ends."""
    target = Target(np.zeros((3, 1)), np.ones((3, 1)), np.ones(3, dtype=np.bool_))
    none = np.zeros(2)
    unknowns = Unknowns(np.arange(2), ("a", "b"), np.full(2, -np.inf), np.full(2, np.inf), none, none)
    return minimise(cast("InitialValueProblem", Valley()), target, unknowns, np.array(START), accuracy=accuracy)


def test_rough_fit_ends_where_the_sum_of_squares_falls_too_little():
    rough, fine = ended(ROUGH._replace(impatient=True)), ended(FINE)
    assert rough.converged
    assert len(rough.gradients) < 0.5 * len(fine.gradients)
    assert rough.rms**2 < 1.01 * fine.rms**2


def test_fine_fit_goes_on_to_the_bottom_of_the_valley():
    np.testing.assert_allclose(ended(FINE).values, BOTTOM, atol=1e-3)
