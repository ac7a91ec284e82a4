"""One candidate for the governing equation: a model of the bank fitted to an observable, and its prediction error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fitters.compose_effects import with_effect
from fitters.integrator.event_times import event_times
from fitters.ode import FitOptions, FitRequest, simulate, solve
from fitters.ode.unseen_drag import STANDARD_GRAVITY
from fitters.selection.observables import (
    TILTED,
    UPRIGHT,
    ObservableCandidate,
    as_trajectory,
    moves_with_its_zero,
    suits,
)
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Array, Estimate, FitResult, Mask, ModelCandidate, OdeModel

FIRST_FIT_SAMPLES = 400  # samples for a first fit: of more than twice that every second is taken, and so on
ADEQUATE_NOISE, ADEQUATE_MOTION = 3.0, 0.02  # residual below 3 times the noise, or 2 % of the motion
GRAVITY_FACTOR = 2.0  # by which a wrong scale or rate or a strong drag may falsify gravity
WITH_DRAG_MOTION = 0.2  # residual of the motion above which no drag would make an equation the right one
FAR = 1e6  # in units of the noise: a prediction that has diverged
NEAR = 10.0  # times the best held-out error: what predicts worse is not fitted to all samples
SHOWN = 4  # samples on either side of an event: a position, a velocity, and two that agree with them
MAX_FITTED = 3  # models fitted to all samples in any case


@dataclass(frozen=True, eq=False, slots=True)
class Trial:
    """An observable at its times (n,), ``known`` (n,) ones fitted first; ``motion`` in units of the noise."""

    t_s: Array
    known: Mask
    motion: float
    observable: ObservableCandidate


@dataclass(frozen=True, eq=False, slots=True)
class _Begun:
    """A model fitted to the first part of an observable, and its prediction error.

    ``request`` asks for all samples, ``first`` is the fit of the first part.
    """

    trial: Trial
    request: FitRequest
    name: str
    first: FitResult
    heldout: float


def all_tried(trials: Sequence[Trial], bank: Mapping[str, OdeModel], free: Sequence[str]) -> list[ModelCandidate]:
    """Fit every model that suits an observable to its first part; those that predict best, to all of it."""
    tried: list[ModelCandidate] = []
    begun: list[_Begun] = []
    for trial in trials:
        for model in bank.values():
            if not model.inputs and suits(model, trial.observable):  # an observable of a track has no inputs
                candidate = _begun(model, trial, free)
                if isinstance(candidate, _Begun):
                    begun.append(candidate)
                else:
                    tried.append(candidate)
    begun.sort(key=lambda candidate: candidate.heldout)
    near = NEAR * begun[0].heldout if begun else 0.0
    for k, candidate in enumerate(begun):
        tried.append(_finished(candidate) if k < MAX_FITTED or candidate.heldout <= near else _left_behind(candidate))
    return tried


def _begun(model: OdeModel, trial: Trial, free: Sequence[str]) -> _Begun | ModelCandidate:
    adapted, known, opened = _adapted(model, trial.observable, free)
    every = max(1, trial.t_s.size // FIRST_FIT_SAMPLES)
    whole = as_trajectory(trial.t_s, trial.observable, adapted)
    some = {name: getattr(whole, name)[::every] for name in ("t_s", "position", "sigma")}
    part = whole.with_(**some, valid=trial.known[::every])
    request = FitRequest(whole, adapted, fixed=known, free=opened, options=FitOptions(multistart=0))
    try:
        first = solve(request.with_(trajectory=part))
    except FitError as error:
        return _no_candidate(model, trial.observable, str(error))
    if not first.usable and first.status != "not-converged":  # what it predicts will show how far it got
        return _no_candidate(model, trial.observable, f"{first.status}: {first.message}")
    heldout = _rms(trial.observable, _prediction(adapted, first, trial.t_s), ~trial.known)
    return _Begun(trial, request, model.name, first, heldout)


def _finished(begun: _Begun) -> ModelCandidate:
    """Fit all samples, from where the first part led."""
    trial, observable = begun.trial, begun.trial.observable
    start = {name: begun.first.estimates[name].value for name in begun.first.free}
    near = replace(begun.request.options, local=True)  # with the errors of what the equation lacks, as any other fit
    full = solve(begun.request.with_(start=start, options=near))
    if not full.usable:
        return ModelCandidate(
            begun.name, observable.name, begun.heldout, np.inf, np.inf, False, None, f"{full.status}: {full.message}"
        )
    residual = _rms(observable, full.predicted, np.ones_like(trial.known))
    n = observable.quantities.size + observable.rest.size
    count = len(full.free) + observable.count
    bic = n * float(np.log(max(residual, 1e-6) ** 2)) + count * float(np.log(n)) + _pulls(full, begun.request.fixed)
    limit = max(ADEQUATE_NOISE, ADEQUATE_MOTION * trial.motion)
    adequate = residual <= limit or (
        residual <= WITH_DRAG_MOTION * trial.motion and _residual_with_drag(begun, full) <= limit
    )
    idle = _idle(begun.request.model, full, trial.t_s)
    return ModelCandidate(
        begun.name, observable.name, begun.heldout, residual, bic, adequate, full, "", count, idle, _expected(begun)
    )


def _residual_with_drag(begun: _Begun, full: FitResult) -> float:
    """The residual with a drag of the air beside, which any motion has, in units of the noise; inf where none applies.

    An equation that describes the motion but for its drag is the right one, and incomplete.
    """
    drag, observable = EFFECTS["quadratic-drag"], begun.trial.observable
    if not drag.applies(begun.request.model):
        return np.inf
    start = {name: full.estimates[name].value for name in full.free}
    near = replace(begun.request.options, local=True)
    dragged = with_effect(begun.request.model, drag)
    fitted = solve(begun.request.with_(model=dragged, start=start, options=near))
    return _rms(observable, fitted.predicted, np.ones_like(begun.trial.known)) if fitted.usable else np.inf


def _expected(begun: _Begun) -> float:
    """The held-out error that white noise gives, with the errors of the first fit, in units of the noise."""
    first, trial, lever = begun.first, begun.trial, begun.trial.observable.lever
    rows = first.informed_jacobian(np.tile(1.0 / lever, (first.n, 1)))
    shown = np.sum(rows**2, axis=0) > 0
    sizes, directions = np.linalg.eigh(np.linalg.pinv(rows[:, shown].T @ rows[:, shown], hermitian=True))
    values = {name: estimate.value for name, estimate in first.estimates.items()}
    names, squares = [name for name, one in zip(first.free, shown, strict=True) if one], 0.0
    for size, direction in zip(np.sqrt(np.maximum(sizes, 0.0)), directions.T, strict=True):
        sides = []
        for sign in (1.0, -1.0):
            moved = {name: values[name] + sign * size * part for name, part in zip(names, direction, strict=True)}
            sides.append(simulate(begun.request.model, trial.t_s, {**values, **moved}).observed[~trial.known])
        squares += float(np.sum(((sides[0] - sides[1]) / 2 * lever) ** 2))
    channels = trial.observable.quantities[~trial.known].size + trial.observable.rest[~trial.known].size
    return float(np.sqrt(1.0 + squares / max(channels, 1)))


def _idle(model: OdeModel, full: FitResult, t_s: Array) -> bool:
    """Whether what a model is about is not in the samples: its events, a rest position, or gravity.

    An event counts with SHOWN samples or more on either side. An oscillation that never passes its rest position, or a
    fall with any acceleration, can take the shape of many short and smooth motions.
    """
    if not model.events:
        return _never_at_rest(model, full) or _not_gravity(model, full)
    happened = event_times(model, t_s, {name: estimate.value for name, estimate in full.estimates.items()})
    return not any(t_s[SHOWN - 1] < event.t_s < t_s[-SHOWN] for event in happened)


def _never_at_rest(model: OdeModel, full: FitResult) -> bool:
    rests = [full.estimates[parameter.name].value for parameter in model.with_role("offset")]
    if not model.second_order or len(rests) != len(model.observed):
        return False
    beside = full.predicted[full.used] - np.array(rests)
    return bool(np.any(np.min(beside, axis=0) * np.max(beside, axis=0) > 0))


def _not_gravity(model: OdeModel, full: FitResult) -> bool:
    fitted = [full.estimates[each.name] for each in model.with_role("gravity") if each.name in full.free]
    metric = [abs(estimate.value) / STANDARD_GRAVITY for estimate in fitted if estimate.unit == "m/s^2"]
    return any(not 1 / GRAVITY_FACTOR < ratio < GRAVITY_FACTOR for ratio in metric)


def _left_behind(begun: _Begun) -> ModelCandidate:
    """What predicts far worse than others is not fitted any further."""
    observable = begun.trial.observable
    residual = _rms(
        observable, _prediction(begun.request.model, begun.first, begun.trial.t_s), np.ones_like(begun.trial.known)
    )
    return ModelCandidate(
        begun.name, observable.name, begun.heldout, residual, np.inf, False, begun.first, "predicts far worse"
    )


def _no_candidate(model: OdeModel, observable: ObservableCandidate, why: str) -> ModelCandidate:
    return ModelCandidate(model.name, observable.name, np.inf, np.inf, np.inf, False, None, why)


def _adapted(
    model: OdeModel, observable: ObservableCandidate, free: Sequence[str]
) -> tuple[OdeModel, dict[str, float | Estimate], list[str]]:
    """The model with its zero free; the values that the observable fixes; the names of the values that it frees."""
    names = {parameter.name for parameter in model.parameters}
    fixed: dict[str, float | Estimate] = {name: value for name, value in observable.known.items() if name in names}
    pivot = {parameter.name for parameter in model.with_role("pivot")}  # the model estimates it itself
    fixed = {name: value for name, value in fixed.items() if name not in pivot}
    opened = [name for name in free if name in names and name not in fixed]
    if observable.name in ("height", TILTED, "position"):
        # a held gravity would favour a model over those that estimate it
        opened += [parameter.name for parameter in model.with_role("gravity") if parameter.constant]
    upright = sorted(parameter.name for parameter in model.with_role("vertical"))
    fixed |= {name: Estimate(0.0, UPRIGHT, "rad", source="a camera held upright") for name in upright}
    opened += upright
    zero, offset = sorted(parameter.name for parameter in model.with_role("offset")), EFFECTS["zero-offset"]
    seen_as_it_is = not upright and model.observe is None and not model.events
    if zero:
        opened += zero
    elif seen_as_it_is and not moves_with_its_zero(model) and offset.applies(model):
        model = with_effect(model, offset)
        if model.with_role("gravity") and model.observed[0].unit == "rad":  # an angle from the vertical
            size = offset.parameters[0].name
            fixed[size] = Estimate(0.0, UPRIGHT, "rad", source="a camera held upright")
            opened.append(size)
    return model, fixed, opened


def _pulls(full: FitResult, fixed: Mapping[str, float | Estimate]) -> float:
    """Sum of squared deviations from the priors, in their standard errors."""
    priors = {name: prior for name, prior in fixed.items() if isinstance(prior, Estimate)}
    return float(
        sum(((full.estimates[name].value - prior.value) / prior.stderr) ** 2 for name, prior in priors.items())
    )


def _prediction(model: OdeModel, first: FitResult, t_s: Array) -> Array:
    """What the fit of the first part says of all samples (n, d)."""
    values = {name: estimate.value for name, estimate in first.estimates.items()}
    return simulate(model, t_s, values).observed


def _rms(observable: ObservableCandidate, predicted: Array, samples: Mask) -> float:
    """Root mean square of all raw channels in units of their noise."""
    with np.errstate(all="ignore"):
        moved = (observable.quantities - predicted)[samples] * observable.lever
        every = np.concatenate([moved.ravel(), observable.rest[samples].ravel()])
        every = np.where(np.isfinite(every), np.clip(every, -FAR, FAR), FAR)
    return float(np.sqrt(np.mean(every**2)))
