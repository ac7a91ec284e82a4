"""Fit one model to several clips at once: values that all share, and values that scatter from clip to clip."""

from __future__ import annotations

from collections.abc import Collection, Container, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitters.noise.random_effects import MIN_CLIPS, random_effects
from fitters.noise.sandwich_covariance import MAX_DEGREES, random_uncertainty
from fitters.ode.fit_problem import check_names
from fitters.ode.prepared_request import NoMinimumError
from fitters.ode.request import DEFAULT_OPTIONS, NOTHING, FitOptions, FitRequest
from fitters.ode.rest_position import held_zeros, off_zero
from fitters.ode.result import Linearised, information_loss, linearise
from fitters.ode.single_clip import find_minimum, solve
from fitters.ode.unseen_drag import STANDARD_GRAVITY, UNSEEN_DRAG, drag_response, prior_of, root_mean_square
from iris_sysid.errors import FitError
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.registry import MODELS
from iris_sysid.trajectory.consistency.earth_gravity import earth_gravity_doubt
from iris_sysid.types import (
    Array,
    Doubt,
    Estimate,
    FitResult,
    FitStatus,
    OdeModel,
    PooledFit,
    Population,
    Trajectory,
    student_ppf,
)

ROUNDS = 12  # Gauss-Newton steps of the shared values; three are enough where the fit is nearly linear
DONE = 1e-3  # fraction of a standard error: a smaller step ends the search
UNLIKELY = 0.01  # probability below which shared values differ significantly
STATUSES: tuple[FitStatus, ...] = ("singular", "at-bound", "misfit", "not-converged", "diverged", "too-short")


@dataclass(frozen=True, eq=False, slots=True)
class _View:
    """The information of one clip on the s shared values, with its own values fitted.

    ``near`` has the sensitivities to them, orthogonal to those to its own values; ``weight`` is one over the effective
    variance of its noise for them; ``known`` by name (r, n * d): response to one standard error of a known
    value (r = 1), or of each pattern of a source. ``drag`` (n * d,) is the response to one that the equation of a fall
    lacks, also orthogonal to the values of the clip alone (``own`` is their number); None for other motions.
    """

    near: Linearised
    weight: float
    known: Mapping[str, Array]
    sum_of_squares: float
    drag: Array | None
    own: int


