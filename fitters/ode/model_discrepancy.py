"""Errors of a fit whose equation is incomplete: the discrepancy between model and reality as an unknown of the fit.

Where the residual is more than noise, what the equation lacks has also moved the fitted values, by an amount that the
residual does not show. So the missing part is expanded in forms: forces and errors of the reading that are functions
of position, velocity and time (Kennedy and O'Hagan 2001, J. R. Stat. Soc. B 63, 425; on the need for a prior of
physical form: Brynjarsdottir and O'Hagan 2014, Inverse Problems 30, 114007). As a rule a few things are missing and
not a little of everything: the values' errors are averaged over sets of a few forms, which count the more, the more of
the residual they explain (Bayesian model averaging: Hoeting et al. 1999, Stat. Sci. 14, 382).

Whether the residual is more than noise is asked of all forms together: their coefficients have a normal prior of the
common size of largest marginal likelihood, in noise whose autocorrelation is estimated beside the forms; noise alone
with another autocorrelation is the rival hypothesis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import cast

import numpy as np
from scipy.integrate import cumulative_simpson
from scipy.optimize import minimize, minimize_scalar

from fitters.integrator.initial_value_problem import InitialValueProblem
from fitters.noise.autoregression import (
    EDGE,
    Autoregression,
    Vector,
    burg,
    choose_order,
    grid_positions,
    minus_restricted,
    on_grid,
    whiten,
)
from fitters.noise.known_correlation import with_measured_correlation
from fitters.noise.sandwich_covariance import middle, orthonormal_basis, quantile_975
from fitters.ode.least_squares import Solution, Target
from iris_sysid.types import Array, ErrorAutocorrelation

SOURCE = "model discrepancy"
DECISIVE = 10.0  # twice the log likelihood ratio above which the residual is more than noise: a chance of 1e-3
MISFIT = 1.5  # residual over noise above which a significant discrepancy is called a misfit
MAX_SAMPLES = 600  # a discrepancy is smooth: every k-th sample tells it
SAMPLES_A_FORM = 4  # at least, of the forms that the noise is estimated beside, the simplest first
WAVES = 10  # cosines over the clip, the fastest with five periods
SAMPLES_A_WAVE = 30  # at least
MAX_ORDER = 2  # of the autoregression of the noise beside the forms
STEP = 1e-5  # relative, of an initial state
STEADY = 1e-6  # of the largest state: a state that changes by less has a step of its own
WORST_CONDITION = 1e8  # of the transition matrix, which loses digits as initial conditions decay
IMITATED = 0.01  # a form that the values imitate but for this fraction redefines them: no discrepancy
SOFT = 0.05  # of the largest speed, within which dry friction turns over
SIZES = (1e-6, 10.0)  # of the discrepancy, relative to the forces and the range of the motion
# Samples that a misfit counts for when sets of forms are weighed against each other: with fewer every set counts, with
# more only the best. 10 covers on the looked-at cases of `python -m validation.misfit`.
INDEPENDENT = 10.0
MAX_TIMES = 3.0  # the coefficient of the form that explains most: what is missing is rarely larger
MAX_FORMS = 3  # of a set: on halves of real recordings two to four give the same errors, and one is too few
MIN_SIZE = 1e-150  # whose square can be divided by


@dataclass(frozen=True, eq=False, slots=True)
class Discrepancy:
    """What the equation lacks, as far as it moves the fitted values.

    ``shifts`` (k, k): independent patterns of the values' systematic error. ``random`` (k, k): covariance from the
    noise that remains beside the discrepancy. ``log_ratio``: twice the log likelihood ratio of a discrepancy in noise
    of its own autocorrelation, and of such noise alone; ``over_noise``: the largest ratio, over the quantities, of
    residual and noise.
    """

    shifts: Array
    random: Array
    log_ratio: float
    over_noise: float

    @property
    def significant(self) -> bool:
        """Whether the residual is more than autocorrelated noise."""
        return self.log_ratio > DECISIVE

    @property
    def misfit(self) -> bool:
        """Whether the residual is well above the noise, too."""
        return self.significant and self.over_noise > MISFIT


def discrepancy_of(
    target: Target,
    solution: Solution,
    sensitivity: Array,
    bread: Array,
    measured: ErrorAutocorrelation | None = None,
) -> Discrepancy | None:
    """The discrepancy between a fitted model and its data; None where the data are too few or too odd to tell.

    Parameters
    ----------
    target, solution
        The samples fitted, with their weights, and the solution.
    sensitivity
        (n, d, k) of the prediction at all samples to k values, in the observed unit per unit of each value.
    bread
        (k, k) inverse of their information, priors included.
    measured
        Autocorrelation of the noise where the tracker measured it.
    """
    try:
        with np.errstate(all="ignore"):
            found = _expanded(target, solution, sensitivity, bread, measured)
    except np.linalg.LinAlgError:
        return None
    finite = found is not None and np.all(np.isfinite(found.shifts)) and np.all(np.isfinite(found.random))
    return found if finite else None


def _expanded(
    target: Target, solution: Solution, sensitivity: Array, bread: Array, measured: ErrorAutocorrelation | None
) -> Discrepancy | None:
    """The discrepancy from its forms at every k-th sample; see :func:`discrepancy_of`."""
    every = max(1, -(-target.observed.shape[0] // MAX_SAMPLES))
    part = target.every(every)
    residual = part.weighted(part.observed - solution.predicted[::every])
    jacobian, most = part.weighted(sensitivity[::every]), residual.size // SAMPLES_A_FORM
    forms = np.array([part.weighted(form) for form in _forms(solution, every, int(part.used.sum()))]).T
    if forms.size == 0:
        return None
    forms = forms[:, np.isfinite(forms).all(axis=0) & np.any(forms, axis=0)]
    bread = bread * every
    moves = bread @ (jacobian.T @ forms)
    unseen = forms - jacobian @ moves
    kept = np.linalg.norm(unseen, axis=0) > IMITATED * np.linalg.norm(forms, axis=0)
    if not kept.any() or most == 0:
        return None
    unseen, moves = unseen[:, kept], moves[:, kept]
    t_s, columns = solution.problem.t_s[::every], np.hstack([jacobian, unseen[:, :most]])
    beside, alone = (_Noise.of(part, t_s, residual, basis, measured) for basis in (columns, jacobian))
    own = orthonormal_basis(beside.whitened(jacobian))
    white = beside.whitened(np.column_stack([residual, unseen]))
    white = white - own @ (own.T @ white)
    shifts = _shifts(white[:, 0], white[:, 1:], moves)
    gain = alone.minus_two_log(residual, jacobian) - beside.minus_two_log(residual, jacobian)
    log_ratio = gain + _log_ratio(white[:, 0], white[:, 1 : 1 + most])
    return Discrepancy(shifts, beside.covariance(jacobian, bread), log_ratio, beside.over(residual))


@dataclass(frozen=True, eq=False, slots=True)
class _Noise:
    """The noise that remains beside the forms: one autoregression ``process`` a quantity, at samples ``t_s`` (n,)."""

    t_s: Array
    process: tuple[Autoregression, ...]

    @classmethod
    def of(
        cls, part: Target, t_s: Array, residual: Array, columns: Array, measured: ErrorAutocorrelation | None
    ) -> _Noise:
        """The noise of a residual (m,) without what columns (m, c) can imitate."""
        used_s, count = t_s[part.used], part.observed.shape[1]
        positions, processes = grid_positions(used_s), []
        for k in range(count):
            basis = orthonormal_basis(columns[k::count])
            rest = residual[k::count] - basis @ (basis.T @ residual[k::count])
            errors, spread = on_grid(positions, rest, np.nan), on_grid(positions, basis, 0.0)
            alone = _low_order(errors, spread)
            processes.append(with_measured_correlation(errors, spread, measured, alone))
        return cls(used_s, tuple(processes))

    def whitened(self, columns: Array) -> Array:
        """Columns (m, c) as seen in white noise of size 1."""
        positions, count = grid_positions(self.t_s), len(self.process)
        parts = [
            whiten(on_grid(positions, columns[k::count], np.nan), process.partial)[0] / process.innovation_sd
            for k, process in enumerate(self.process)
        ]
        return np.concatenate(parts)

    def minus_two_log(self, residual: Array, jacobian: Array) -> float:
        """Minus twice the log restricted likelihood of a residual (m,) in this noise alone, beside the values."""
        positions, count, total = grid_positions(self.t_s), len(self.process), 0.0
        columns = np.column_stack([residual, jacobian])
        for k, process in enumerate(self.process):
            white, variances = whiten(on_grid(positions, columns[k::count], np.nan), process.partial)
            total += float(np.sum(np.log(variances)) + len(white) * np.log(process.innovation_sd**2))
        white = self.whitened(columns)
        directions, triangle = np.linalg.qr(white[:, 1:])
        inside = directions.T @ white[:, 0]
        logs = np.log(np.abs(np.diag(triangle)) + 1e-300)
        return total + float(2.0 * np.sum(logs) + white[:, 0] @ white[:, 0] - inside @ inside)

    def covariance(self, jacobian: Array, bread: Array) -> Array:
        """Covariance (k, k) of the values from this noise."""
        positions, count = grid_positions(self.t_s), len(self.process)
        parts = [
            middle(on_grid(positions, jacobian[k::count], 0.0), process.coefficients) * process.innovation_sd**2
            for k, process in enumerate(self.process)
        ]
        return np.asarray(bread @ sum(parts) @ bread)

    def over(self, residual: Array) -> float:
        """Largest ratio of residual (m,) and noise over the quantities."""
        count = len(self.process)
        sizes = [float(np.sqrt(np.mean(residual[k::count] ** 2))) for k in range(count)]
        return max(size / max(process.sd, 1e-300) for size, process in zip(sizes, self.process, strict=True))


def _low_order(residual: Array, basis: Array) -> Autoregression:
    """Autoregression of a residual (n,), NaN in gaps, whose slow part mostly lies in a basis (n, r).

    Of restricted maximum likelihood, which counts what the basis took.
    """
    partial, variance = burg(residual, MAX_ORDER)
    order = choose_order(variance, int(np.isfinite(residual).sum()))
    if order == 0:
        return Autoregression.of(residual, basis, partial[:0])

    def objective(unbounded: Vector) -> float:
        return minus_restricted(residual, basis, EDGE * np.tanh(unbounded))[0]

    start = cast("Vector", np.arctanh(0.99 * partial[:order]))
    found = minimize(objective, start, method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.05})
    return Autoregression.of(residual, basis, np.asarray(EDGE * np.tanh(found.x)))


def _shifts(residual: Array, forms: Array, moves: Array) -> Array:
    """Patterns (k, k) of the values' errors: what sets of the forms (m, c) that may be missing move them (k, c)."""
    moment = np.zeros((len(moves), len(moves)))
    for weight, missing in _weighed(residual, forms):
        moved = moves[:, missing.forms]
        moment += weight * _product(np.column_stack([moved @ missing.sizes, moved @ missing.root]))
    values, vectors = np.linalg.eigh(moment)
    few = quantile_975(INDEPENDENT) / quantile_975(np.inf)  # the size is known from few samples
    return np.asarray((few * vectors * np.sqrt(np.maximum(values, 0.0))).T)


