"""Least squares on the trajectory: the residual, its Jacobian, and the minimisers with bounds.

Fits are by SciPy's trust region. Those that only compare models follow curved valleys, where models lack an effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from fitters.integrator.initial_value_problem import InitialValueProblem, adapted_steps, first_steps
from fitters.ode.accelerated_least_squares import LeastSquaresEnd, accelerated_least_squares
from iris_sysid.types import Array, Mask

Loss = Literal["linear", "soft_l1"]

NEGLIGIBLE = (
    1e-2,
    1e-4,
)  # error from the time step at a kink, as fractions of the noise and of the motion
MAX_RESIDUAL = 1e100  # in units of sigma: squares and their sums stay finite
SOFT_AT = 2.0  # standard deviations above which soft_l1 grows linearly


class Accuracy(NamedTuple):
    """When a minimisation ends.

    ``tolerance``: relative change of the sum of squares in a step; ``time_step``: relative error from the finite time
    step; ``evaluations``: their largest number.
    """

    tolerance: float
    time_step: float
    evaluations: int

    @property
    def fine(self) -> bool:
        """Whether it is that of a final fit."""
        return self.tolerance <= FINE.tolerance

    @property
    def compares(self) -> bool:
        """Whether it is that of a fit to compare models."""
        return self.tolerance >= COMPARING.tolerance


FINE = Accuracy(1e-8, 1e-8, 200)
ROUGH = Accuracy(1e-7, 1e-8, 40)  # of the horizons before a final fit
COMPARING = Accuracy(1e-4, 1e-6, 120)  # to compare models: the blocks of a record differ by more


@dataclass(frozen=True, eq=False, slots=True)
class Target:
    """The data to fit: ``observed`` and ``sigma`` (n, d) at the samples of a problem, ``used`` (n,)."""

    observed: Array
    sigma: Array
    used: Mask

    def first(self, n: int) -> Target:
        """The target up to its n-th sample."""
        return Target(self.observed[:n], self.sigma[:n], self.used[:n])

    def every(self, k: int) -> Target:
        """The target at every k-th sample."""
        return Target(self.observed[::k], self.sigma[::k], self.used[::k])

    def weighted(self, values: Array) -> Array:
        """Values (n, d, ...) at the used samples in units of sigma, flattened time-major (n_used * d, ...)."""
        sigma = self.sigma[self.used].reshape(*self.sigma[self.used].shape, *(1,) * (values.ndim - 2))
        return np.asarray((values[self.used] / sigma).reshape(-1, *values.shape[2:]))

    @property
    def size(self) -> Array:
        """Standard deviation (d,) of the observed motion. It has the observed unit."""
        return np.asarray(np.std(self.observed[self.used], axis=0))

    @property
    def negligible(self) -> float:
        """Negligible error of a prediction, relative to the largest observed value."""
        seen = np.max(np.abs(self.observed[self.used]), axis=0)
        noise = np.median(self.sigma[self.used], axis=0)
        return float(min(NEGLIGIBLE[0] * np.min(noise / np.where(seen > 0, seen, 1.0)), NEGLIGIBLE[1]))


@dataclass(frozen=True, eq=False, slots=True)
class Unknowns:
    """The free values: their indices ``which`` (k,), names and bounds (k,).

    Those measured elsewhere have a normal prior of mean ``expected`` (k,) and standard error 1 / ``precision`` (k,);
    a precision of zero means no prior.
    """

    which: NDArray[np.intp]
    names: tuple[str, ...]
    lower: Array
    upper: Array
    expected: Array
    precision: Array

    @property
    def measured(self) -> NDArray[np.intp]:
        """Which of the free values have a prior. They are indices (j,)."""
        return np.flatnonzero(self.precision)

    @property
    def prior_rows(self) -> Array:
        """Rows (j, k) that the priors add to the sensitivities, in one per unit of the value."""
        return np.asarray(np.diag(self.precision)[self.measured])

    def prior_residual(self, values: Array) -> Array:
        """Residuals (j,) of the priors: expected - value in standard errors.

        It is dimensionless; ``values`` (p + s,), each in its own unit.
        """
        part = self.measured
        return np.asarray((self.expected[part] - values[self.which[part]]) * self.precision[part])

    def weighing_priors(self, factor: float) -> Unknowns:
        """The unknowns with the weight of every prior multiplied by a factor."""
        return replace(self, precision=self.precision * factor)

    def without(self, index: int) -> Unknowns:
        """The unknowns with one of the free values held."""
        return self.only([name for k, name in enumerate(self.names) if k != index])

    def only(self, wanted: Sequence[str]) -> Unknowns:
        """The unknowns with those alone that are named."""
        kept = np.array([name in wanted for name in self.names], dtype=np.bool_)
        names = tuple(name for name, keep in zip(self.names, kept, strict=True) if keep)
        arrays = (self.lower, self.upper, self.expected, self.precision)
        return Unknowns(self.which[kept], names, *(array[kept] for array in arrays))

    def inside(self, values: Array) -> Array:
        """The values with the free ones moved inside their bounds. ``values`` (p + s,), each in its own unit."""
        moved = values.copy()
        width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, 1.0)
        moved[self.which] = np.clip(values[self.which], self.lower + 1e-6 * width, self.upper - 1e-6 * width)
        return moved


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
    """The result of least squares.

    ``values`` (p + s,); ``predicted`` (n, d) by the ``problem`` with its time steps; ``steps`` (k,) for differences;
    ``rms`` of the residual in units of sigma, infinite where the solution diverges; ``fine`` when the optimiser was
    not stopped early. ``gradients``: norm of the gradient of the mean squared residual, in units of sigma, by the
    free values relative to their size, at each iteration so far.
    """

    problem: InitialValueProblem
    values: Array
    predicted: Array
    steps: Array
    rms: float
    converged: bool
    fine: bool
    message: str
    gradients: tuple[float, ...] = ()


@dataclass(eq=False, slots=True)
class _Objective:
    """Residual and Jacobian as functions of the free values (k,); the last prediction and difference steps are kept."""

    problem: InitialValueProblem
    target: Target
    unknowns: Unknowns
    start: Array
    steps: Array
    gradients: list[float] = field(default_factory=list)
    _last: tuple[Array, Array] | None = field(default=None)

    def values_of(self, free: Array) -> Array:
        values = self.start.copy()
        values[self.unknowns.which] = free
        return values

    def predicted(self, values: Array) -> Array:
        if self._last is None or not np.array_equal(self._last[0], values, equal_nan=True):
            self._last = (values, self.problem.predicted(values))
        return self._last[1]

    def residual(self, free: Array) -> Array:
        values = self.values_of(free)
        residual = -self.target.weighted(self.target.observed - self.predicted(values))
        both = np.concatenate([residual, -self.unknowns.prior_residual(values)])
        return np.clip(both, -MAX_RESIDUAL, MAX_RESIDUAL)

    def jacobian(self, free: Array) -> Array:
        residual = self.residual(free)
        values = self.values_of(free)
        slopes = self.problem.rough_sensitivity(values, self.unknowns.which, self.steps, self.predicted(values))
        self.steps = adapted_steps(self.steps, slopes, self.target.size)
        rows = np.concatenate([np.nan_to_num(self.target.weighted(slopes)), self.unknowns.prior_rows])
        jacobian = np.clip(rows, -MAX_RESIDUAL, MAX_RESIDUAL)
        self.gradients.append(self._gradient(jacobian, residual, values))
        return jacobian

    def _gradient(self, jacobian: Array, residual: Array, values: Array) -> float:
        """Norm of the gradient of the mean square by the relative free values: 1 is one standard deviation."""
        size = np.maximum(np.abs(values[self.unknowns.which]), 1e-3)
        return float(np.linalg.norm(2.0 * (residual @ jacobian) * size / residual.size))


def minimise(
    problem: InitialValueProblem,
    target: Target,
    unknowns: Unknowns,
    values: Array,
    *,
    accuracy: Accuracy = FINE,
    loss: Loss = "linear",
    steps: Array | None = None,
    gradients: tuple[float, ...] = (),
) -> Solution:
    """Least squares from one start over all samples of the problem.

    Parameters
    ----------
    problem
        The model at the samples; its time steps are chosen here, for the start.
    target
        The data to fit.
    unknowns
        The free values and their bounds.
    values
        (p + s,) start, and the values held.
    accuracy
        When to end.
    loss
        As in ``scipy.optimize.least_squares``.
    steps
        (k,) difference steps of an earlier solution.
    gradients
        Of the iterations so far.
    """
    start = unknowns.inside(values)
    problem = problem.planned(start, accuracy.time_step, target.negligible)
    steps = first_steps(start, unknowns.which) if steps is None else steps
    objective = _Objective(problem, target, unknowns, start, steps)
    predicted = objective.predicted(start)
    if not np.all(np.isfinite(predicted)):
        why = "the solution diverges at the start"
        return Solution(problem, start, predicted, objective.steps, np.inf, False, True, why, gradients)
    end = _minimised(objective, loss, accuracy)
    best = objective.values_of(end.x)
    seen = end.residual[: int(target.used.sum()) * target.observed.shape[1]]
    with np.errstate(all="ignore"):
        rms = float(np.sqrt(np.mean(seen**2)))
    finite = bool(np.isfinite(rms)) and bool(np.max(np.abs(seen), initial=0.0) < MAX_RESIDUAL)
    return Solution(
        problem=problem,
        values=best,
        predicted=objective.predicted(best),
        steps=objective.steps,
        rms=rms if finite else np.inf,
        converged=end.converged and finite,
        fine=accuracy.fine,
        message=end.message,
        gradients=(*gradients, *objective.gradients),
    )


def _minimised(objective: _Objective, loss: Loss, accuracy: Accuracy) -> LeastSquaresEnd:
    """Where the minimisation ends; at the start where derivatives are far beyond SciPy's numbers."""
    bounds = objective.unknowns.lower, objective.unknowns.upper
    start = objective.start[objective.unknowns.which]
    with np.errstate(all="ignore"):
        if loss == "linear" and accuracy.compares:
            return accelerated_least_squares(
                objective.residual, objective.jacobian, start, bounds, accuracy.tolerance, accuracy.evaluations
            )
        try:
            found = least_squares(
                objective.residual,
                start,
                jac=objective.jacobian,
                bounds=bounds,
                x_scale="jac",
                loss=loss,
                f_scale=SOFT_AT,
                ftol=accuracy.tolerance,
                xtol=FINE.tolerance,  # data may know a value to any part of it
                gtol=1e-15,
                max_nfev=accuracy.evaluations,
            )
        except ValueError as error:
            return LeastSquaresEnd(start, objective.residual(start), False, str(error))
        return LeastSquaresEnd(found.x, found.fun, bool(found.success), str(found.message))


def reweighted(target: Target, solution: Solution) -> Target:
    """The target with the final weights of a robust loss: a larger sigma where the residual is large."""
    residual = target.observed - solution.predicted
    softness = np.sqrt(1.0 + (residual / target.sigma / SOFT_AT) ** 2)
    return replace(target, sigma=np.where(np.isfinite(softness), target.sigma * np.sqrt(softness), target.sigma))
