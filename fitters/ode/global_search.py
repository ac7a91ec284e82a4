"""Find the global minimum, by shooting with a growing horizon.

The misfit of an oscillation has a local minimum for every frequency that changes the number of periods by one. A short
horizon at the start of the motion has only one minimum, so the fit begins there and then grows: each time as far as the
present solution follows the data. Starts are tried in turn until one explains the data.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from fitters.integrator.initial_value_problem import InitialValueProblem
from fitters.noise.measurement_noise import robust_sd
from fitters.ode.least_squares import FINE, MAX_RESIDUAL, ROUGH, Accuracy, Solution, Target, Unknowns, minimise
from fitters.ode.status import determination
from iris_sysid.types import Array

FOLLOWS = 0.3  # a solution follows the data while its error is below this fraction of the motion's size
GROWTH = (1.3, 8.0)  # least and largest growth of the horizon
EXPLAINED_NOISE, EXPLAINED_MOTION = 3.0, 0.1  # residual below 3 times the noise, or 10 % of the motion
MIN_SAMPLES, MAX_STRIDE = 500, 8  # samples for a rough fit; at 60 Hz, 8 frames are still one step of the integrator
SEED = 0  # the same starts each time
SAME = 1e-3  # relative difference of the rms of one and the same minimum
DRAWS, DECADES, SCREENED = 256, 3.0, 4  # random values tried without a fit, their range about a start, and those fitted


def grow(
    problem: InitialValueProblem, target: Target, unknowns: Unknowns, values: Array, accuracy: Accuracy = FINE
) -> Solution:
    """Fit a first short horizon, then ever longer ones, then all samples.

    ``values`` (p + s,), each in its own unit.

    The horizons are solved with a loose tolerance, on a subset of their samples where there are many. So is the fit to
    all samples when the solution does not explain the last horizon.

    Parameters
    ----------
    problem, target, unknowns, values, accuracy
        As for :func:`minimise`; the last is that of the fit to all samples.
    """
    n = problem.t_s.size
    values = unknowns.inside(values)
    rough = max(accuracy, ROUGH)
    gradients: tuple[float, ...] = ()
    stop = max(first_horizon(target, unknowns.which.size), reach(problem, target, values))
    while True:
        part = thinned(problem.first(stop), target.first(stop))
        solution = minimise(*part, unknowns, values, accuracy=rough, gradients=gradients)
        values, gradients = solution.values, solution.gradients
        if stop == n:
            last = accuracy if explains(solution, part[1]) else rough
            steps = solution.steps
            return minimise(problem, target, unknowns, values, accuracy=last, steps=steps, gradients=gradients)
        stop = next_horizon(problem, target, values, stop)


def thinned(problem: InitialValueProblem, target: Target) -> tuple[InitialValueProblem, Target]:
    """Every k-th sample, k at most MAX_STRIDE, so that MIN_SAMPLES remain; all samples where the model has inputs."""
    k = min(MAX_STRIDE, problem.t_s.size // MIN_SAMPLES)
    if k < 2 or problem.model.inputs or target.every(k).used.sum() < MIN_SAMPLES // 2:
        return problem, target
    return problem.every(k), target.every(k)


def first_horizon(target: Target, n_free: int) -> int:
    """Number of samples that cover half of the motion's range and suffice for the unknowns."""
    seen = target.observed[target.used]
    span = np.maximum.accumulate(seen, axis=0) - np.minimum.accumulate(seen, axis=0)
    share = np.mean(span / np.where(span[-1] > 0, span[-1], 1.0), axis=1)
    covering = int(np.searchsorted(share, 0.5)) + 1
    index = np.flatnonzero(target.used)
    return int(index[min(max(covering, 2 * n_free + 4), index.size) - 1]) + 1


def next_horizon(problem: InitialValueProblem, target: Target, values: Array, stop: int) -> int:
    """Number of samples over which the present solution still follows the data, within the limits of GROWTH.

    Parameters
    ----------
    problem
        The initial value problem over all samples.
    target
        What the solution should follow.
    values
        (p + s,) parameters and initial states, each in its own unit.
    stop
        Number of samples that the present solution was fitted to.
    """
    least, most = (min(int(growth * stop) + 1, problem.t_s.size) for growth in GROWTH)
    return max(reach(problem.first(most), target.first(most), values), least)


def reach(problem: InitialValueProblem, target: Target, values: Array) -> int:
    """Number of samples over which the solution follows the data: until two of three used samples deviate.

    ``values`` (p + s,), each in its own unit.

    A single deviating sample may be an outlier.
    """
    rough = problem.with_step(float(np.median(np.diff(problem.t_s))))
    with np.errstate(all="ignore"):
        error = np.abs(target.observed - rough.predicted(values)) / target.size
    index = np.flatnonzero(target.used)
    lost = ~(np.max(error[index], axis=1) < FOLLOWS)
    several = np.convolve(lost, np.ones(3), mode="same") >= 2
    return int(index[several.argmax()]) if several.any() else problem.t_s.size


def explains(solution: Solution, target: Target, motion_share: float = EXPLAINED_MOTION) -> bool:
    """Whether most of each quantity's residual is near the noise or small compared with the motion."""
    if not np.isfinite(solution.rms):
        return False
    motion = float(np.sqrt(np.mean((target.size / np.median(target.sigma[target.used], axis=0)) ** 2)))
    residual = ((target.observed - solution.predicted) / target.sigma)[target.used]
    return max(robust_sd(column) for column in residual.T) < max(EXPLAINED_NOISE, motion_share * motion)