@on_one_thread
def fit_clips(
    trajectories: Sequence[Trajectory],
    model: str | OdeModel,
    *,
    shared: Sequence[str] = (),
    per_clip: Sequence[str] = (),
    fixed: Mapping[str, float | Estimate] = NOTHING,
    free: Sequence[str] = (),
    start: Mapping[str, float] = NOTHING,
    options: FitOptions = DEFAULT_OPTIONS,
) -> PooledFit:
    """Fit one model to several clips: shared values from all of them, the others clip by clip.

    Shared values minimise the sum of the clips' squared residuals, each clip weighed by its own noise (Gauss-Newton on
    the values that are left when each clip's own ones follow). Every other parameter is a random draw for each clip:
    its mean over the clips and its scatter between them are estimated apart from the error within a clip.

    Parameters
    ----------
    trajectories
        The clips, two at least.
    model
        The governing equation, or the name of a registered one.
    shared
        Parameters that are the same in all clips; a constant named here is estimated.
    per_clip
        Parameters that differ without being random draws, e.g. an angle that was set: no mean is given. Initial
        states always belong here.
    fixed, free, start
        As for :func:`fitters.ode.fit`, the same for all clips. A value in ``fixed`` is one and the same in all clips,
        and so is its error.
    options
        As for :func:`fitters.ode.fit`.

    Returns
    -------
    PooledFit
        ``status`` is the most serious of the clips', and the message says which clips it is about.

    Raises
    ------
    FitError
        With fewer than two clips, for an unknown name, or one that is both shared and not.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, fit_clips, simulate
    >>> fall, t_s, rng = MODELS["free-fall"], np.arange(40) / 60, np.random.default_rng(0)
    >>> clips = []
    >>> for z_0 in (1.0, 1.2, 1.4):
    ...     z = simulate(fall, t_s, {"gravity": 9.81, "z_0": z_0, "vz_0": 0.0}).observed
    ...     z += 1e-3 * rng.standard_normal(z.shape)
    ...     clips.append(Trajectory(t_s, fall.observed, z, np.full_like(z, np.nan), np.ones(40, bool)))
    >>> pooled = fit_clips(clips, fall, shared=["gravity"])
    >>> f"{pooled.shared['gravity'].value:.1f}"
    '9.8'
    """
    model = MODELS.resolved(model)
    trajectories = [model.taken_from(trajectory)[0] for trajectory in trajectories]
    _check(trajectories, model, shared, per_clip, fixed)
    freed = [*_free(free, shared, model), *_rests(trajectories, model, {*fixed, *free, *shared})]
    per_clip = [*per_clip, *(name for trajectory in trajectories for name in trajectory.free if name not in shared)]
    requests = [
        FitRequest.stated(_without(trajectory, shared), model, fixed, freed).with_(start=start, options=options)
        for trajectory in trajectories
    ]
    alone = [solve(request) for request in requests]
    if not any(clip.usable for clip in alone):
        return _pooled(model, alone, {}, {}, {}, np.full((len(shared), len(shared)), np.nan), {})
    scatter = _populations(alone, shared)
    if not shared:
        others = _others(alone, (), per_clip)
        return _pooled(model, alone, {}, {}, _populations(alone, others), np.zeros((0, 0)), {})
    own = [request.with_(free=[name for name in request.free if name not in shared]) for request in requests]
    usable = [(request, clip) for request, clip in zip(own, alone, strict=True) if clip.usable]
    values, views = _joint(usable, shared)
    prior = _drag_prior(trajectories[0], model, shared, values)
    covariance, estimates, budget = _shared_estimates(values, views, shared, alone, prior)
    clips = [
        _held_fit(request.with_(fixed={**request.fixed, **estimates}), clip)
        for request, clip in zip(own, alone, strict=True)
    ]
    doubts = tuple(filter(None, [_gravity_doubt(name, model, estimates, budget) for name in shared]))
    clips = [replace(clip, doubts=(*clip.doubts, *doubts)) for clip in clips]
    others = _others(alone, shared, per_clip)
    return _pooled(model, clips, estimates, scatter, _populations(clips, others), covariance, budget)


def _check(
    trajectories: Sequence[Trajectory],
    model: OdeModel,
    shared: Sequence[str],
    per_clip: Sequence[str],
    fixed: Mapping[str, float | Estimate],
) -> None:
    check_names(model, shared=list(shared), per_clip=list(per_clip), fixed=list(fixed))
    if len(trajectories) < MIN_CLIPS:
        raise FitError(f"a fit over clips needs {MIN_CLIPS} of them, not {len(trajectories)}; use fit for one")
    for name in shared:
        if name in per_clip:
            raise FitError(f"{name} cannot be both shared and per clip; leave out one of the two")
        if name in fixed:
            raise FitError(f"{name} cannot be both shared and fixed; leave out one of the two")


def _without(trajectory: Trajectory, shared: Sequence[str]) -> Trajectory:
    """The trajectory that does not state the shared values."""
    return trajectory.with_(known={name: value for name, value in trajectory.known.items() if name not in shared})


def _rests(trajectories: Sequence[Trajectory], model: OdeModel, chosen: Collection[str]) -> list[str]:
    """Rest positions that nobody states, where some clip swings without passing zero."""
    names = [name for clip in trajectories if off_zero(clip, model) for name in held_zeros(clip, model, chosen)]
    return list(dict.fromkeys(names))


def _free(free: Sequence[str], shared: Sequence[str], model: OdeModel) -> list[str]:
    constants = [parameter.name for parameter in model.parameters if parameter.constant and parameter.name in shared]
    return [*free, *(name for name in constants if name not in free)]


def _others(clips: Sequence[FitResult], shared: Sequence[str], per_clip: Sequence[str]) -> list[str]:
    """Fitted parameters that are random draws from clip to clip."""
    left_out = {*shared, *per_clip, *clips[0].model.initial_names}
    return [name for name in clips[0].free if name not in left_out]


