"""Estimates with their random and systematic errors, combined at the end as the GUM does (JCGM 100:2008, 5 and G.4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from fitters.integrator.initial_value_problem import value_names
from fitters.noise.sandwich_covariance import quantile_975
from fitters.ode.fit_problem import PreparedFit
from iris_sysid.errors import FitError
from iris_sysid.types import Array, Estimate, FitResult, OdeModel

RANDOM = "random"


@dataclass(frozen=True, eq=False, slots=True)
class Errors:
    """Errors of the free values.

    ``covariance`` (k, k) and ``degrees`` (k,) of the random part, NaN for what is undetermined;
    ``systematic`` by source: (k,) change of the free values for one standard error of a known value or a prior, or
    (r, k) for each of r independent patterns that errors of the measurement have in common.
    """

    covariance: Array
    degrees: Array
    systematic: Mapping[str, Array]

    @property
    def total(self) -> Array:
        """Covariance (k, k) of the random and all systematic errors: the squared standard errors on its diagonal."""
        shifts = [np.atleast_2d(shift) for shift in self.systematic.values()]
        return np.asarray(self.covariance + sum((rows.T @ rows for rows in shifts), np.zeros(self.covariance.shape)))


@dataclass(frozen=True, eq=False, slots=True)
class Budget:
    """Estimates by name, and the standard error of each from each source."""

    estimates: Mapping[str, Estimate]
    budget: Mapping[str, Mapping[str, float]]


def estimate_all(task: PreparedFit, values: Array, errors: Errors) -> Budget:
    """Every number of the fit: fitted and known parameters, initial states, derived quantities.

    Parameters
    ----------
    task
        The prepared fit.
    values
        (p + s,) the solution.
    errors
        Errors of the free values.
    """
    names = value_names(task.model)
    units = _units(task.model)
    estimates, budget = {}, {}
    for name, value in zip(names, values.tolist(), strict=True):
        if name in task.known:
            estimates[name] = task.known[name]
            continue
        parts = _parts(np.eye(len(task.free))[task.free.index(name)], errors, {})
        budget[name] = parts
        estimate = _estimate(value, parts, errors.degrees[task.free.index(name)], units[name], "fitted")
        estimates[name] = replace(estimate, source=_prior_text(task.priors[name])) if name in task.priors else estimate
    for name, (value, gradient, direct) in _derived(task, values).items():
        parts = _parts(gradient, errors, direct)
        degrees = float(np.min(errors.degrees[gradient != 0], initial=np.inf))
        budget[name] = parts
        estimates[name] = _estimate(value, parts, degrees, units[name], "derived")
    return Budget(estimates, budget)


def _prior_text(prior: Estimate) -> str:
    return f"fitted, with the prior {prior.value:g} +- {prior.stderr:g} {prior.unit} ({prior.source or 'given'})"


def _units(model: OdeModel) -> dict[str, str]:
    units = {parameter.name: parameter.unit for parameter in model.parameters}
    units |= {f"{state.name}_0": state.unit for state in model.states}
    return units | {quantity.name: quantity.unit for quantity in model.derived}


def _parts(gradient: Array, errors: Errors, direct: Mapping[str, float]) -> dict[str, float]:
    """Standard errors by source of a quantity with this gradient (k,) in the free values.

    ``direct`` is its own derivative times the standard error of each known value.
    """
    moved = gradient != 0
    parts = {}
    variance = gradient[moved] @ errors.covariance[np.ix_(moved, moved)] @ gradient[moved]
    parts[RANDOM] = float(np.sqrt(np.maximum(variance, 0.0))) if moved.any() else 0.0  # rounding: never below zero
    for source, shift in errors.systematic.items():
        shifts = np.atleast_2d(shift)[:, moved] @ gradient[moved]
        parts[source] = float(np.linalg.norm(shifts + direct.get(source, 0.0)))
    return parts


def _estimate(value: float, parts: Mapping[str, float], degrees: float, unit: str, kind: str) -> Estimate:
    """Combine the parts; effective degrees of freedom by Welch and Satterthwaite (GUM G.4)."""
    stderr = float(np.sqrt(sum(part**2 for part in parts.values())))
    share = (parts[RANDOM] / stderr) ** 2 if stderr > 0 else 0.0
    effective = degrees / share**2 if share > 0 else np.inf
    half = quantile_975(effective) * stderr if np.isfinite(stderr) else np.nan
    return Estimate(value, stderr, unit, kind, ci95=(value - half, value + half))


def _derived(task: PreparedFit, values: Array) -> dict[str, tuple[float, Array, dict[str, float]]]:
    """Value, gradient (k,) in the free values, and direct systematic shifts of each derived quantity."""
    if task.model.derive is None:
        return {}
    centre = _derive(task.model, values)
    free = np.array([_slope(task.model, values, int(index)) for index in task.unknowns.which]).reshape(-1, centre.size)
    uncertain = {name: e.stderr for name, e in task.known.items() if e.stderr > 0}
    names = value_names(task.model)
    direct = {name: _slope(task.model, values, names.index(name)) * stderr for name, stderr in uncertain.items()}
    return {
        quantity.name: (float(centre[k]), free[:, k], {name: float(shift[k]) for name, shift in direct.items()})
        for k, quantity in enumerate(task.model.derived)
    }


def with_derived_errors(fitted: FitResult) -> FitResult:
    """The fit with errors of the derived quantities that follow from those of its values, where these were widened.

    The values keep the correlations of the fit; no error becomes smaller.
    """
    model, free = fitted.model, fitted.free
    if model.derive is None or not free:
        return fitted
    names = value_names(model)
    values = np.array([fitted.estimates[name].value for name in names])
    with np.errstate(all="ignore"):
        wider = [fitted.estimates[name].stderr for name in free] / np.sqrt(np.diag(fitted.total_covariance))
        slopes = np.array([_slope(model, values, names.index(name)) for name in free]) * wider[:, None]
        errors = np.sqrt(np.einsum("ik,ij,jk->k", slopes, fitted.total_covariance, slopes))
    known = {quantity.name: fitted.estimates[quantity.name] for quantity in model.derived}
    found = {
        name: replace(estimate, stderr=float(error), ci95=None)
        for (name, estimate), error in zip(known.items(), errors, strict=True)
        if error > estimate.stderr
    }
    return replace(fitted, estimates={**fitted.estimates, **found})


def _derive(model: OdeModel, values: Array) -> Array:
    assert model.derive is not None
    try:
        with np.errstate(all="ignore"):
            derived = model.derive(dict(zip(value_names(model), values.tolist(), strict=True)))
    except (ArithmeticError, ValueError):  # e.g. the root of a negative number
        return np.full(len(model.derived), np.nan)
    missing = [quantity.name for quantity in model.derived if quantity.name not in derived]
    if missing:
        raise FitError(f"derive of model {model.name!r} must return {', '.join(missing)}; it returned {list(derived)}")
    return np.array([float(derived[quantity.name]) for quantity in model.derived])


def _slope(model: OdeModel, values: Array, index: int) -> Array:
    """Derivative (d,) of the derived quantities by one value, by central differences."""
    step = 1e-6 * max(abs(values[index]), 1e-3)
    above, below = values.copy(), values.copy()
    above[index] += step
    below[index] -= step
    return np.asarray((_derive(model, above) - _derive(model, below)) / (above[index] - below[index]))