@dataclass(frozen=True, eq=False, slots=True)
class _Missing:
    """Forms that may be missing together.

    Their numbers, the posterior mean ``sizes`` (m,) of their coefficients and a ``root`` (m, m) of its covariance, and
    the sum of squares that they explain.
    """

    forms: list[int]
    sizes: Array
    root: Array
    explained: float


def _weighed(residual: Array, forms: Array) -> list[tuple[float, _Missing]]:
    """Sets of the forms (m, c) that may be missing, and their weights by the part of a residual (m,) that remains."""
    sets = _sets(forms.T @ residual, forms.T @ forms, MAX_TIMES * _of_the_best(residual, forms))
    left = 1.0 - np.array([each.explained for each in sets]) / max(float(residual @ residual), 1e-300)
    count = np.array([len(each.forms) for each in sets])
    minus_half_bic = -0.5 * (INDEPENDENT * np.log(np.maximum(left, 1e-12)) + count * np.log(INDEPENDENT))
    weights = np.exp(minus_half_bic - minus_half_bic.max())
    return list(zip((weights / weights.sum()).tolist(), sets, strict=True))


def _sets(products: Array, overlap: Array, size: float) -> list[_Missing]:
    """Each form alone, then with a second and a third that explain most of the remaining residual; no set twice.

    Parameters
    ----------
    products, overlap
        (c,) of the forms with the residual, and (c, c) of the forms with one another.
    size
        Standard deviation of the normal prior of a coefficient.
    """
    found: dict[frozenset[int], _Missing] = {}
    alone, precision = np.diag(overlap), max(size, MIN_SIZE) ** -2.0
    for first in range(products.size):
        forms = [first]
        while len(forms) <= MAX_FORMS:
            key = frozenset(forms)
            if key not in found:
                found[key] = _together(forms, products[forms], overlap[np.ix_(forms, forms)], precision)
            known = found[key]
            left = products - overlap[:, known.forms] @ known.sizes
            gain = left**2 / (alone + precision)
            gain[forms] = -1.0
            forms = [*forms, int(np.argmax(gain))]
    return list(found.values())