def _populations(clips: Sequence[FitResult], names: Sequence[str]) -> dict[str, Population]:
    """Scatter of each value over the clips that determine it; values with fewer than two such clips are left out."""
    populations = {}
    for name in names:
        rows = [(clip.estimates[name].value, _random(clip, name)) for clip in clips if clip.usable]
        sure = np.array([row for row in rows if np.isfinite(row[0]) and np.isfinite(row[1]) and row[1] > 0])
        if len(sure) >= MIN_CLIPS:
            population = random_effects(sure[:, 0], sure[:, 1], clips[0].estimates[name].unit)
            populations[name] = _with_common_errors(population, clips, name)
    return populations


def _random(clip: FitResult, name: str) -> float:
    """Random standard error of a value in one clip."""
    return float(clip.budget.get(name, {}).get("random", np.nan))


def _with_common_errors(population: Population, clips: Sequence[FitResult], name: str) -> Population:
    """Add the errors that all clips have in common to the mean: errors of known values do not average out."""
    sources = {source for clip in clips for source in clip.budget.get(name, {}) if source != "random"}
    parts = [np.nanmean([clip.budget[name].get(s, np.nan) for clip in clips if name in clip.budget]) for s in sources]
    stderr = float(np.hypot(population.mean.stderr, np.linalg.norm(parts)))
    half = (population.mean.interval[1] - population.mean.value) / population.mean.stderr * stderr
    interval = (population.mean.value - half, population.mean.value + half)
    mean = Estimate(population.mean.value, stderr, population.mean.unit, "fitted", population.mean.source, interval)
    return Population(mean, population.between, population.within, population.q, population.degrees, population.p_value)


# --------------------------------------------------------------------------- shared values


def _joint(usable: Sequence[tuple[FitRequest, FitResult]], shared: Sequence[str]) -> tuple[Array, list[_View]]:
    """The shared values (s,) with the smallest weighted sum of squares, and each clip's information there."""
    values = _first_values([clip for _, clip in usable], shared)
    weights: list[float] = []
    best, step = np.inf, np.asarray(np.zeros(values.size))
    views: list[_View] = []
    for _ in range(ROUNDS):
        now = [_view(request, clip, shared, values) for request, clip in usable]
        weights = weights or [view.weight for view in now]
        total = sum(weight * view.sum_of_squares for weight, view in zip(weights, now, strict=True))
        if not total <= best * (1 + 1e-9) and views:  # the step was too large: halve it
            step = step / 2
            values = values - step
            continue
        best, views = total, now
        information, pull = _normal_equations(views, weights)
        step = np.asarray(np.linalg.lstsq(information, pull, rcond=1e-12)[0])
        spread = np.sqrt(np.diag(np.linalg.pinv(information)))
        if np.all(np.abs(step) <= DONE * spread):
            break
        values = values + step
    return values, views


def _first_values(clips: Sequence[FitResult], shared: Sequence[str]) -> Array:
    """Mean of each clip's own values, weighted by their errors where they have any."""
    values = []
    for name in shared:
        rows = np.array([(clip.estimates[name].value, _random(clip, name)) for clip in clips])
        sure = rows[np.isfinite(rows[:, 1]) & (rows[:, 1] > 0)]
        weighed = np.average(sure[:, 0], weights=sure[:, 1] ** -2.0) if len(sure) else np.median(rows[:, 0])
        values.append(float(weighed))
    return np.array(values)


def _view(request: FitRequest, clip: FitResult, shared: Sequence[str], values: Array) -> _View:
    """Fit a clip's own values with the shared ones held, and project them out of the shared sensitivities."""
    units = {name: clip.estimates[name].unit for name in shared}
    # An error of any size makes the engine compute the response to a known value; it is divided out again.
    tried = dict(zip(shared, values.tolist(), strict=True))
    trial = {name: max(abs(value), 1e-3) for name, value in tried.items()}
    held = {name: Estimate(value, trial[name], units[name]) for name, value in tried.items()}
    options = request.options
    request = request.with_(fixed={**request.fixed, **held}).from_near(_own_values(clip, shared))
    try:
        minimum = find_minimum(request)
    except NoMinimumError as error:
        raise FitError(f"a clip cannot be fitted with the shared values held: {error}") from error
    near = linearise(minimum.task, minimum.target, minimum.solution)
    n, d, _ = near.sensitivity.shape
    columns = np.stack([near.known[name].ravel() / trial[name] for name in shared], axis=1)
    known = {name: response.reshape(len(response), -1) for name, response in near.known.items() if name not in shared}
    size = np.sqrt(np.sum(near.flat**2, axis=0))
    basis = np.linalg.qr(near.flat / np.where(size > 0, size, 1.0))[0]
    across = columns - basis @ (basis.T @ columns)
    seen = Linearised(
        near.t_s, near.residual, across.reshape(n, d, -1), {}, np.zeros((0, len(shared))), near.measured, near.stated
    )
    square = float(np.sum(near.residual**2))
    loss = information_loss(seen)
    drag = None
    if options.discrepancy and options.unseen_drag:
        drag = drag_response(minimum.task, minimum.target, minimum.solution, shared)
        drag = drag if drag is None else drag - basis @ (basis.T @ drag)
    weight = 1.0 / loss if np.isfinite(loss) and loss > 0 else 0.0
    return _View(seen, weight, known, square, drag, near.flat.shape[1])


