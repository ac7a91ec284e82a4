"""95 % intervals by other methods than the linearised fit: profile likelihood and block bootstrap.

All describe the random error only; errors of known values add to each of them equally.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from fitters.integrator.initial_value_problem import BATCH_NUMBERS
from fitters.noise.autoregression import Autoregression, autocovariance
from fitters.noise.sandwich_covariance import inverse_normal
from fitters.ode.fit_problem import PreparedFit
from fitters.ode.least_squares import Solution, Target, minimise
from fitters.ode.result import Linearised
from fitters.ode.status import SINGULAR
from iris_sysid.errors import FitError
from iris_sysid.types import Array, Mask

Method = Literal["robust", "profile", "bootstrap"]
METHODS: tuple[Method, ...] = get_args(Method)
Interval = tuple[float, float]

CLOSE = 0.01  # of the quantile, at which the end of a profile interval is found
TRIES = 8
REPLICATES = 400  # the ends of the interval scatter by 7 % of its half width
CHORD_STEPS = 8
DISAGREE = 0.25  # fraction of the robust half width: three times the scatter with 400 replicates
LAGS = 2000  # longest autocorrelation of the noise that a block covers, in samples


@dataclass(frozen=True, eq=False, slots=True)
class Found:
    """A finished fit with the quantities that the intervals need.

    ``covariance`` (k, k) of the free values, priors included; ``quantile`` (k,) of Student's t; ``usable`` (k,) false
    for values at a bound or undetermined; ``noise`` of each quantity.
    """

    task: PreparedFit
    target: Target
    solution: Solution
    near: Linearised
    covariance: Array
    quantile: Array
    usable: Mask
    noise: tuple[Autoregression, ...]

    @property
    def values(self) -> Array:
        """The free values (k,). Each is in its own unit."""
        return self.solution.values[self.task.unknowns.which]

    @property
    def spread(self) -> Array:
        """Mean squared residual in units of sigma, unknowns deducted. One number for all of (n, d), dimensionless."""
        size, k = self.near.residual.size, self.usable.size
        return np.asarray(np.sum(self.near.residual**2) / max(size - k, 1))


def checked_methods(methods: Sequence[str]) -> tuple[Method, ...]:
    """The methods in the order of METHODS; for an unknown method, a FitError lists the known ones."""
    unknown = [method for method in methods if method not in (*METHODS, "all")]
    if unknown:
        raise FitError(f"uncertainty: there is no {', '.join(unknown)}; there are: {', '.join(METHODS)}, all")
    return tuple(method for method in METHODS if method in methods or "all" in methods)


def intervals_by(found: Found, methods: Sequence[Method]) -> dict[str, dict[str, Interval]]:
    """Intervals by method and name, for the values that have an error."""
    functions: Mapping[Method, Callable[[Found], dict[str, Interval]]] = {
        "robust": _robust,
        "profile": _profile,
        "bootstrap": _bootstrap,
    }
    return {method: functions[method](found) for method in methods}


def disagreements(intervals: Mapping[str, Mapping[str, Interval]]) -> list[str]:
    """One sentence for each value whose interval by another method disagrees with the robust one."""
    texts = []
    for method, meaning in (
        ("profile", "the fit is not linear over its own error, and the profile is to be trusted"),
        ("bootstrap", "the noise is not what an autoregression describes, and the wider one is to be trusted"),
    ):
        for name, (low, high) in intervals.get(method, {}).items():
            lower, upper = intervals["robust"][name]
            half = (upper - lower) / 2
            if max(abs(low - lower), abs(high - upper)) > DISAGREE * half or not np.isfinite(low + high):
                texts.append(
                    f"the {method} interval of {name}, {low:.5g} to {high:.5g}, disagrees with the robust one, "
                    f"{lower:.5g} to {upper:.5g}: {meaning}"
                )
    return texts


def _robust(optimum: Found) -> dict[str, Interval]:
    half = optimum.quantile * np.sqrt(np.diag(optimum.covariance))
    return {
        name: (float(optimum.values[k] - half[k]), float(optimum.values[k] + half[k]))
        for k, name in enumerate(optimum.task.free)
        if optimum.usable[k]
    }


# --------------------------------------------------------------------------- profile likelihood


def _profile(optimum: Found) -> dict[str, Interval]:
    """Ends at which the misfit, all other values fitted again, has grown by the squared quantile (Wilks 1938).

    For noise that is not white the misfit is divided by the ratio of the robust variance to the white one (Kent
    1982, Biometrika 69, 19), so that both intervals are the same where the fit is linear.
    """
    white = inverse_normal(optimum.near.informed[:, optimum.usable], SINGULAR**-0.5)
    scale = np.full(optimum.usable.size, np.nan)
    scale[optimum.usable] = np.diag(optimum.covariance)[optimum.usable] / np.diag(white)
    return {
        name: (_end(optimum, k, scale[k], -1.0), _end(optimum, k, scale[k], 1.0))
        for k, name in enumerate(optimum.task.free)
        if optimum.usable[k]
    }


def _end(optimum: Found, index: int, scale: float, side: float) -> float:
    """The value at which the signed root of the misfit's growth reaches the quantile, by the secant method."""
    unknowns = optimum.task.unknowns
    best, quantile = optimum.values[index], optimum.quantile[index]
    distance = side * quantile * float(np.sqrt(optimum.covariance[index, index]))
    bound = float(unknowns.lower[index] if side < 0 else unknowns.upper[index])
    for _ in range(TRIES):
        at = bound if abs(distance) >= abs(bound - best) else best + distance
        growth = _misfit_with(optimum, index, at) - _misfit(optimum, optimum.solution)
        root = float(np.sqrt(max(growth, 0.0) / scale))
        if not np.isfinite(root):
            return float(side * np.inf)
        if abs(root - quantile) < CLOSE * quantile or (at == bound and root < quantile):
            return float(at)
        distance *= float(np.clip(quantile / max(root, 1e-12), 0.25, 4.0))
    return float(best + distance)