def _together(forms: list[int], products: Array, overlap: Array, precision: float) -> _Missing:
    """The coefficients of some forms at once."""
    values, vectors = np.linalg.eigh(overlap + precision * np.eye(len(forms)))
    root = vectors / np.sqrt(values)
    sizes = root @ (root.T @ products)
    return _Missing(forms, sizes, root, float(2.0 * sizes @ products - sizes @ overlap @ sizes))


def _of_the_best(residual: Array, forms: Array) -> float:
    """The coefficient of the form (m, c) that explains most of a residual (m,): what is missing is rarely larger."""
    squares = np.sum(forms**2, axis=0)
    products = np.abs(residual @ forms)
    best = int(np.argmax(products**2 / np.maximum(squares, 1e-300)))
    return float(products[best] / max(squares[best], 1e-300))


def _log_ratio(residual: Array, forms: Array) -> float:
    """Twice the log ratio of the marginal likelihood of a residual (m,) with all forms (m, c) and with none.

    Their coefficients have one common size, that of largest likelihood.
    """
    left, singular, _ = np.linalg.svd(forms, full_matrices=False)
    along = left.T @ residual

    def minus_two_log(log_size: float) -> float:
        variance = np.exp(2 * log_size) * singular**2 + 1.0
        return float(np.sum(np.log(variance) + along**2 / variance))

    grid = np.linspace(float(np.log(SIZES[0])), float(np.log(SIZES[1])), 33)
    best, step = float(min(grid, key=minus_two_log)), float(grid[1] - grid[0])
    found = minimize_scalar(minus_two_log, bounds=(best - step, best + step), method="bounded")
    return float(along @ along) - float(found.fun)


