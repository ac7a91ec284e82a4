"""The alternative effects, each refitted to today's clips."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from fitters.ode import FitRequest
from iris_sysid.diagnosis.evidence import cost_above
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.refit import ModelWithEffects, with_free_geometry
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Array, Diagnosis, Effect, Estimate, FitResult, OdeModel, Trajectory

HOLDOUT = 0.3
NOTHING = "nothing"  # the name of no effect at all
SUSPECTED = 2.0  # standard errors of a size above which an effect that was not named is worth a clip
MAX_SUSPECTED = 2
MIN_PROBABILITY = 1e-300  # a probability whose logarithm is finite
MAX_RIVALS = 6  # the most probable ones; a class of twelve is distinguished by what distinguishes the best six


@dataclass(frozen=True, eq=False, slots=True)
class Question:
    """What is to be decided: which of the effects ``names`` (or ``nothing``) acts, beside those of ``beside``.

    ``fixed`` and ``free`` as for :func:`iris_sysid.diagnose`. ``probabilities`` are what the diagnosis says of the
    names; where one of them is missing, all are weighed by refits.
    """

    model: OdeModel
    names: tuple[str, ...]
    beside: tuple[str, ...] = ()
    fixed: Mapping[str, Estimate] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    probabilities: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, diagnosis: Diagnosis) -> Question:
        """The question that a diagnosis leaves open: the added effect with the least certain name."""
        added = [effect.name for effect in diagnosis.added]
        fixed, free = stated_values(diagnosis.base)
        if not added:
            return cls(diagnosis.base.model, _suspected(diagnosis), (), fixed, free)
        names, beside = least_certain(added, diagnosis.indistinguishable, diagnosis.probabilities)
        return cls(diagnosis.base.model, names, beside, fixed, free, shares_of(names, diagnosis.probabilities))

    def request(self, clip: Trajectory) -> FitRequest:
        """The fit of the model without effects to a clip."""
        return FitRequest.stated(clip, self.model, dict(self.fixed), self.free)


def least_certain(
    added: Sequence[str],
    indistinguishable: Mapping[str, Sequence[str]],
    probabilities: Mapping[str, Mapping[str, float]],
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names among which the least certain of the added effects is, most probable first, and the other added ones.

    Arguments as the fields of :class:`iris_sysid.Diagnosis`; both are empty where nothing was added.
    """
    if not added:
        return (), ()
    asked = min(added, key=lambda name: probabilities.get(name, {}).get(name, 1.0))
    shares = probabilities.get(asked, {})
    names = sorted({asked, *indistinguishable.get(asked, ())}, key=lambda name: -shares.get(name, 0.0))
    return tuple(names), tuple(name for name in added if name != asked)


