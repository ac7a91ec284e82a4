"""The ODE engine: fit a model to a measured trajectory, with errors that allow for autocorrelation and known values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from fitters.integrator.initial_value_problem import InitialValueProblem, value_names
from fitters.noise.measurement_noise import outliers_in_motion, outliers_in_residual
from fitters.noise.sandwich_covariance import quantile_975
from fitters.ode.fit_problem import (
    PreparedFit,
    guesses,
    starting_values,
    with_priors,
    without_start,
)
from fitters.ode.global_search import explains, grow, is_lost, scattered_starts, search
from fitters.ode.gradient_matching import matched_starts
from fitters.ode.intervals import Found, Method, checked_methods, disagreements, intervals_by
from fitters.ode.known_inputs import gaps_of_inputs
from fitters.ode.least_squares import (
    COMPARING,
    FINE,
    ROUGH,
    Accuracy,
    Loss,
    Solution,
    Target,
    Unknowns,
    minimise,
    reweighted,
)
from fitters.ode.multiple_shooting import PiecewiseFit, shot_in_pieces
from fitters.ode.prepared_request import NoMinimumError, no_minimum, task_of
from fitters.ode.request import DEFAULT_OPTIONS, NOTHING, FitOptions, FitRequest
from fitters.ode.rest_position import calls_for_rest, held_zeros, is_better
from fitters.ode.result import Lacking, conclude, errors_of, information_loss, linearise
from fitters.ode.status import at_bounds, diverged
from fitters.own_model.ties import stated_by
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.registry import MODELS
from iris_sysid.trajectory.consistency.angle_unit import short_pendulum_doubt
from iris_sysid.types import (
    Array,
    Estimate,
    FitResult,
    OdeModel,
    Trajectory,
)

if TYPE_CHECKING:
    import lmfit

PATIENCE = 500_000, 50  # samples evaluated, and least evaluations, before a local fit is abandoned
HELD = 1e3  # weight at which a prior holds its value
LOST = "no start led to the data, and where the search ended some values have no effect of their own"
ALIKE = 1.1  # residual of a free run over that of pieces, up to which it follows the data as well
UNSURE = ("singular", "not-converged")  # a run that grows by 1e12 seems to determine no initial state
PRIOR_ROUNDS, SETTLED = 4, 0.02  # fits with a new weight of the priors, and its last relative change
MIN_DEVIATION = 3.0  # in units of the noise, for a sample to count as an outlier


@on_one_thread
def fit(
    trajectory: Trajectory,
    model: str | OdeModel,
    *,
    fixed: Mapping[str, float | Estimate] = NOTHING,
    free: Sequence[str] = (),
    start: Mapping[str, float] = NOTHING,
    uncertainty: Sequence[str] = ("robust",),
    options: FitOptions = DEFAULT_OPTIONS,
    parameters: lmfit.Parameters | None = None,
) -> FitResult:
    """Fit a model to a measured trajectory, by shooting with a growing horizon.

    The prediction is the solution of the equation itself from its initial states on; nothing is differentiated.
    Standard errors allow for autocorrelated residuals; errors of known values are propagated and kept apart in
    ``budget``.

    Parameters
    ----------
    trajectory
        Measured positions; only valid samples inside the chosen segments are used, and never the smoothed ones.
        ``sigma`` gives relative weights, the size of the noise is estimated. Its ``geometry`` gives the model's
        constants of the same name, e.g. ``angle``, and the error of ``scale``.
    model
        The governing equation, or the name of a registered one. Everything that is not a constant is estimated, and
        so are the initial states ``<state>_0``, which hold at the first sample used. The position in which an
        oscillation rests is a constant, 0, and is estimated as well where the data call for it.
    fixed
        Values to hold, by name; an Estimate's standard error is propagated.
    free
        Constants to estimate as well, e.g. ``("gravity",)``. A name that is also in ``fixed``, with a standard error,
        has that as a normal prior: it takes part in the fit, and its share of each error is kept apart in ``budget``.
    start
        Starting values by name, tried before the model's own guess.
    uncertainty
        Methods for the 95 % intervals of the random error in ``intervals``: ``robust`` (linearised, allowing for
        autocorrelation, as the estimates have it), ``profile`` (likelihood), ``bootstrap`` (of residuals in blocks),
        or ``all``. The notes say where they disagree.
    options
        Which segments to use, the loss function, how long to search.
    parameters
        lmfit ``Parameters`` by the model's names: values are starts, or held where ``vary`` is false; ``min`` and
        ``max`` are bounds; ``expr`` ties a parameter to others, which is then among the derived quantities. What
        ``fixed``, ``free`` and ``start`` say counts more.

    Returns
    -------
    FitResult
        With ``status``, ``reason`` and ``remedy``. A fit that fails is a result with NaN, never an exception.

    Raises
    ------
    FitError
        When the call is inconsistent: a quantity or an input that is missing or in another unit, an
        unknown name or interval method, an exact value both fixed and free, a right-hand side that does not return
        one number a state.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, fit, simulate
    >>> pendulum, t_s = MODELS["pendulum"], np.arange(300) / 60
    >>> truth = {"length": 0.5, "damping": 0.1, "theta_0": 0.8, "omega_0": 0.0}
    >>> theta = simulate(pendulum, t_s, truth).observed
    >>> theta += 1e-3 * np.random.default_rng(0).standard_normal(theta.shape)
    >>> clip = Trajectory(t_s, pendulum.observed, theta, np.full_like(theta, np.nan), np.ones(300, bool))
    >>> result = fit(clip, "pendulum")
    >>> result.status
    'ok'
    >>> length = result.estimates["length"]
    >>> f"{length.value:.3f} {length.unit}"
    '0.500 m'
    """
    chosen = MODELS.resolved(model)
    if parameters is not None:
        stated = stated_by(parameters, chosen)
        chosen, free = stated.model, (*stated.free, *free)
        fixed, start = {**stated.fixed, **fixed}, {**stated.start, **start}
    taken, remark = chosen.taken_from(trajectory)
    request = FitRequest.stated(taken, chosen, fixed, free)
    result = _about_its_rest(request.with_(start=start, uncertainty=uncertainty, options=options), free)
    doubts = (*result.doubts, *short_pendulum_doubt(result.estimates, chosen))
    return replace(result, notes=(*result.notes, *filter(None, [remark])), doubts=doubts)


def _about_its_rest(request: FitRequest, asked: Sequence[str]) -> FitResult:
    """The fit, with its rest position estimated where nobody stated it and the data call for it."""
    result = solve(request)
    if calls_for_rest(result):
        _, result = with_rest(request, result)
    rests = held_zeros(request.trajectory, request.model, asked)
    freed = [name for name in rests if name in result.free]
    note = f"the motion is not about zero: {', '.join(freed)} is estimated as well"
    return replace(result, notes=(*result.notes, note)) if freed else result


def with_rest(request: FitRequest, held: FitResult) -> tuple[FitRequest, FitResult]:
    """A request and its fit with the rest positions estimated that nobody stated, where that is better; or as it was.

    ``held`` is the fit of the request, which takes zero for them.
    """
    names = held_zeros(request.trajectory, request.model, {*request.fixed, *request.free})
    if not names:
        return request, held
    freed = request.with_(free=[*request.free, *names])
    moved = solve(freed)
    return (freed, moved) if is_better(moved, held, names) else (request, held)


def solve(request: FitRequest) -> FitResult:
    """Fit a request; see :func:`fit`."""
    checked_methods(request.uncertainty)
    try:
        minimum = find_minimum(request)
    except NoMinimumError as error:
        return _by_pieces(request) or error.result
    result, lost = _concluded(request, minimum), not explains(minimum.solution, minimum.target)
    pieced = _by_pieces(request) if lost or result.status in UNSURE else None
    return result if pieced is None or (not lost and pieced.status in UNSURE) else pieced


def _concluded(request: FitRequest, minimum: Minimum) -> FitResult:
    """The result of a minimum, with intervals by the methods asked for."""
    methods, options = checked_methods(request.uncertainty), request.options
    with np.errstate(all="ignore"):  # meaningless data give unbounded errors: they become infinite
        notes = _notes(minimum.task, minimum.target)
        lacking = Lacking(options.discrepancy, options.discrepancy and options.unseen_drag)
        result = conclude(minimum.task, minimum.target, minimum.solution, notes, lacking)
        return result if methods == ("robust",) else _with_intervals(minimum, result, methods)


def _by_pieces(request: FitRequest) -> FitResult | None:
    """The fit by multiple shooting, or by the free run from its values where one follows the data as well."""
    shot = None if request.options.local else shot_in_pieces(request)
    if shot is None:
        return None
    try:
        run = find_minimum(request.with_(start=shot.start, options=replace(request.options, local=True)))
    except NoMinimumError:
        return _of_pieces(shot, request)
    follows = run.solution.rms < ALIKE * shot.solution.rms and _exact(run.solution, run.target)
    result = _concluded(request, run) if follows else None
    return _of_pieces(shot, request) if result is None or result.status == "singular" else result


def _of_pieces(shot: PiecewiseFit, request: FitRequest) -> FitResult:
    """The result of multiple shooting; intervals by other methods need a free run."""
    task, robust = shot.pieces.task, tuple(request.uncertainty) == ("robust",)
    notes = [*_notes(task, task.target), shot.note, *([] if robust else ["intervals by the robust method alone"])]
    with np.errstate(all="ignore"):
        return conclude(task, task.target, shot.solution, notes, Lacking(False, False), shot.near)


@dataclass(frozen=True, eq=False, slots=True)
class Minimum:
    """A fit before it is judged: the task, the samples used with their weights, and the solution."""

    task: PreparedFit
    target: Target
    solution: Solution


@dataclass(frozen=True, slots=True)
class _Refinement:
    """How a fit is finished: ``loss`` and ``accuracy`` as for :func:`fitters.ode.least_squares.minimise`."""

    loss: Loss
    accuracy: Accuracy

    def continued(self, problem: InitialValueProblem, target: Target, unknowns: Unknowns, before: Solution) -> Solution:
        """The least squares from where an earlier solution ended."""
        return minimise(
            problem,
            target,
            unknowns,
            before.values,
            accuracy=self.accuracy,
            loss=self.loss,
            steps=before.steps,
            gradients=before.gradients,
        )


def find_minimum(request: FitRequest) -> Minimum:
    """Minimise the residual of a request, with outliers left out and priors weighted.

    Raises
    ------
    NoMinimumError
        When there are too few samples, or the solution is not finite.
    FitError
        As for :func:`fit`.
    """
    task = task_of(request)
    if not task.free:
        return Minimum(task, task.target, _nothing_to_fit(task))
    options = request.options
    if options.local:
        solution = _downhill(task, request)
    else:
        solution = search(task.problem, task.target, task.unknowns, _starts(task, request.start, options.multistart))
    _check_finite(request, task, solution)
    refinement = _Refinement(options.loss, _accuracy(options, int(task.selection.used.sum())))
    target = task.target
    if refinement.accuracy.fine:  # models are compared on the same samples, whatever their residual
        target, solution = _without_outliers(task, solution, refinement)
    if task.priors:
        task, solution = _with_priors_weighed(task, target, solution, refinement)
    _check_finite(request, task, solution)  # the refinement can diverge from a solution that was finite
    if options.loss != "linear":
        target = reweighted(target, solution)
    if not options.local and solution.converged and is_lost(solution, target, task.unknowns):
        solution = replace(solution, converged=False, message=LOST)
    return Minimum(task, target, solution)


def _accuracy(options: FitOptions, samples: int) -> Accuracy:
    """With what a fit ends; a local one is abandoned earlier where there are many samples."""
    if not options.local:
        return FINE
    if _is_rough(options):
        return COMPARING
    return FINE._replace(evaluations=min(max(PATIENCE[0] // samples, PATIENCE[1]), FINE.evaluations))


def _is_rough(options: FitOptions) -> bool:
    return options.rough and options.local and options.loss == "linear"


def _check_finite(request: FitRequest, task: PreparedFit, solution: Solution) -> None:
    if not np.isfinite(solution.rms):
        raise no_minimum(request, task.model, task.known, "diverged", diverged(task, solution))


def _downhill(task: PreparedFit, request: FitRequest) -> Solution:
    """Fit all samples from the start given alone; the first of them first, if asked for."""
    values = next(starting_values(task, request.start, guesses(task, request.start)))
    accuracy = COMPARING if _is_rough(request.options) else ROUGH
    if request.options.growing:
        return grow(task.problem, task.target, task.unknowns, values, accuracy)
    return minimise(task.problem, task.target, task.unknowns, values, accuracy=accuracy)


def _starts(task: PreparedFit, start: Mapping[str, float], multistart: int) -> Iterator[tuple[Array, bool]]:
    """Starts in the order of trust, each with whether it is trusted; the last are random ones about the one before."""
    values, guessed = np.zeros(0), guesses(task, start)
    for values in _matched(task, start, guessed):
        yield values, True
    for values in starting_values(task, start, guessed):
        yield values, True
    for scattered in scattered_starts(task.unknowns, values, task.target, multistart):
        yield scattered, False


def _matched(task: PreparedFit, start: Mapping[str, float], guessed: Mapping[str, float] | None) -> Iterator[Array]:
    """Starts by gradient matching, where some parameters have no other."""
    names = without_start(task, start, guessed)
    if not names:
        return
    problem, used = task.problem, task.target.used
    first, given = next(starting_values(task, start, guessed)), [name in start for name in value_names(task.model)]
    samples = problem.t_s[used], task.target.observed[used]
    for matched in matched_starts(problem, *samples, task.unknowns.only(names), first):
        yield np.where(given, first, matched)


def _with_intervals(minimum: Minimum, result: FitResult, methods: tuple[Method, ...]) -> FitResult:
    """The result with intervals by several methods, and notes on their disagreements."""
    task, target, solution = minimum.task, minimum.target, minimum.solution
    near = linearise(task, target, solution)
    touching = at_bounds(task.unknowns, solution.values)
    usable = ~touching & np.isfinite(np.diag(result.covariance))
    if not usable.any():
        return result
    random = errors_of(task, near, ~touching, ~usable)[1]
    quantile = np.full(usable.size, np.nan)
    quantile[~touching] = [quantile_975(degrees) for degrees in random.degrees]
    optimum = Found(task, target, solution, near, result.covariance, quantile, usable, random.noise)
    intervals = intervals_by(optimum, ("robust", *(method for method in methods if method != "robust")))
    return replace(result, intervals=intervals, notes=(*result.notes, *disagreements(intervals)))


def _nothing_to_fit(task: PreparedFit) -> Solution:
    """The prediction of values that are all known, judged like a fit."""
    vector = np.array([task.known[name].value for name in value_names(task.model)])
    problem = task.problem.planned(vector, FINE.time_step)
    return Solution(problem, vector, problem.predicted(vector), np.zeros(0), 1.0, True, True, "")


def _without_outliers(task: PreparedFit, solution: Solution, refinement: _Refinement) -> tuple[Target, Solution]:
    """Finish the fit and reselect the samples: outliers are removed, good samples are restored."""
    candidates = task.selection.used[task.selection.span]
    target = task.target
    spikes = outliers_in_motion(task.problem.t_s[candidates], target.observed[candidates])
    for _ in range(4):
        outliers = np.zeros_like(candidates)
        if explains(solution, target):
            residual = (target.observed - solution.predicted) / target.sigma
            outliers[candidates] = outliers_in_residual(residual[candidates], MIN_DEVIATION, spikes)
        if solution.fine and _exact(solution, target) and np.array_equal(candidates & ~outliers, target.used):
            break
        target = Target(target.observed, target.sigma, candidates & ~outliers)
        solution = refinement.continued(task.problem, target, task.unknowns, solution)
    return target, solution


def _exact(solution: Solution, target: Target) -> bool:
    """Whether the time steps are short enough for the fitted values: those chosen for them predict the same."""
    problem, values = solution.problem, solution.values
    events = bool(problem.model.events)
    anew = problem.halved() if events else problem.planned(values, FINE.time_step, target.negligible)
    with np.errstate(all="ignore"):
        finer = anew.predicted(values)
        size = np.max(np.abs(finer), axis=0, initial=0.0)
        error = np.max(np.abs(solution.predicted - finer) / np.where(size > 0, size, 1.0), initial=0.0)
    return bool(error < max(10 * FINE.time_step, 0.0 if events else target.negligible))


def _with_priors_weighed(
    task: PreparedFit, target: Target, solution: Solution, refinement: _Refinement
) -> tuple[PreparedFit, Solution]:
    """Weight the priors against the information of the data, which is smaller for large or correlated noise.

    Least squares treats all samples as independent; the mean ratio of the sandwich's information to that of least
    squares corrects it. The first weight is that of the fit with the priors held: where the equation lacks an effect,
    what was measured must not move to imitate it, and then call the residual small.
    """
    plain = with_priors(task.unknowns, task.priors)
    factor = HELD
    for _ in range(PRIOR_ROUNDS):
        weighed = plain.weighing_priors(factor)
        before, task = solution, replace(task, unknowns=weighed)
        solution = refinement.continued(before.problem, target, weighed, before)
        previous, factor = factor, float(np.sqrt(information_loss(linearise(task, target, solution))))
        if not (np.isfinite(factor) and factor > 0) or abs(factor - previous) < SETTLED * previous:
            break
    return task, solution


def _notes(task: PreparedFit, target: Target) -> list[str]:
    """Notes for the reader, in addition to the status."""
    candidates = task.selection.used[task.selection.span]
    left_out_s = task.problem.t_s[candidates & ~target.used]
    inputs = gaps_of_inputs(task.trajectory, task.model, task.selection.span)
    notes = [task.selection.note, task.problem.rhs.note, inputs, *task.trajectory.origin.get("clipped_readings", ())]
    if left_out_s.size:
        times = ", ".join(f"{t:.4g}" for t in left_out_s[:5]) + (", ..." if left_out_s.size > 5 else "")
        share = f"{left_out_s.size} of {int(candidates.sum())} samples"
        notes.append(f"{share} are outliers and were left out (t = {times} s)")
    return [note for note in notes if note]
