"""From a solution to a FitResult: errors, noise, criteria, status."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitters.integrator.initial_value_problem import difference_steps, value_names
from fitters.noise.sandwich_covariance import Uncertainty, inverse_normal, random_uncertainty
from fitters.ode.error_budget import RANDOM, Budget, Errors, estimate_all
from fitters.ode.fit_problem import PreparedFit, with_priors
from fitters.ode.least_squares import MAX_RESIDUAL, Solution, Target
from fitters.ode.model_discrepancy import SOURCE, Discrepancy, discrepancy_of
from fitters.ode.status import (
    SINGULAR,
    Determination,
    above_rounding,
    at_bounds,
    at_its_bound,
    determination,
    is_misfit,
    not_converged,
    null_direction_text,
    residual_above_noise,
    status_of,
    undetermined,
    unknown_text,
    weakest_text,
)
from fitters.ode.unseen_drag import UNSEEN_DRAG, unseen_drag
from iris_sysid.trajectory.consistency.earth_gravity import earth_gravity_doubt
from iris_sysid.types import (
    Array,
    Doubt,
    ErrorAutocorrelation,
    Estimate,
    FitProblem,
    FitResult,
    FitStatus,
    Identifiability,
    Mask,
    OdeModel,
    Trajectory,
)

NO_PULLS: Array = np.zeros(0)
DISCREPANCY_NOTE = f"the errors include what the equation may lack ({SOURCE}), as far as the residual shows it"
NOISE_GAIN = {1: 2.0, 2: 6.0}  # variance of a difference of white noise over its own: 1 + 1, and 1 + 4 + 1


@dataclass(frozen=True, eq=False, slots=True)
class Linearised:
    """The fit near its solution, at the used samples and in units of sigma.

    ``residual`` (n, d); ``sensitivity`` (n, d, k) to the free values; ``known`` by source (r, n, d): change of
    prediction - observation for one standard error of each uncertain known value (r = 1), and of each pattern that
    errors of the observation have in common; ``prior`` (j, k) rows that priors add to the sensitivities; ``measured``
    the autocorrelation of the noise and ``stated`` (d,) its size in single samples, where the tracker measured them.
    """

    t_s: Array
    residual: Array
    sensitivity: Array
    known: Mapping[str, Array]
    prior: Array
    measured: ErrorAutocorrelation | None = None
    stated: Array | None = None

    @property
    def flat(self) -> Array:
        """Sensitivity as a matrix (n * d, k), time-major. In the observed unit per unit of the value."""
        n, d, k = self.sensitivity.shape
        return self.sensitivity.reshape(n * d, k)

    @property
    def informed(self) -> Array:
        """The flat sensitivity with the rows of the priors below it (n * d + j, k).

        In the observed unit per unit of the value.
        """
        return np.concatenate([self.flat, self.prior])


def linearise(task: PreparedFit, target: Target, solution: Solution) -> Linearised:
    """Residual and sensitivities at the solution.

    Parameters
    ----------
    task, target, solution
        The prepared fit, the samples used with their weights, and the solution.
    """
    others = uncertain_values(task)
    problem, values = solution.problem, solution.values
    which = np.concatenate([task.unknowns.which, others])
    steps = np.concatenate([solution.steps, difference_steps(problem, values, others)])
    slopes = np.nan_to_num(problem.sensitivity(values, which, steps))
    scaled = slopes[target.used] / target.sigma[target.used][:, :, None]
    return linearised_by(task, target, solution, scaled, task.unknowns.prior_rows)


def uncertain_values(task: PreparedFit) -> NDArray[np.intp]:
    """Indices (u,) of the values that are held and have a standard error."""
    names = value_names(task.model)
    return np.array([names.index(name) for name, known in task.known.items() if known.stderr > 0], dtype=np.intp)


def linearised_by(
    task: PreparedFit, target: Target, solution: Solution, sensitivity: Array, prior: Array
) -> Linearised:
    """The fit near its solution, from sensitivities that are there.

    Parameters
    ----------
    task, target, solution
        As for :func:`linearise`.
    sensitivity
        (n, d, k + u) of the used samples, in sigma per unit of the free values, then of the uncertain ones.
    prior
        (j, k) rows that are added to the sensitivities.
    """
    names, k = value_names(task.model), task.unknowns.which.size
    sigma = target.sigma[target.used]
    scaled = np.clip(sensitivity, -MAX_RESIDUAL, MAX_RESIDUAL)
    uncertain = [names[index] for index in uncertain_values(task)]
    known = {name: scaled[None, :, :, k + i] * task.known[name].stderr for i, name in enumerate(uncertain)}
    known |= {source: -patterns[:, target.used] / sigma for source, patterns in task.systematic.items()}
    return Linearised(
        t_s=solution.problem.t_s[target.used],
        residual=(target.observed - solution.predicted)[target.used] / sigma,
        sensitivity=scaled[:, :, :k],
        known=known,
        prior=prior,
        measured=task.trajectory.error_autocorrelation,
        stated=_stated(task, target),
    )


def _stated(task: PreparedFit, target: Target) -> Array | None:
    """Median of the errors (d,) that the tracker states, in units of sigma; None where no tracker measured them."""
    if task.trajectory.error_autocorrelation is None:
        return None
    columns = [task.trajectory.column(quantity.name) for quantity in task.model.observed]
    given = task.trajectory.sigma[task.selection.span][:, columns][target.used]
    return np.asarray(np.median(given / target.sigma[target.used], axis=0))


def errors_of(task: PreparedFit, near: Linearised, usable: Mask, undetermined: Mask) -> tuple[Errors, Uncertainty]:
    """Random and systematic errors; NaN for values that are undetermined or sit at a bound.

    Parameters
    ----------
    task
        The prepared fit; its priors are separate sources of error.
    near
        The linearised fit.
    usable
        (k,) false for values at a bound: they are held there.
    undetermined
        (k,) values with a share in a null direction.
    """
    k = usable.size
    flat = near.flat[:, usable]
    bread = inverse_normal(near.informed[:, usable], SINGULAR**-0.5)
    random = random_uncertainty(
        near.t_s, near.residual, near.sensitivity[:, :, usable], bread, near.measured, near.stated
    )
    covariance, degrees = np.full((k, k), np.nan), np.full(k, np.nan)
    covariance[np.ix_(usable, usable)] = random.covariance
    degrees[usable] = random.degrees
    covariance[undetermined, :] = covariance[:, undetermined] = np.nan
    systematic = {}
    for name, responses in near.known.items():
        shift = np.full((len(responses), k), np.nan)
        shift[:, usable] = -responses.reshape(len(responses), -1) @ flat @ bread
        systematic[name] = np.where(undetermined, np.nan, shift)
    pulls = _prior_shifts(task, bread, usable)
    systematic |= {name: np.where(undetermined, np.nan, shift) for name, shift in pulls.items()}
    return Errors(covariance, degrees, systematic), random


def _prior_shifts(task: PreparedFit, bread: Array, usable: Mask) -> dict[str, Array]:
    """Change of the free values (k,) for one standard error of each prior, by name."""
    shifts = {}
    for index in task.unknowns.measured:
        if not usable[index]:
            continue
        name = task.free[index]
        shifts[name] = np.full(usable.size, np.nan)
        pull = task.unknowns.precision[index] ** 2 * task.priors[name].stderr
        shifts[name][usable] = bread[:, int(usable[:index].sum())] * pull
    return shifts


def _discrepancy(
    task: PreparedFit, target: Target, solution: Solution, near: Linearised, usable: Mask
) -> Discrepancy | None:
    """What the equation lacks, for the usable values (k,); None where the residual has no more than rounding."""
    rms = np.sqrt(np.mean((target.observed - solution.predicted)[target.used] ** 2, axis=0))
    if not (solution.converged and usable.any() and above_rounding(rms, target.size)):
        return None
    which, steps = task.unknowns.which[usable], solution.steps[usable]
    sensitivity = np.nan_to_num(solution.problem.sensitivity(solution.values, which, steps))
    bread = inverse_normal(near.informed[:, usable], SINGULAR**-0.5)
    return discrepancy_of(target, solution, sensitivity, bread, near.measured)


def _with_discrepancy(errors: Errors, found: Discrepancy, usable: Mask) -> Errors:
    """Errors with those of the discrepancy; the random ones are from the noise that remains beside it."""
    known = usable & np.isfinite(np.diag(errors.covariance))
    shifts, covariance = np.full((len(found.shifts), usable.size), np.nan), errors.covariance.copy()
    shifts[:, known] = found.shifts[:, known[usable]]
    covariance[np.ix_(known, known)] = found.random[np.ix_(known[usable], known[usable])]
    return replace(errors, covariance=covariance, systematic={**errors.systematic, SOURCE: shifts})


def _with_unseen_drag(errors: Errors, shift: Array | None) -> Errors:
    """Errors with that of a drag which is not in the equation; NaN where a value is undetermined."""
    if shift is None:
        return errors
    known = np.where(np.isfinite(np.diag(errors.covariance)), shift, np.nan)
    return replace(errors, systematic={**errors.systematic, UNSEEN_DRAG: known})


@dataclass(frozen=True, slots=True)
class Lacking:
    """What the equation may lack and the errors then allow for.

    ``discrepancy``: whatever the residual shows where it is autocorrelated; ``drag``: that which a fall does not show.
    """

    discrepancy: bool
    drag: bool


def conclude(
    task: PreparedFit,
    target: Target,
    solution: Solution,
    notes: list[str],
    lacking: Lacking,
    near: Linearised | None = None,
) -> FitResult:
    """Judge the solution and build the result with errors, criteria, status and notes.

    Parameters
    ----------
    task, target, solution
        The prepared fit, the samples used with their weights, and the solution.
    notes
        What a reader should know beside the status.
    lacking
        What of the equation's gaps to look for.
    near
        The fit near the solution; linearised here if None.
    """
    near = linearise(task, target, solution) if near is None else near
    touching = at_bounds(task.unknowns, solution.values)
    determined = _determination(near, ~touching)
    errors, random = errors_of(task, near, ~touching, determined.undetermined)
    residual = target.observed - solution.predicted
    rms = np.sqrt(np.mean(residual[target.used] ** 2, axis=0))
    # so far above the noise that no autocorrelation explains it, even where few samples do not tell by their form
    beyond = is_misfit(rms, task.noise, target.size)
    suspected = lacking.discrepancy and (beyond or any(process.partial.size for process in random.noise))
    found = _discrepancy(task, target, solution, near, ~touching) if suspected else None
    stated = errors
    if found is not None and (found.significant or beyond):
        notes = [*notes, DISCREPANCY_NOTE]
        stated = _with_discrepancy(errors, found, ~touching)  # drag is among its forms
    elif lacking.drag:
        stated = _with_unseen_drag(stated, unseen_drag(task, target, solution, near.flat, ~touching))
    results = estimate_all(task, solution.values, stated)
    notes = [*notes, *_unseen_drag_note(task, results), *energy_gains(task.model, results.estimates)]
    misfit = beyond or (found is not None and found.misfit)
    status, problems = _status(task, solution, touching, determined, rms if misfit else None)
    measured = with_priors(task.unknowns, task.priors)
    pulls = measured.prior_residual(solution.values)
    aic, bic = criteria(near.residual, target.sigma[target.used], len(task.free), pulls)
    return FitResult(
        model=task.model,
        status=status,
        estimates=results.estimates,
        free=task.free,
        covariance=errors.covariance + _from_priors(task, errors),
        total_covariance=stated.total,
        t_s=task.trajectory.t_s,
        used=_spread(task, target.used, False).astype(np.bool_),
        predicted=_spread(task, target.observed - residual, np.nan),
        residual=_spread(task, np.where(target.used[:, None], residual, np.nan), np.nan),
        noise=task.noise,
        rms=rms,
        aic=aic,
        bic=bic,
        jacobian=near.flat * np.repeat(target.sigma[target.used].ravel()[:, None], len(task.free), axis=1),
        fisher=fisher_information(near) + measured.prior_rows.T @ measured.prior_rows,
        condition=determined.condition,
        correlation=_lag_one(near.residual),
        t0_s=float(solution.problem.t_s[0]),
        prior_rows=task.unknowns.prior_rows,
        prior_residual=task.unknowns.prior_residual(solution.values),
        budget=results.budget,
        identifiability=_identifiability(task, target, solution, near, determined),
        origin={
            **task.trajectory.origin,
            "rhs_note": solution.problem.rhs.note,
            "hold": solution.problem.hold,
            "residual_autoregression": [process.coefficients.tolist() for process in random.noise],
            "residual_innovation_sd": [process.innovation_sd for process in random.noise],
        },
        problems=problems,
        notes=tuple(filter(None, [*notes, unknown_text(task, results.estimates)])),
        doubts=(*task.trajectory.doubts, *_gravity_doubts(task, results)),
    )


def energy_gains(model: OdeModel, estimates: Mapping[str, Estimate]) -> list[str]:
    """What it means that a damping of a model is surely below zero, one sentence for each that is.

    Parameters
    ----------
    model
        What was fitted.
    estimates
        Of its parameters, by name.
    """
    dampings = {parameter.name: estimates[parameter.name] for parameter in model.with_role("damping")}
    return [
        f"{name} is {damping.value:.2g} ± {damping.stderr:.1g} {damping.unit}; a negative damping adds energy: "
        "the loss has another form than in the equation, or something drives the motion"
        for name, damping in dampings.items()
        if damping.interval[1] < 0.0
    ]


def _unseen_drag_note(task: PreparedFit, results: Budget) -> list[str]:
    """What a reader should know where drag that is not seen is the largest error of gravity."""
    names = [parameter.name for parameter in task.model.with_role("gravity") if parameter.name in results.budget]
    parts = [results.budget[name] for name in names]
    most = any(part.get(UNSEEN_DRAG, 0.0) > part[RANDOM] for part in parts)
    return [f"the errors include {UNSEEN_DRAG}"] if most else []


def _gravity_doubts(task: PreparedFit, results: Budget) -> tuple[Doubt, ...]:
    """What the gravity of the Earth says of an estimated one; nothing where its value was given as a prior."""
    names = [parameter.name for parameter in task.model.with_role("gravity") if parameter.name in task.free]
    found = [
        earth_gravity_doubt(results.estimates[name], results.budget[name].get(UNSEEN_DRAG, 0.0))
        for name in names
        if name not in task.priors
    ]
    return tuple(doubt for doubt in found if doubt is not None)


def _determination(near: Linearised, usable: Mask) -> Determination:
    """The null directions of the values that are not at a bound, as vectors over all free values."""
    part = determination(near.informed[:, usable])
    null = np.zeros((part.null.shape[0], usable.size))
    null[:, usable] = part.null
    undetermined = np.zeros(usable.size, dtype=np.bool_)
    undetermined[usable] = part.undetermined
    return Determination(part.condition, null, undetermined)


def information_loss(near: Linearised) -> float:
    """Effective variance of the noise for the free values, in units of sigma squared: larger for correlated noise.

    The mean ratio of the middle of the sandwich to the information, trace(B J' Gamma J) / trace(B J'J) with
    B = (J'J + priors)^-1; NaN when there is no information.
    """
    flat = near.flat
    bread = inverse_normal(near.informed, SINGULAR**-0.5)
    random = random_uncertainty(near.t_s, near.residual, near.sensitivity, bread, near.measured, near.stated)
    information = float(np.einsum("ij,ij->", flat @ bread, flat))
    middle = near.informed.T @ near.informed @ random.covariance
    return float(np.trace(middle)) / information if information > 0 else float("nan")


def _identifiability(
    task: PreparedFit, target: Target, solution: Solution, near: Linearised, determined: Determination
) -> Identifiability:
    values = solution.values[task.unknowns.which]
    order = 2 if task.model.second_order else 1
    residual = np.where(target.used[:, None], target.observed - solution.predicted, np.nan)
    return Identifiability(
        names=task.free,
        condition=determined.condition,
        undetermined=tuple(null_direction_text(task.free, values, row) for row in determined.null),
        weakest=weakest_text(task.free, near.informed),
        gradients=solution.gradients,
        ode_residual=ode_residual(residual, order),
        ode_residual_noise=task.noise**2 * NOISE_GAIN[order],
    )


def ode_residual(residual: Array, order: int) -> Array:
    """Mean squared error (d,) of one step of the fitted equation from sample to sample, in squared units.

    The IRIS benchmark's R, the mean of |z[t+1] - P(z[t])|^2 with P the fitted step. A second-order equation steps
    from a position and its backward difference, so the error is that of z[t+1] - 2 z[t] + z[t-1] less the
    acceleration; the fitted motion z - e has none, and the residual of the step is the difference of order ``order``
    of the residual e (n, d), up to terms of (rate * step)^2 of it. NaN marks samples that are not used.
    """
    step = np.diff(residual, n=order, axis=0)
    known = np.all(np.isfinite(step), axis=1)
    return np.asarray(np.mean(step[known] ** 2, axis=0)) if known.any() else np.full(residual.shape[1], np.nan)


def _status(
    task: PreparedFit, solution: Solution, touching: Mask, determined: Determination, misfit: Array | None
) -> tuple[FitStatus, tuple[FitProblem, ...]]:
    """The status and its reasons; ``misfit`` (d,) is the residual where it is far above the noise."""
    singular = bool(determined.undetermined.any())
    status = status_of(
        converged=solution.converged, singular=singular, touching=bool(touching.any()), misfit=misfit is not None
    )
    problems = []  # in the order of status_of
    if not solution.converged:
        problems.append(not_converged(task, solution))
    if singular:
        problems.append(undetermined(task, solution.values, determined))
    if touching.any():
        problems.append(at_its_bound(task, solution.values, touching))
    if misfit is not None:
        problems.append(residual_above_noise(task, misfit, task.noise))
    return status, tuple(problems)


def _from_priors(task: PreparedFit, errors: Errors) -> Array:
    """Covariance (k, k) of the free values that comes from the errors of their priors."""
    shifts = [shift for name, shift in errors.systematic.items() if name in task.priors]
    return np.asarray(sum((np.outer(shift, shift) for shift in shifts), np.zeros(errors.covariance.shape)))


def criteria(residual: Array, sigma: Array, n_free: int, pulls: Array = NO_PULLS) -> tuple[float, float]:
    """Akaike's and the Bayesian criterion for normal white noise of unknown size in each quantity.

    -2 log L = sum over quantities of n (log(2 pi s^2) + 1) + 2 sum log sigma, with s^2 the mean square of the
    residual; every quantity's s counts as a parameter. A prior is one more sample.

    Parameters
    ----------
    residual
        (n, d) in units of ``sigma``.
    sigma
        (n, d) relative standard errors of the samples, dimensionless.
    n_free
        Number of fitted values.
    pulls
        (j,) distances of estimates from their priors, in standard errors of the priors.
    """
    n, d = residual.shape
    with np.errstate(all="ignore"):
        square = np.maximum(np.mean(residual**2, axis=0), 1e-300)
        minus_two_log = float(n * np.sum(np.log(2 * np.pi * square) + 1) + 2 * np.sum(np.log(sigma)))
    minus_two_log += float(pulls @ pulls)
    count = n_free + d
    return minus_two_log + 2 * count, minus_two_log + count * float(np.log(n * d + pulls.size))


def fisher_information(near: Linearised) -> Array:
    """Fisher information (k, k) of the free values for white noise of the size of the residual.

    Entries are in one per the product of the two values' units.
    """
    n, d, k = near.sensitivity.shape
    square = np.sum(near.residual**2, axis=0) / max(n - k / d, 1)
    weighted = near.sensitivity / np.sqrt(np.maximum(square, 1e-300))[None, :, None]
    return np.asarray(np.einsum("ndi,ndj->ij", weighted, weighted))


def _lag_one(residual: Array) -> float:
    """Autocorrelation of the residual (n, d) from one sample to the next, mean over the quantities."""
    power = np.maximum(np.sum(residual**2, axis=0), 1e-300)
    return float(np.mean(np.sum(residual[1:] * residual[:-1], axis=0) / power))


def _spread(task: PreparedFit, values: Array | Mask, fill: float) -> Array:
    """Values over the fitted span, spread over all samples of the trajectory."""
    spread = np.full((task.trajectory.n, *values.shape[1:]), fill)
    spread[task.selection.span] = values
    return spread


def failed(
    trajectory: Trajectory, model: OdeModel, known: Mapping[str, Estimate], status: FitStatus, problem: FitProblem
) -> FitResult:
    """The result of a failed fit: NaN everywhere, and a problem with its remedy.

    Parameters
    ----------
    trajectory, model
        The data and the model.
    known
        Values held; they are kept.
    status, problem
        The status, and the problem with its remedy.
    """
    n, d = trajectory.n, len(model.observed)
    free = tuple(name for name in value_names(model) if name not in known)
    k = len(free)
    units = {p.name: p.unit for p in model.parameters} | {f"{s.name}_0": s.unit for s in model.states}
    nothing = {name: Estimate(np.nan, np.nan, units[name], "fitted", ci95=(np.nan, np.nan)) for name in free}
    derived = {q.name: Estimate(np.nan, np.nan, q.unit, "derived", ci95=(np.nan, np.nan)) for q in model.derived}
    estimates = {name: known.get(name, nothing.get(name)) for name in value_names(model)}
    return FitResult(
        model=model,
        status=status,
        estimates={name: estimate for name, estimate in estimates.items() if estimate is not None} | derived,
        free=free,
        covariance=np.full((k, k), np.nan),
        t_s=trajectory.t_s,
        used=np.zeros(n, dtype=np.bool_),
        predicted=np.full((n, d), np.nan),
        residual=np.full((n, d), np.nan),
        noise=np.full(d, np.nan),
        rms=np.full(d, np.nan),
        aic=np.nan,
        bic=np.nan,
        jacobian=np.empty((0, k)),
        fisher=np.full((k, k), np.nan),
        condition=np.nan,
        correlation=np.nan,
        t0_s=float(trajectory.t_s[0]),
        problems=(problem,),
        doubts=trajectory.doubts,
    )