def _product(rows: Array) -> Array:
    return np.asarray(rows @ rows.T)


# --------------------------------------------------------------------------- forms


@dataclass(frozen=True, eq=False, slots=True)
class _Motion:
    """A fitted motion at every k-th sample.

    ``position``, ``velocity`` and ``base`` (n, f) of each degree of freedom, the last the highest derivative;
    ``transition`` (n, s, s) d state / d initial state and ``inverse`` (n, s, f) the columns of its inverse for the
    highest derivatives.
    """

    problem: InitialValueProblem
    values: Array
    states: Array
    position: Array
    velocity: Array
    base: Array
    transition: Array
    inverse: Array

    @classmethod
    def of(cls, solution: Solution, every: int) -> _Motion | None:
        """The motion of a solution; None where its response to small forces cannot be computed."""
        problem, values = solution.problem, solution.values
        states = problem.states(values[:, None])[:, :, 0]
        transition = _transition(solution, states, every)
        if not np.all(np.isfinite(transition)) or np.max(np.linalg.cond(transition)) > WORST_CONDITION:
            return None
        degrees = problem.model.degrees_of_freedom
        forced = problem.model.forced_states
        slopes = np.gradient(states, problem.t_s, axis=0)[::every, forced]
        states = np.ascontiguousarray(states[::every])
        velocity = states[:, forced] if problem.model.second_order else slopes
        inverse = np.linalg.inv(transition)[:, :, forced]
        return cls(
            problem.every(every), values, states, states[:, :degrees], velocity, slopes, transition, np.asarray(inverse)
        )

    def usual_force(self, k: int) -> float:
        """Of one degree of freedom: the undisturbed one, or that which moves it so far in this time if that is more.

        The second is for one that moves without a force, e.g. sideways in a throw.
        """
        order = 2 if self.problem.model.second_order else 1
        moving = np.ptp(self.position[:, k]) / np.ptp(self.problem.t_s) ** order
        return float(max(np.sqrt(np.mean(self.base[:, k] ** 2)), moving))

    def seen_of_force(self, force: Array) -> Array:
        """Change (n, d) of what is observed by a small force (n, f), by variation of constants."""
        drawn = cumulative_simpson(
            np.einsum("nsf,nf->ns", self.inverse, force), x=self.problem.t_s, axis=0, initial=0.0
        )
        change = np.einsum("nrs,ns->nr", self.transition, drawn)
        size = STEP * np.max(np.abs(self.states)) / max(float(np.max(np.abs(change), initial=0.0)), 1e-300)
        sides = [self.problem.observe(self.states + sign * size * change, self.values) for sign in (1.0, -1.0)]
        return np.asarray((sides[0] - sides[1]) / (2 * size))


def response_to_force(solution: Solution, force: Callable[[Array], Array]) -> Array | None:
    """Change (n, d) of what is observed by a small force on every degree of freedom; None where it is not known.

    Parameters
    ----------
    solution
        Of a fit; the response is that of the motion it found.
    force
        Accelerations (n, f) as a function of the velocities (n, f).
    """
    motion = _Motion.of(solution, 1)
    return None if motion is None else motion.seen_of_force(force(motion.velocity))


