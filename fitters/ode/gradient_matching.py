"""Starting values of parameters from the data alone: the right-hand side against derivatives of the smoothed motion.

Gradient matching (Varah 1982, SIAM J. Sci. Stat. Comput. 3, 28): local cubics give the states and their rates, and the
parameters are those whose right-hand side is nearest to the rates. Nothing is integrated, so it needs no good start,
but every state must be observed or be the velocity of one that is. Parameters in which the right-hand side is linear
are solved for, whatever their size (Golub and Pereyra 1973, SIAM J. Numer. Anal. 10, 413); the others are drawn.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from fitters.integrator.initial_value_problem import InitialValueProblem
from fitters.ode.least_squares import Unknowns
from iris_sysid.errors import FitError
from iris_sysid.types import Array

POINTS = 100  # at which the right-hand side is compared
SHARES = (0.02, 0.06, 0.15)  # half widths of the local cubics, as fractions of the record
MIN_SAMPLES = 4  # samples in half a width
DRAWS, REFINED, EVALUATIONS = 200, 3, 60  # random values, those improved, and evaluations for each of them
DECADES = 3.0
SEED = 0  # the same starts each time
Residual = Callable[[Array], Array]
STRAIGHT = 1e-6  # second difference, relative to the first ones, of what is linear but for rounding
RELATIVE_STEP = 1e-7  # of each value, for derivatives
MAX_RESIDUAL = 1e6  # of a residual, in standard deviations of the rate


@dataclass(frozen=True, eq=False, slots=True)
class _Smoothed:
    """States (m, s), and rates (m, q) of the components ``matched`` (q,) of them, at the times of ``problem``."""

    problem: InitialValueProblem
    states: Array
    rates: Array
    matched: list[int]


def matched_starts(
    problem: InitialValueProblem, t_s: Array, observed: Array, unknowns: Unknowns, values: Array
) -> Iterator[Array]:
    """Full vectors of values (p + s,) by gradient matching, one for each width of smoothing; none where it cannot be.

    Parameters
    ----------
    problem
        The governing equation with its inputs.
    t_s, observed
        (n,) s and (n, d): the samples, each in its own unit.
    unknowns
        The free values and their bounds.
    values
        (p + s,) values held, and those to start from.
    """
    model = problem.model
    names = [quantity.name for quantity in model.observed]
    positions = model.states[: model.degrees_of_freedom]
    if (
        model.hidden
        or model.observe is not None
        or model.events
        or not {state.name for state in positions} <= set(names)
    ):
        return
    columns = [names.index(state.name) for state in positions]
    for share in SHARES:
        smoothed = _smoothed(problem, t_s, observed[:, columns], share)
        try:
            yield _matched(smoothed, unknowns, values, np.random.default_rng(SEED))
        except (FitError, ArithmeticError, ValueError, SystemError):
            return  # the fit itself says what is wrong with the function


def _smoothed(problem: InitialValueProblem, t_s: Array, observed: Array, share: float) -> _Smoothed:
    half = max(share * float(t_s[-1] - t_s[0]), MIN_SAMPLES * float(np.median(np.diff(t_s))))
    centres = np.linspace(t_s[0], t_s[-1], min(POINTS, t_s.size))
    local = np.array([_cubic(t_s, observed, centre, half) for centre in centres])  # (m, 3, d)
    d = observed.shape[1]
    known = np.zeros((centres.size, problem.inputs.shape[1]))
    for k, column in enumerate(problem.inputs.T):
        known[:, k] = np.interp(centres, problem.t_s, column)
    there = replace(problem, t_s=centres, inputs=known, ends=np.arange(centres.size, dtype=np.float64))
    if problem.model.second_order:
        return _Smoothed(there, np.hstack([local[:, 0], local[:, 1]]), local[:, 2], list(range(d, 2 * d)))
    return _Smoothed(there, np.ascontiguousarray(local[:, 0]), local[:, 1], list(range(d)))


def _cubic(t_s: Array, observed: Array, centre: float, half: float) -> Array:
    """Value, first and second derivative (3, d) at a time, of the cubic nearest to the samples about it."""
    first, last = np.searchsorted(t_s, [centre - half, centre + half])
    first, last = max(min(int(first), t_s.size - 2 * MIN_SAMPLES), 0), min(max(int(last), 2 * MIN_SAMPLES), t_s.size)
    u = (t_s[first:last] - centre) / half
    coefficients = np.linalg.lstsq(u[:, None] ** np.arange(4), observed[first:last], rcond=None)[0]
    return np.asarray(coefficients[:3] * np.array([[1.0], [1.0 / half], [2.0 / half**2]]))


def _matched(smoothed: _Smoothed, unknowns: Unknowns, values: Array, rng: np.random.Generator) -> Array:
    """The values whose right-hand side is nearest to the rates; initial states are those of the first point."""
    count = len(smoothed.problem.model.parameters)
    start = values.copy()
    start[count:] = smoothed.states[0]
    which = np.flatnonzero(unknowns.which < count)
    free = unknowns.which[which]
    size = np.std(smoothed.rates, axis=0)
    size = np.where(size > 0, size, 1.0)

    def error(now: Array) -> Array:
        params = start[:count].copy()
        params[free] = now
        with np.errstate(all="ignore"):
            rates = smoothed.problem.slopes(smoothed.states, params)[:, smoothed.matched]
            return np.asarray((smoothed.rates - rates) / size).ravel()

    if free.size:
        start[free] = _best(error, start[free], unknowns.lower[which], unknowns.upper[which], rng)
    return start


def _best(error: Residual, now: Array, lower: Array, upper: Array, rng: np.random.Generator) -> Array:
    """The values (k,) of least residual, from random ones over several decades."""

    def residual(values: Array) -> Array:
        return np.nan_to_num(np.clip(error(values), -MAX_RESIDUAL, MAX_RESIDUAL), nan=MAX_RESIDUAL)

    shape = DRAWS, now.size
    drawn = 10.0 ** rng.uniform(-DECADES, DECADES, shape) * rng.choice([-1.0, 1.0], shape)
    drawn = np.where(rng.random(shape) < 1 / 3, now, drawn)
    width = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    inside = lower + 1e-6 * width, upper - 1e-6 * width
    drawn = np.clip(drawn, *inside)
    with np.errstate(all="ignore"):
        linear = _linear(error, drawn[0])
        drawn = np.array([_projected(error, row, linear, inside) for row in drawn])
    costs = [float(np.sum(np.minimum(np.abs(residual(row)), 10.0))) for row in drawn]
    found = [
        least_squares(
            residual,
            drawn[k],
            bounds=(lower, upper),
            x_scale="jac",
            max_nfev=EVALUATIONS,
            loss="soft_l1",
            diff_step=np.full(now.size, RELATIVE_STEP),
        )
        for k in np.argsort(costs, kind="stable")[:REFINED]
    ]
    return _positive(residual, np.asarray(min(found, key=lambda result: result.cost).x), upper)


def _linear(error: Residual, at: Array) -> list[int]:
    """Which of the values (k,) the error is linear in, together: it has no second difference by any two of them."""
    found: list[int] = []
    for k in range(at.size):
        pairs = [(k, other) for other in (*found, k)]
        if all(_second_difference(error, at, pair) < STRAIGHT for pair in pairs):
            found.append(k)
    return found


def _second_difference(error: Residual, at: Array, pair: tuple[int, int]) -> float:
    """The second difference of the error by two values, relative to the first ones; NaN where it is not finite."""
    one, other = (_step(at, k) for k in pair)
    still, first, second, both = (error(at + step) for step in (0.0, one, other, one + other))
    size = float(np.linalg.norm(first - still) + np.linalg.norm(second - still))
    return float(np.linalg.norm(both - first - second + still)) / size if size > 0 else np.inf


def _step(at: Array, k: int) -> Array:
    """A change of one value (k,) by its own size; by one where it is zero."""
    step = np.zeros(at.size)
    step[k] = abs(at[k]) or 1.0
    return step


def _projected(error: Residual, at: Array, linear: list[int], inside: tuple[Array, Array]) -> Array:
    """The values with the linear ones of least squares, the others held; as they were where that has no solution."""
    zero = at.copy()
    zero[linear] = 0.0
    still = error(zero)
    steps = [_step(at, k) for k in linear]
    columns = np.array([error(zero + step) - still for step in steps]).reshape(len(linear), -1).T
    length = np.linalg.norm(columns, axis=0)
    if not linear or not np.all((length > 0) & np.isfinite(length)) or not np.isfinite(still).all():
        return at
    solved = at.copy()
    solved[linear] = np.sum(steps, axis=0)[linear] * np.linalg.lstsq(columns / length, -still, rcond=1e-10)[0] / length
    return np.asarray(np.clip(solved, *inside))


def _positive(residual: Residual, values: Array, upper: Array) -> Array:
    """The values with as few below zero as leave the residual as it is: a squared frequency has either sign."""
    before = residual(values)
    below = np.flatnonzero((values < 0) & (-values < upper)).tolist()
    for several in (*itertools.combinations(below, 1), *itertools.combinations(below, 2)):
        flipped = values.copy()
        flipped[list(several)] *= -1.0
        if np.all(values[list(several)] < 0) and np.allclose(residual(flipped), before, rtol=1e-9, atol=1e-9):
            values = flipped
    return values
