"""Judge a fit: what it leaves undetermined, its status, and the remedy in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitters.integrator.initial_value_problem import value_names
from fitters.ode.fit_problem import PreparedFit
from fitters.ode.least_squares import Solution, Unknowns
from iris_sysid.types import Array, Estimate, FitProblem, FitStatus, Mask

SINGULAR = 1e12  # condition of the scaled Fisher information; derivatives are good to 1e-7, so 1e14 is rounding
PART = 1e-4  # smallest component that makes a value part of a null direction, in scaled values; rounding gives 1e-8
SHARE = 0.05  # fraction of the strongest relative change above which a value is named
WEAK = 0.3  # fraction of the largest component of a direction above which a value is named
# Residual over noise. From differences, noise of correlation 0.9 is 4.4 times too small, 7 times in one clip of 10,000.
MISFIT_NOISE = 8.0
ROUNDING = 1e-6  # residual over the motion that is no more than the integrator's and the optimiser's error
NEARER_START = "Give starting values nearer to the truth"
SPARE = 3  # samples needed in addition to one per unknown


@dataclass(frozen=True, eq=False, slots=True)
class Determination:
    """Which of the free values the data determine.

    ``condition`` of the Fisher information after scaling each parameter to unit information; ``null`` (j, k)
    its null directions in the free values; ``undetermined`` (k,) has a share in one of them.
    """

    condition: float
    null: Array
    undetermined: Mask


def determination(sensitivity: Array) -> Determination:
    """Find the null directions of sensitivities (m, k) by the singular values of the scaled columns."""
    size = np.sqrt(np.sum(sensitivity**2, axis=0))
    if size.size == 0:
        return Determination(1.0, np.empty((0, 0)), np.zeros(0, dtype=np.bool_))
    scaled = sensitivity / np.where(size > 0, size, 1.0)
    triangle = np.linalg.qr(scaled, mode="r")
    _, singular, right = np.linalg.svd(triangle)
    condition = float((singular[0] / max(singular[-1], 1e-12 * singular[0])) ** 2) if singular[0] > 0 else np.inf
    null = right[singular**2 * SINGULAR < singular[0] ** 2]
    undetermined = np.any(np.abs(null) > PART, axis=0) if null.size else np.zeros(size.size, dtype=np.bool_)
    return Determination(condition, null / np.where(size > 0, size, 1.0), undetermined)


def null_direction_text(names: tuple[str, ...], values: Array, direction: Array) -> str:
    """Say which changes of the parameters do not change the prediction.

    ``values`` (k,) and ``direction`` (k,), each in its own unit.
    """
    shown = [k for k in range(len(names)) if abs(direction[k]) > 0]
    relative = np.array([direction[k] / values[k] if values[k] != 0 else np.inf for k in shown])
    if not np.all(np.isfinite(relative)):
        return "the data do not determine " + ", ".join(names[k] for k in shown)
    strongest = np.max(np.abs(relative))
    part = [(names[k], r / strongest) for k, r in zip(shown, relative, strict=True) if abs(r) > SHARE * strongest]
    if len(part) == 1:
        return f"the data do not determine {part[0][0]} at all"
    sign = np.sign(part[0][1])
    listed = _and([name for name, _ in part])
    if all(abs(share * sign - 1.0) < 0.02 for _, share in part):
        return f"{listed} scale together: only their ratios are determined"
    changes = ", ".join(f"{name} by {share * sign:+.2g} %" for name, share in part)
    return f"{listed} cannot be told apart: changing {changes} leaves the prediction as it is"


def weakest_text(names: tuple[str, ...], sensitivity: Array) -> str:
    """Say which free values the data distinguish least, and by how much this increases their common error.

    ``sensitivity`` (n * d, k), in the observed unit per unit of the value.
    """
    size = np.sqrt(np.sum(sensitivity**2, axis=0))
    if len(names) < 2 or not np.all(size > 0):
        return ""
    _, singular, right = np.linalg.svd(np.linalg.qr(sensitivity / size, mode="r"))
    shares = np.abs(right[-1]) / np.max(np.abs(right[-1]))
    part = [name for name, share in zip(names, shares, strict=True) if share > WEAK]
    if singular[-1] <= 0 or len(part) < 2:
        return ""
    growth = f"their common error is {1 / singular[-1]:.3g} times the error of each alone"
    return f"{_and(part)} are the least distinguishable: {growth}"


def _and(names: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def undetermined(task: PreparedFit, values: Array, found: Determination) -> FitProblem:
    """Name the null directions of a singular fit and say what to give. ``values`` (p + s,), each in its own unit."""
    texts = [null_direction_text(task.free, values[task.unknowns.which], row) for row in found.null]
    names = [name for name, out in zip(task.free, found.undetermined, strict=True) if out]
    initial = task.model.initial_names
    to_set = tuple(sorted(names, key=lambda name: name in initial))  # parameters are known more often
    return FitProblem("undetermined", "; ".join(texts), "", f"Give one of {_and(names)} a known value", to_set)


def at_bounds(unknowns: Unknowns, values: Array) -> Mask:
    """True (k,) for free values that sit on one of their bounds, whatever the optimiser says.

    ``values`` (p + s,), each in its own unit.
    """
    now = values[unknowns.which]
    touching = np.zeros(now.size, dtype=np.bool_)
    for bound in (unknowns.lower, unknowns.upper):
        near = np.abs(now - bound) <= 1e-6 * np.maximum(np.abs(bound), 1e-3) + 2e-6 * _width(unknowns)
        touching |= np.isfinite(bound) & near
    return touching


def _width(unknowns: Unknowns) -> Array:
    width = unknowns.upper - unknowns.lower
    return np.where(np.isfinite(width), np.minimum(width, 1e-3), 0.0)


def at_its_bound(task: PreparedFit, values: Array, touching: Mask) -> FitProblem:
    """Name the values at their bounds and say what that can mean.

    ``values`` (p + s,), each in its own unit; ``touching`` (k,).
    """
    at = [f"{task.free[k]} = {values[task.unknowns.which[k]]:.4g}" for k in np.flatnonzero(touching)]
    return FitProblem(
        "at-bound",
        f"{_and(at)}: at the bound of the allowed range, where no error can be given for it",
        remedy="The other estimates hold only with it there. If that is its true value, state it as known; otherwise "
        "the model has too many parameters or does not describe this motion",
        to_set=tuple(task.free[k] for k in np.flatnonzero(touching)),
    )


def too_few_samples(n: int, needed: int, free: int) -> FitProblem:
    """Say how many samples there are and how many are needed.

    Parameters
    ----------
    n, needed, free
        Numbers of usable samples, of samples needed, and of unknowns.
    """
    return FitProblem(
        "too-few-samples",
        f"only {n} usable samples for {free} unknowns; at least {needed} are needed",
        remedy="Take a longer clip, or fix what is known",
    )


def diverged(task: PreparedFit, solution: Solution) -> FitProblem:
    """Say why the solution is not finite, and from which values it started."""
    values = dict(zip(value_names(task.model), solution.values, strict=True))
    unknown = [name for name, value in values.items() if np.isnan(value) and _is_needed(task, name, solution.values)]
    if unknown:
        return FitProblem(
            "missing-value",
            f"the equation needs {_and(unknown)}, which has no value",
            remedy=f"Give {_and(unknown)} a value",
            to_set=tuple(unknown),
        )
    shown = ", ".join(f"{name} = {value:.4g}" for name, value in values.items())
    lost = _without_slope(task, solution.values)
    if lost:
        finding = f"rhs of model {task.model.name!r} gives no finite rate of {_and(lost)} at the start"
        return FitProblem("rate-not-finite", finding, shown)
    return FitProblem("solution-diverges", "the solution diverges", shown, NEARER_START, to_start=task.free)


def not_converged(task: PreparedFit, solution: Solution) -> FitProblem:
    """Say why the optimiser stopped."""
    finding = "the fit did not converge"
    return FitProblem("not-converged", finding, solution.message, NEARER_START, to_start=task.free)


def _without_slope(task: PreparedFit, values: Array) -> list[str]:
    """States whose rate is not finite at the first sample."""
    model, problem = task.model, task.problem
    params, state = values[: len(model.parameters)].tolist(), values[len(model.parameters) :].tolist()
    mode = [0.0] if model.events else []
    known = [tuple(problem.inputs[0].tolist())] if model.inputs else []
    try:
        with np.errstate(all="ignore"):
            slopes = model.rhs(float(problem.t_s[0]), (*state, *mode), tuple(params), *known)
    except (ArithmeticError, ValueError):
        return [state.name for state in model.states]
    return [component.name for component, slope in zip(model.states, slopes, strict=True) if not np.isfinite(slope)]


def _is_needed(task: PreparedFit, name: str, values: Array) -> bool:
    """Whether the prediction depends on this value, so that it is unknown without it."""
    known = np.where(np.isnan(values), 1.0, values)
    known[value_names(task.model).index(name)] = np.nan
    return not np.isfinite(task.problem.first(2).predicted(known)).all()


def unknown_text(task: PreparedFit, estimates: Mapping[str, Estimate]) -> str:
    """Say which derived quantities could not be computed, and what they need; empty when all could."""
    unknown_derived = [quantity.name for quantity in task.model.derived if np.isnan(estimates[quantity.name].value)]
    unknown = [name for name, estimate in task.known.items() if np.isnan(estimate.value)]
    if not (unknown_derived and unknown):
        return ""
    return f"{_and(unknown_derived)} needs {_and(unknown)}: give it a known value"


def residual_above_noise(task: PreparedFit, rms: Array, noise: Array) -> FitProblem:
    """Say how far the residual is above the noise. ``rms`` and ``noise`` (d,), in the observed units."""
    with np.errstate(all="ignore"):
        parts = zip(task.model.observed, rms / noise, strict=True)
    ratios = ", ".join(f"{quantity.name} {ratio:.3g} times" for quantity, ratio in parts if np.isfinite(ratio))
    return FitProblem(
        "residual-above-noise",
        "the residual is far above the noise",
        ratios,
        "The equation lacks an effect, or part of the motion does not belong to it: look at the residual, or diagnose "
        "it",
    )


def is_misfit(rms: Array, noise: Array, size: Array) -> bool:
    """Whether a residual (d,) is so far above the noise that no autocorrelation of the noise explains it.

    A smaller residual is a misfit where its form is not that of noise: see :mod:`fitters.ode.model_discrepancy`. All
    three (d,) in the observed units, ``size`` is the motion's standard deviation.
    """
    with np.errstate(all="ignore"):
        far = ~(rms <= MISFIT_NOISE * noise)
    return bool(np.any(far & (rms > ROUNDING * size)))


def above_rounding(rms: Array, size: Array) -> bool:
    """Whether a residual (d,) is more than numerical error beside the motion's standard deviation (d,).

    Both (d,) in the observed units.
    """
    return bool(np.any(rms > ROUNDING * size))


def needed_samples(n_observed: int, n_free: int) -> int:
    """Smallest number of samples of ``n_observed`` quantities for ``n_free`` unknowns."""
    return -(-n_free // n_observed) + SPARE


def status_of(*, converged: bool, singular: bool, touching: bool, misfit: bool) -> FitStatus:
    """The most serious of what applies.

    Parameters
    ----------
    converged, singular, touching, misfit
        Whether the optimiser converged, there is a null direction, a value at its bound, a residual above the noise.
    """
    if not converged:
        return "not-converged"
    if singular:
        return "singular"
    if touching:
        return "at-bound"
    return "misfit" if misfit else "ok"
