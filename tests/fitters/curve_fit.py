"""Fit a formula y = f(x, b) through the same least squares as the equations of motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fitters.noise.sandwich_covariance import inverse_normal
from fitters.ode.least_squares import ROUGH, Solution, Target, Unknowns, minimise
from iris_sysid.errors import FitError
from iris_sysid.types import Array

if TYPE_CHECKING:
    from fitters.integrator.initial_value_problem import InitialValueProblem

Extended: TypeAlias = NDArray[np.longdouble]
Formula = Callable[[Any, Any], Any]  # (x (n,) or (n, m), b (k,)) -> y (n,); complex b give complex y

COMPLEX_STEP = 1e-30  # of a parameter: no difference is taken, so it may be as small as one likes
MAX_POLISHED = 12  # minima
NEAR_RMS, SAME_RMS = 1.5, 1e-9  # ratio of two rms that may belong to one minimum; relative difference of two that do
ROUNDING = 1e-12  # in units of the data
FLIPPED = 100.0  # a parameter of the other sign is as far as one e^10 times as large
POLISH = 30  # repetitions from the minimum found, each at least one more step of Gauss and Newton
REFINEMENTS = 5  # steps of Gauss and Newton with the residual in extended precision
SCATTER = (0.5, 2.5)  # natural logarithm of the factors by which random starts are off, near ones and far ones by turns


@dataclass(frozen=True, eq=False, slots=True)
class _Curve:
    """A formula at given positions, with the interface that the solver needs, without any equation of motion.

    Derivatives by a complex step, exact to rounding (Squire and Trapp 1998, SIAM Rev. 40, 110).
    """

    formula: Formula
    x: Array | Extended

    def planned(self, values: Array, tolerance: float, negligible: float = 0.0) -> _Curve:
        """The same: a formula has no time steps."""
        del values, tolerance, negligible
        return self

    def predicted(self, values: Array) -> Array:
        """Values of the formula (n, 1); NaN where it has none."""
        with np.errstate(all="ignore"):
            return np.asarray(self.formula(self.x, values), dtype=np.float64)[:, None]

    def rough_sensitivity(self, values: Array, which: NDArray[np.intp], steps: Array, predicted: Array) -> Array:
        """Derivatives of the formula (n, 1, k)."""
        del steps, predicted
        columns = []
        with np.errstate(all="ignore"):
            for k in which:
                moved = values.astype(np.complex128)
                step = COMPLEX_STEP * max(abs(values[k]), 1e-30)
                moved[k] += 1j * step
                columns.append(np.asarray(self.formula(self.x, moved)).imag / step)
        return np.stack(columns, axis=-1)[:, None, :]


class CurveFit(NamedTuple):
    """Parameters (k,) with standard errors (k,), and the standard deviation of the residual."""

    values: Array
    stderr: Array
    residual_sd: float


def fit_curve(formula: Formula, x: ArrayLike, y: ArrayLike, start: Sequence[float], multistart: int = 40) -> CurveFit:
    """Least squares for a formula, from a start and from random starts about it.

    Parameters
    ----------
    formula
        ``formula(x, b) -> y (n,)``, analytic in b: NumPy functions that take complex numbers.
    x
        (n,) or (n, m).
    y
        (n,) what was measured, with white noise of unknown size.
    start
        (k,).
    multistart
        Number of random starts.

    Raises
    ------
    FitError
        When there are not more values than parameters, or no start has finite values.
    """
    extended = _Curve(formula, np.asarray(x, dtype=np.longdouble))
    places, measured = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    first = np.asarray(start, dtype=np.float64)
    n, k = measured.size, first.size
    if n <= k:
        raise FitError(f"{n} values cannot determine {k} parameters: measure more, or use a simpler formula")
    target = Target(measured[:, None], np.full((n, 1), float(np.std(measured)) or 1.0), np.ones(n, dtype=np.bool_))
    free = tuple(f"b{i + 1}" for i in range(k))
    unknowns = Unknowns(np.arange(k), free, np.full(k, -np.inf), np.full(k, np.inf), np.zeros(k), np.zeros(k))
    # the solver asks a problem for nothing but what a curve has
    problem = cast("InitialValueProblem", _Curve(formula, places))
    best = _best(problem, target, unknowns, _starts(first, multistart))
    if best is None:
        raise FitError(f"the formula has no finite values at the start {list(first)}: give another")
    return _with_errors(problem, unknowns, extended, np.asarray(y, dtype=np.longdouble), best.values)


def _starts(first: Array, count: int) -> list[Array]:
    rng = np.random.default_rng(0)
    return [first, *(first * np.exp(SCATTER[i % 2] * rng.standard_normal(first.size)) for i in range(count))]


def _best(problem: InitialValueProblem, target: Target, unknowns: Unknowns, starts: Sequence[Array]) -> Solution | None:
    """The lowest minimum of all starts, followed to its bottom."""
    solutions = [minimise(problem, target, unknowns, start, accuracy=ROUGH) for start in starts]
    solutions = sorted(
        (solution for solution in solutions if np.isfinite(solution.rms)), key=lambda solution: solution.rms
    )
    deepest: list[Solution] = []
    for refined in solutions[:MAX_POLISHED]:
        for _ in range(POLISH if refined.rms <= NEAR_RMS * solutions[0].rms or len(deepest) < 3 else 0):
            refined = minimise(problem, target, unknowns, refined.values)
        deepest.append(refined)
    if not deepest:
        return None
    least = min(solution.rms for solution in deepest)
    return min(
        (solution for solution in deepest if solution.rms <= least * (1 + SAME_RMS) + ROUNDING),
        key=lambda solution: _far(solution, starts[0]),
    )


def _far(solution: Solution, first: Array) -> float:
    """How far a minimum lies from the first start: of equal ones, e.g. with two terms swapped, the nearest counts."""
    with np.errstate(all="ignore"):
        ratio = np.where(first != 0, solution.values / first, 1.0)
        return float(np.sum(np.log(np.abs(ratio)) ** 2 + np.where(ratio < 0, FLIPPED, 0.0)))


def _with_errors(
    problem: InitialValueProblem, unknowns: Unknowns, curve: _Curve, y: Extended, values: Array
) -> CurveFit:
    """Standard errors; the residual, which may be as small as rounding, in extended precision where there is any."""
    jacobian = problem.rough_sensitivity(values, unknowns.which, np.ones(values.size), np.zeros(0))[:, 0]
    exact = values.astype(np.longdouble)
    for _ in range(REFINEMENTS):
        residual = y - curve.formula(curve.x, exact)
        exact = exact + np.linalg.lstsq(jacobian, residual.astype(np.float64), rcond=None)[0]
    variance = float(residual @ residual) / (residual.size - values.size)
    stderr = np.sqrt(variance * np.diag(inverse_normal(jacobian)))
    return CurveFit(exact.astype(np.float64), stderr, float(np.sqrt(variance)))