def _normal_equations(views: Sequence[_View], weights: Sequence[float]) -> tuple[Array, Array]:
    """Information (s, s) and gradient (s,) of the shared values."""
    flats = [view.near.flat for view in views]
    information = sum(weight * flat.T @ flat for weight, flat in zip(weights, flats, strict=True))
    pull = sum(
        weight * flat.T @ view.near.residual.ravel() for weight, flat, view in zip(weights, flats, views, strict=True)
    )
    return np.asarray(information), np.asarray(pull)


def _shared_estimates(
    values: Array,
    views: Sequence[_View],
    shared: Sequence[str],
    alone: Sequence[FitResult],
    prior: tuple[float, float, float],
) -> tuple[Array, dict[str, Estimate], dict[str, dict[str, float]]]:
    """Covariance (s, s), estimates and budget of the shared values; the noise of the clips is independent."""
    weights = [view.weight for view in views]
    bread = np.asarray(np.linalg.pinv(_normal_equations(views, weights)[0]), dtype=np.float64)
    parts = [_one_clip(view, bread) for view in views]
    covariance = np.asarray(sum(part for part, _ in parts))
    variance = np.diag(covariance)
    spread = sum(np.diag(part) ** 2 / degrees for part, degrees in parts)  # Satterthwaite (1946)
    degrees = np.clip(variance**2 / np.maximum(spread, 1e-300), 1.0, MAX_DEGREES)
    names = sorted({name for view in views for name in view.known})
    shifts = {name: _shift([view for view in views if name in view.known], name, bread) for name in names}
    shifts |= _drag_shift(views, bread, prior)
    estimates, budget = {}, {}
    for k, name in enumerate(shared):
        part = {"random": float(np.sqrt(variance[k])), **{s: float(shift[k]) for s, shift in shifts.items()}}
        stderr = float(np.linalg.norm(list(part.values())))
        half = student_ppf(0.975, degrees[k] * (stderr / max(part["random"], 1e-300)) ** 4) * stderr
        unit, value = alone[0].estimates[name].unit, float(values[k])
        source = f"shared by {len(views)} clips"
        estimates[name] = Estimate(value, stderr, unit, "fitted", source, ci95=(value - half, value + half))
        budget[name] = part
    return covariance, estimates, budget


def _shift(views: Sequence[_View], name: str, bread: Array) -> Array:
    """Change of the shared values (s,) for one standard error of a known value, common to all clips.

    The patterns of one source have a different order in each clip, so their sizes are added, which is an upper limit.
    """
    moved = [bread @ (view.weight * view.near.flat.T @ view.known[name].T) for view in views]
    if all(shift.shape[1] == 1 for shift in moved):
        return np.asarray(np.abs(sum(moved))[:, 0])
    return np.asarray(sum(np.linalg.norm(shift, axis=1) for shift in moved))


def _gravity_doubt(
    name: str, model: OdeModel, estimates: Mapping[str, Estimate], budget: Mapping[str, Mapping[str, float]]
) -> Doubt | None:
    """What the gravity of the Earth says of a shared value; None for any other value."""
    if name not in {parameter.name for parameter in model.with_role("gravity")}:
        return None
    return earth_gravity_doubt(estimates[name], budget[name].get(UNSEEN_DRAG, 0.0))