def search(
    problem: InitialValueProblem, target: Target, unknowns: Unknowns, starts: Iterable[tuple[Array, bool]]
) -> Solution:
    """Fit from each start in turn until one explains the data, or two starts end in the same best minimum.

    An incomplete equation leaves a residual above the noise but small compared with the motion. Then random starts are
    skipped, but trusted starts are still tried. Where all of them are lost (:func:`is_lost`), values over several
    decades are screened without a fit, and those that follow the data best are starts as well.

    Parameters
    ----------
    problem, target, unknowns
        As for :func:`minimise`.
    starts
        Full vectors of values (p + s,), the most trusted first, and whether each is one to trust.
    """
    best, first = None, np.zeros(0)
    times_found = 0
    for start, trusted in starts:
        first = start if best is None else first
        if best is not None and not trusted and explains(best, target):
            break
        solution = grow(problem, target, unknowns, start)
        if best is None or solution.rms < best.rms * (1 - SAME):
            best, times_found = solution, 1
        elif np.isfinite(solution.rms) and solution.rms < best.rms * (1 + SAME):
            times_found += 1
        if times_found == 2 or explains(best, target, motion_share=0.0):
            break
    assert best is not None
    if is_lost(best, target, unknowns):
        for start in screened_starts(problem, target, unknowns, first):
            solution = grow(problem, target, unknowns, start)
            best = solution if solution.rms < best.rms else best
            if explains(best, target):
                break
    return best


def is_lost(solution: Solution, target: Target, unknowns: Unknowns) -> bool:
    """Whether a solution diverges, or ends far from the data where some values do not act.

    Beyond the domain of a root or a logarithm, which an equation often clips, a value has no gradient that leads back.

    Parameters
    ----------
    solution, target, unknowns
        The solution, the data, and the free values.
    """
    if not np.isfinite(solution.rms):
        return True
    if explains(solution, target):
        return False
    slopes = np.nan_to_num(solution.problem.sensitivity(solution.values, unknowns.which, solution.steps))
    flat = np.concatenate([target.weighted(slopes), unknowns.prior_rows])
    return bool(determination(np.clip(flat, -MAX_RESIDUAL, MAX_RESIDUAL)).undetermined.any())


def scattered_starts(unknowns: Unknowns, values: Array, target: Target, count: int) -> Iterator[Array]:
    """Random starts about a given one: parameters within a factor of about 2, initial states within the motion's size.

    Parameters
    ----------
    unknowns
        The free values and their bounds.
    values
        (p + s,) the start to scatter about.
    target
        Gives the size of the motion.
    count
        Number of starts.
    """
    rng = np.random.default_rng(SEED)
    size = float(np.mean(target.size))
    for _ in range(count):
        scattered = values.copy()
        now = values[unknowns.which]
        factor = np.exp(0.7 * rng.standard_normal(now.size))
        shift = np.where(now == 0, size, 0.0) * rng.standard_normal(now.size)
        scattered[unknowns.which] = now * factor + shift
        yield unknowns.inside(scattered)


def screened_starts(problem: InitialValueProblem, target: Target, unknowns: Unknowns, values: Array) -> Iterator[Array]:
    """Starts (p + s,) over several decades and both signs that follow the data best without a fit.

    Half of them are chosen by the first horizon, half by all samples.

    Parameters
    ----------
    problem, target, unknowns
        As for :func:`minimise`.
    values
        (p + s,) the start to draw about; each value of a draw is its own with a probability of one in three.
    """
    columns = _drawn(unknowns, values, float(np.mean(target.size)), np.random.default_rng(SEED))
    horizon = first_horizon(target, unknowns.which.size)
    with np.errstate(all="ignore"):
        error = np.abs(target.observed[:, :, None] - problem.predictions(columns)) / target.size[:, None]
    error = np.where(np.isfinite(error), np.minimum(error, 1.0 / FOLLOWS), 2.0 / FOLLOWS)
    scores = [np.sum(error[:n][target.used[:n]] ** 2, axis=(0, 1)) for n in (horizon, error.shape[0])]
    ranks = [np.argsort(score, kind="stable")[: SCREENED // 2] for score in scores]
    for index in dict.fromkeys(np.stack(ranks, axis=1).ravel().tolist()):
        yield columns[:, index]


def _drawn(unknowns: Unknowns, values: Array, size: float, rng: np.random.Generator) -> Array:
    """Random values (p + s, DRAWS) about ``values`` (p + s,), or about the motion's size, inside the bounds."""
    now = values[unknowns.which][:, None]
    shape = now.size, DRAWS
    about = np.where(rng.random(shape) < 0.5, np.where(now == 0, 1.0, np.abs(now)), max(size, 1e-12))
    signed = about * 10.0 ** rng.uniform(-DECADES, DECADES, shape) * rng.choice([-1.0, 1.0], shape)
    columns = np.repeat(values[:, None], DRAWS, axis=1)
    columns[unknowns.which] = np.where(rng.random(shape) < 1 / 3, now, signed)
    return np.stack([unknowns.inside(column) for column in columns.T], axis=1)