def shares_of(names: Sequence[str], probabilities: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
    """The probability of each of the names, given that one of them acts; empty where that was not weighed.

    Parameters
    ----------
    names
        Of one class: an added effect and those that explain the data as well.
    probabilities
        As the field of :class:`iris_sysid.Diagnosis`.
    """
    for shares in probabilities.values():
        if set(names) <= set(shares):
            return {name: float(shares[name]) for name in names}
    return {}


def _suspected(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Nothing, and the effects that come nearest to being named; none where no size is far from zero."""
    scores = [score for score in diagnosis.rounds[0] if abs(score.z) > SUSPECTED and score.tried == 1]
    return (NOTHING, *(score.effect for score in scores[:MAX_SUSPECTED])) if scores else ()


def stated_values(fitted: FitResult) -> tuple[dict[str, Estimate], tuple[str, ...]]:
    """The values that a fit was given, other than the model's own constants, and the constants that it estimated."""
    given, free = {}, []
    for parameter in fitted.model.parameters:
        estimate = fitted.estimates[parameter.name]
        own = parameter.constant and estimate.value == parameter.default
        if parameter.name in fitted.free:
            free += [parameter.name] if parameter.constant else []
        elif np.isfinite(estimate.value) and not own:
            given[parameter.name] = estimate
    return given, tuple(free)


@dataclass(frozen=True, eq=False, slots=True)
class Rival:
    """One possible answer: a name, all effects of its model, the fit to today's first clip.

    ``above`` is how far its criterion is above the best rival's over all clips
    (:func:`iris_sysid.diagnosis.evidence.cost_above`); ``unit`` (n, d) are the units of the residuals.
    """

    name: str
    effects: tuple[Effect, ...]
    fitted: FitResult
    above: float
    fits: tuple[FitResult, ...]

    @property
    def values(self) -> dict[str, float]:
        """The values of all estimates by name."""
        return {name: estimate.value for name, estimate in self.fitted.estimates.items()}


def rivals_of(question: Question, clips: Sequence[Trajectory]) -> tuple[Rival, ...]:
    """Refit today's clips with each of the names in question, the most probable first.

    Parameters
    ----------
    question
        Its names may hold NOTHING; without names, that is the only rival.
    clips
        Today's.

    Raises
    ------
    FitError
        When the model without effects cannot be fitted.
    """
    fitted = [with_free_geometry(question.request(clip)) for clip in clips]
    failed = next((fit for _, fit in fitted if not fit.usable), None)
    if failed is not None:
        raise FitError(f"nothing can be planned from a clip that the model does not fit: {failed.message}")
    base = ModelWithEffects.without_effects([clip for clip, _ in fitted], [fit for _, fit in fitted])
    library = EffectLibrary(EFFECTS.values(), question.model, clips)
    cache = FitCache([clip for clip, _ in fitted], question.model, library, base, HOLDOUT, _silent)
    rest = base
    for name in question.beside:
        rest = _with_one(cache, rest, name) or rest
    models = {name: rest if name == NOTHING else _with_one(cache, rest, name) for name in question.names}
    models = models or {NOTHING: rest}
    known = {name: model for name, model in models.items() if model is not None and model.usable}
    if not known:
        raise FitError(f"none of {', '.join(models)} can be fitted to the clip")
    return _ranked(known, question.probabilities)


def _with_one(cache: FitCache, rest: ModelWithEffects, name: str) -> ModelWithEffects | None:
    """The model with one more effect; None where the clips cannot show it."""
    if name not in cache.library.by_name or name in rest.names or name not in cache.screening(rest).visible:
        return None
    model = cache.with_added(rest, cache.screening(rest).single(name))
    return model if model.usable else None


def _ranked(models: Mapping[str, ModelWithEffects], stated: Mapping[str, float]) -> tuple[Rival, ...]:
    """The rivals, the most probable first: by the probabilities stated, where each has one, else by refits."""
    costs = _stated_costs(stated, models) or _refitted_costs(models)
    best = min(costs.values())
    ranked = [
        Rival(name, model.effects, model.fits[0], costs[name] - best, model.fits) for name, model in models.items()
    ]
    return tuple(sorted(ranked, key=lambda rival: rival.above)[:MAX_RIVALS])


def _stated_costs(stated: Mapping[str, float], names: Collection[str]) -> dict[str, float]:
    """The criterion of each name that has its probability; empty where one of them has none."""
    if not set(names) <= set(stated):
        return {}
    return {name: -2.0 * math.log(max(stated[name], MIN_PROBABILITY)) for name in names}


def _refitted_costs(models: Mapping[str, ModelWithEffects]) -> dict[str, float]:
    """How far the criterion of each model is above that of the closest fit."""
    closest = min(models.values(), key=lambda model: model.squares)
    return {name: cost_above(model, closest) if model is not closest else 0.0 for name, model in models.items()}


def as_clips(trajectories: Trajectory | Sequence[Trajectory]) -> list[Trajectory]:
    """One clip, or several, as a list."""
    return [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)


def probabilities_of(above: Array) -> Array:
    """The probability (r,) of each rival, dimensionless, from how far its criterion (r,) is above the best."""
    weights = np.exp(-0.5 * (above - above.min()))
    return np.asarray(weights / weights.sum())


def _silent(text: str) -> None:
    pass