def _drag_prior(
    trajectory: Trajectory, model: OdeModel, shared: Sequence[str], values: Array
) -> tuple[float, float, float]:
    """What is known beforehand of a drag that the falls of a body have in common, where they share gravity."""
    names = {parameter.name for parameter in model.with_role("gravity")}
    gravity = [float(value) for name, value in zip(shared, values, strict=True) if name in names]
    return prior_of(trajectory, gravity[0] if gravity else STANDARD_GRAVITY)


def _drag_shift(views: Sequence[_View], bread: Array, prior: tuple[float, float, float]) -> dict[str, Array]:
    """Change of the shared values (s,) for one standard error of a drag that all falls of a body have in common."""
    falls = [(view, view.drag, np.sqrt(view.weight)) for view in views if view.drag is not None]
    if len(falls) < len(views):
        return {}
    moves = bread @ sum(view.weight * view.near.flat.T @ drag for view, drag, _ in falls)
    residual = np.concatenate([root * view.near.residual.ravel() for view, _, root in falls])
    unseen = np.concatenate([root * (drag - view.near.flat @ moves) for view, drag, root in falls])
    count = moves.size + sum(view.own for view in views)
    return {UNSEEN_DRAG: np.abs(moves) * root_mean_square(residual, unseen, count, *prior)}


def _one_clip(view: _View, bread: Array) -> tuple[Array, Array]:
    """Contribution of one clip's noise to the covariance (s, s), and the degrees of freedom (s,) of its variances."""
    near = view.near
    uncertainty = random_uncertainty(
        near.t_s, near.residual, near.sensitivity, view.weight * bread, near.measured, near.stated
    )
    return uncertainty.covariance, uncertainty.degrees


def _held_fit(request: FitRequest, clip: FitResult) -> FitResult:
    """The clip's own values with the shared ones held; a clip that failed alone keeps its result."""
    if not clip.usable:
        return clip
    near = request.from_near(_own_values(clip, request.fixed))
    return solve(near.with_(options=replace(near.options, discrepancy=request.options.discrepancy)))


def _own_values(clip: FitResult, others: Container[str]) -> dict[str, float]:
    """The values that a clip determines itself, as a start."""
    own = {name: clip.estimates[name].value for name in clip.free if name not in others}
    return {name: value for name, value in own.items() if np.isfinite(value)}


# --------------------------------------------------------------------------- result


def _pooled(
    model: OdeModel,
    clips: Sequence[FitResult],
    shared: Mapping[str, Estimate],
    scatter: Mapping[str, Population],
    population: Mapping[str, Population],
    covariance: Array,
    budget: Mapping[str, Mapping[str, float]],
) -> PooledFit:
    status, message = _verdict(clips, scatter)
    counted = [clip for clip in clips if np.isfinite(clip.aic)]
    n = sum(clip.n * len(model.observed) for clip in counted)
    likelihood = sum(clip.aic - 2 * (len(clip.free) + len(model.observed)) for clip in counted)
    count = sum(len(clip.free) + len(model.observed) for clip in counted) + len(shared)
    return PooledFit(
        model=clips[0].model,
        status=status,
        message=message,
        shared=shared,
        scatter=scatter,
        population=population,
        clips=tuple(clips),
        covariance=covariance,
        budget=budget,
        aic=likelihood + 2 * count if counted else float("nan"),
        bic=likelihood + count * float(np.log(n)) if counted else float("nan"),
    )


def _verdict(clips: Sequence[FitResult], scatter: Mapping[str, Population]) -> tuple[FitStatus, str]:
    """The most serious status of the usable clips; failed ones are named and not part of the result."""
    usable = [clip for clip in clips if clip.usable]
    texts = [f"clip {k + 1} is {clip.status}: {clip.message}" for k, clip in enumerate(clips) if not clip.ok]
    texts += [
        f"{name} is shared, but differs between clips by more than its error: "
        f"{population.between.value:.3g} {population.mean.unit} from clip to clip, {population.within:.3g} within one "
        f"(chance {population.p_value:.1g}): leave it out of shared"
        for name, population in scatter.items()
        if population.p_value < UNLIKELY
    ]
    seen = {clip.status for clip in (usable or clips)}
    status: FitStatus = next((status for status in STATUSES if status in seen), "ok")
    return status, ". ".join(texts)