def _misfit_with(optimum: Found, index: int, value: float) -> float:
    """Smallest sum of squares with one free value held."""
    task, solution = optimum.task, optimum.solution
    usable = optimum.usable & (np.arange(optimum.usable.size) != index)
    moved = solution.values.copy()
    response = optimum.covariance[:, index] / optimum.covariance[index, index] * (value - optimum.values[index])
    moved[task.unknowns.which[usable]] += response[usable]
    moved[task.unknowns.which[index]] = value
    others = task.unknowns.without(index)
    if others.which.size == 0:
        predicted = solution.problem.predicted(moved)
        fitted = Solution(solution.problem, moved, predicted, solution.steps, 0.0, True, True, "")
    else:
        fitted = minimise(solution.problem, optimum.target, others, moved, steps=np.delete(solution.steps, index))
    return _misfit(optimum, fitted)


def _misfit(optimum: Found, solution: Solution) -> float:
    residual = optimum.target.weighted(optimum.target.observed - solution.predicted)
    pulls = optimum.task.unknowns.prior_residual(solution.values)
    with np.errstate(all="ignore"):
        return float(residual @ residual + pulls @ pulls)


# --------------------------------------------------------------------------- block bootstrap


def block_length(noise: Sequence[Autoregression], n: int) -> int:
    """Length of blocks that is best for the variance of a mean, (2 G^2 / D n)^(1/3), circular blocks.

    G = sum |k| R(k) and D = 4/3 (sum R(k))^2 over all lags (Politis and White 2004, Econometric Reviews 23, 53), with
    the autocovariance R of the autoregression; the longest over the quantities.
    """
    longest = 1.0
    for process in noise:
        covariance = autocovariance(process.partial, min(LAGS, n))
        lags = np.arange(covariance.size)
        spectrum = covariance[0] + 2 * np.sum(covariance[1:])
        longest = max(longest, float((1.5 * (2 * np.sum(lags * covariance)) ** 2 / spectrum**2 * n) ** (1 / 3)))
    return int(np.clip(round(longest), 1, max(n // 4, 1)))


def _bootstrap(optimum: Found) -> dict[str, Interval]:
    """Basic bootstrap interval (Davison and Hinkley 1997, section 5.2) of residuals resampled in circular blocks.

    Blocks (Kuensch 1989, Ann. Stat. 17, 1217) keep the noise's autocorrelation. Each replicate is a full fit, by
    the chord method from the optimum: it keeps the Jacobian and recomputes the prediction.
    """
    rng = np.random.default_rng(0)
    size = max(1, BATCH_NUMBERS // optimum.near.residual.size)
    batches = [min(size, REPLICATES - start) for start in range(0, REPLICATES, size)]
    change = np.concatenate([_replicates(optimum, count, rng) for count in batches], axis=1)
    change = change[:, np.all(np.isfinite(change), axis=0)]
    if change.shape[1] < REPLICATES // 2:
        nothing = (float("nan"), float("nan"))
        return {name: nothing for name, usable in zip(optimum.task.free, optimum.usable, strict=True) if usable}
    low, high = np.percentile(change, [2.5, 97.5], axis=1)
    kept = np.flatnonzero(optimum.usable)
    return {
        optimum.task.free[k]: (float(optimum.values[k] - high[c]), float(optimum.values[k] - low[c]))
        for c, k in enumerate(kept)
    }


def _replicates(optimum: Found, count: int, rng: np.random.Generator) -> Array:
    """Changes of the usable free values (k, count) in refits to resampled residuals."""
    near, unknowns = optimum.near, optimum.task.unknowns
    usable = np.flatnonzero(optimum.usable)
    drawn = _drawn_residual(optimum, count, rng)
    flat, precision = near.flat[:, usable], unknowns.precision[usable]
    bread = inverse_normal(near.informed[:, usable], SINGULAR**-0.5)
    prior_draws = rng.standard_normal((usable.size, count)) * _prior_spread(optimum)[usable, None]
    change = np.zeros((usable.size, count))
    moved = np.zeros_like(drawn)
    for _ in range(CHORD_STEPS):
        step = bread @ (flat.T @ (drawn - moved) + precision[:, None] ** 2 * (prior_draws - change))
        change += step
        relative = np.abs(step) / np.sqrt(np.diag(optimum.covariance))[usable, None]
        if not np.nanmax(relative) > CLOSE:
            break
        moved = _moved(optimum, usable, change)
    return change


def _prior_spread(optimum: Found) -> Array:
    """Standard errors (k,) of the priors, zero where there is none."""
    priors = optimum.task.priors
    return np.array([priors[name].stderr if name in priors else 0.0 for name in optimum.task.free])


def _drawn_residual(optimum: Found, count: int, rng: np.random.Generator) -> Array:
    """Residuals (n * d, count) drawn in circular blocks, inflated for the degrees of freedom that the fit uses."""
    residual = optimum.near.residual - optimum.near.residual.mean(axis=0)
    n, d = residual.shape
    residual = residual * np.sqrt(n * d / max(n * d - optimum.usable.size, 1))
    length = block_length(optimum.noise, n)
    starts = rng.integers(0, n, (-(-n // length), count))
    index = (starts[:, None, :] + np.arange(length)[None, :, None]).reshape(-1, count)[:n] % n
    return np.asarray(residual[index].transpose(0, 2, 1).reshape(n * d, count))


def _moved(optimum: Found, usable: NDArray[np.intp], change: Array) -> Array:
    """Change of the prediction (n * d, count) in units of sigma when the free values change."""
    solution, target = optimum.solution, optimum.target
    columns = np.repeat(solution.values[:, None], change.shape[1], axis=1)
    columns[optimum.task.unknowns.which[usable]] += change
    difference = solution.problem.predictions(columns) - solution.predicted[:, :, None]
    with np.errstate(all="ignore"):
        return np.asarray(target.weighted(difference))