def _transition(solution: Solution, states: Array, every: int) -> Array:
    """Derivatives d state / d initial state (n, s, s) at every k-th sample, by central differences."""
    problem, count = solution.problem, states.shape[1]
    columns = np.repeat(solution.values[:, None], 2 * count, axis=1)
    steady = STEADY * float(np.max(np.abs(states), initial=0.0))  # the sideways speed of a throw does not change
    step = STEP * np.maximum(np.ptp(states, axis=0), max(steady, 1e-12))
    first = len(problem.model.parameters)
    for k in range(count):
        columns[first + k, 2 * k] += step[k]
        columns[first + k, 2 * k + 1] -= step[k]
    moved = problem.states(columns)[::every]
    return np.asarray((moved[:, :, 0::2] - moved[:, :, 1::2]) / (2 * step))


def _forms(solution: Solution, every: int, n: int) -> Iterator[Array]:
    """What is seen (n, d) of each form that a discrepancy may have, the simplest first."""
    motion = _Motion.of(solution, every)
    t_s, seen = solution.problem.t_s[::every], solution.predicted[::every]
    rate = np.gradient(seen, t_s, axis=0)
    waves = _waves(t_s, int(np.clip(n // SAMPLES_A_WAVE, 1, WAVES)))
    units = [quantity.unit for quantity in solution.problem.model.observed]
    sensors = [
        _readings(seen, k, [*_of_state(_centred(seen[:, k]), rate[:, k]), *_of_view(seen[:, k], unit)])
        for k, unit in enumerate(units)
    ]
    later = [_readings(seen, k, _of_time(seen[:, k], rate[:, k], waves)) for k in range(seen.shape[1])]
    if motion is None:
        yield from chain(*sensors, *later)
        return
    degrees = range(motion.position.shape[1])
    where = _centred if solution.problem.model.second_order else _relative  # a level has a zero of its own
    for k in degrees:
        yield from _forces(motion, k, _of_state(where(motion.position[:, k]), motion.velocity[:, k]))
    yield from chain(*sensors)
    for k in degrees:
        yield from _forces(motion, k, _of_time(motion.base[:, k], motion.velocity[:, k], waves))
    yield from chain(*later)


def _forces(motion: _Motion, k: int, shapes: Sequence[Array]) -> Iterator[Array]:
    """What is seen (n, d) of forces on one degree of freedom, of its usual size."""
    size = motion.usual_force(k)
    for shape in shapes:
        force = np.zeros_like(motion.base)
        force[:, k] = size * shape
        yield motion.seen_of_force(force)


def _readings(seen: Array, k: int, shapes: Sequence[Array]) -> Iterator[Array]:
    """Errors (n, d) in reading one quantity, of the size of its motion."""
    size = 0.5 * float(np.ptp(seen[:, k]))
    for shape in shapes:
        change = np.zeros_like(seen)
        change[:, k] = size * shape
        yield change


def _of_state(u: Array, velocity: Array) -> list[Array]:
    """Functions (n,) of position, from -1 to 1, and velocity, up to about 1."""
    w = _relative(velocity)
    sign = w / np.sqrt(w**2 + SOFT**2)
    powers = [u, np.ones_like(u), w, w * np.abs(w), sign, u**3, u**2, w**2, w**3, np.abs(u)]
    return [*powers, u * w, u**2 * w, u * w**2]


def _of_view(seen: Array, unit: str) -> list[Array]:
    """Functions (n,) of an angle that a picture of unequal scales, or of an oblique view, adds to it."""
    return [np.sin(2 * seen), np.cos(2 * seen)] if unit == "rad" else []


def _of_time(base: Array, velocity: Array, waves: Array) -> list[Array]:
    """Functions (n,) of time, of coefficients that change with time from the start or from the end on, then waves."""
    share = np.linspace(0.0, 1.0, base.size)
    changes = [share, share**2, share**3, (1.0 - share) ** 6]
    b, w = _relative(base), _relative(velocity)
    slow = [factor * change for change in changes for factor in (b, w)]
    fast = [wave * factor for wave in waves for factor in (np.ones_like(w), w)]
    return [share, *slow, *fast]


def _centred(values: Array) -> Array:
    low, high = float(np.min(values)), float(np.max(values))
    return np.asarray((values - (low + high) / 2) / max((high - low) / 2, 1e-300))


def _relative(values: Array) -> Array:
    return np.asarray(values / max(float(np.max(np.abs(values))), 1e-300))


def _waves(t_s: Array, count: int) -> Array:
    """Cosines (count, n) of 1/2, 2/2, ... periods over the clip: together any function of time."""
    share = (t_s - t_s[0]) / max(float(t_s[-1] - t_s[0]), 1e-300)
    return np.asarray(np.cos(np.pi * np.arange(1, count + 1)[:, None] * share))
