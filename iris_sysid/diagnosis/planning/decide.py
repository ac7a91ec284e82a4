"""Which of the names in question one more clip leaves, with what both clips must share as evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fitters.compose_effects import with_effects
from fitters.effect_sensitivity import shaped
from fitters.image_effects import view_of
from fitters.ode import solve
from iris_sysid.diagnosis.evidence import DECISIVE, cost_above
from iris_sysid.diagnosis.planning.changes import REPEAT, SetUpChange
from iris_sysid.diagnosis.planning.predicted_clip import Roles, roles
from iris_sysid.diagnosis.planning.rivals import Question, Rival, as_clips, probabilities_of, rivals_of
from iris_sysid.diagnosis.refit import ModelWithEffects
from iris_sysid.errors import FitError
from iris_sysid.types import Array, Diagnosis, FitResult, Trajectory


@dataclass(frozen=True, slots=True)
class Decision:
    """``probabilities`` of the names with the new clip, most probable first; ``names`` are those that it leaves."""

    probabilities: Mapping[str, float]
    names: tuple[str, ...]


def decide(
    diagnosis: Diagnosis | Question,
    trajectories: Trajectory | Sequence[Trajectory],
    new: Trajectory | Sequence[Trajectory],
    change: SetUpChange = REPEAT,
) -> Decision:
    """Weigh the names that a diagnosis left with further clips, of a set-up that was changed in a known way.

    Each name is fitted to the new clips too. Its criterion is the sum over all clips, and the chi-square by which
    the values that the change leaves alone differ between them.

    Parameters
    ----------
    diagnosis
        What :func:`iris_sysid.diagnose` returned of the first clips, or the question it left open.
    trajectories
        The first clips.
    new
        The new clip, or several of the same set-up.
    change
        Of a proposal of :func:`iris_sysid.plan`, or stated; by default nothing was changed.

    Returns
    -------
    Decision
        The probability of each name, and those that are left.

    Raises
    ------
    FitError
        When the question has fewer than two names, or none can be fitted to a new clip.
    """
    question = Question.of(diagnosis) if isinstance(diagnosis, Diagnosis) else diagnosis
    rivals = rivals_of(question, as_clips(trajectories))
    if len(rivals) < 2:
        raise FitError("one name is left already: there is nothing to decide")
    above = np.array([rival.above for rival in rivals])
    for clip in as_clips(new):
        above = above + _costs(question, rivals, clip, change)
    return _decision(rivals, above - above.min())


def _costs(question: Question, rivals: Sequence[Rival], new: Trajectory, change: SetUpChange) -> Array:
    """What a new clip adds to the criterion (r,) of each rival; infinite where it cannot be fitted."""
    known_view = new.view is not None
    parts = [roles(rival, change, question.model, known_view) for rival in rivals]
    fits = [_fitted(question, part, new) for part in parts]
    request = question.request(new)
    units = ModelWithEffects.without_effects([request], [solve(request)]).units
    models = {k: ModelWithEffects((fit,), units) for k, fit in enumerate(fits) if fit.usable}
    if not models:
        raise FitError(f"no name can be fitted to the new clip: {fits[0].message}")
    closest = min(models.values(), key=lambda model: model.squares)
    costs = np.full(len(rivals), np.inf)
    for k, model in models.items():
        shared = len(parts[k].shared) * float(np.log(max(fits[k].n, 2)))
        costs[k] = cost_above(model, closest) - shared + _disagreement(rivals[k], parts[k], fits[k])
    return costs


def _decision(rivals: Sequence[Rival], above: Array) -> Decision:
    order = np.argsort(above)
    shares = probabilities_of(above)
    return Decision(
        {rivals[k].name: float(shares[k]) for k in order},
        tuple(rivals[k].name for k in order if above[k] < DECISIVE),
    )


def _fitted(question: Question, part: Roles, new: Trajectory) -> FitResult:
    """The fit of a rival to the new clip alone, from today's values."""
    model = question.model
    for effect in part.effects:
        variant = shaped(effect, [part.values[each.name] for each in effect.parameters[1:]])
        model = with_effects(model, [variant], view_of(new, question.model))
    request = question.request(new).with_(model=model)
    start = {name: part.values[name] for name in (*part.shared, *part.new) if name not in model.initial_names}
    return solve(request.with_(start=start))


def _disagreement(rival: Rival, part: Roles, fitted: FitResult) -> float:
    """Chi-square of the differences between today's and the new clip's values of what both share."""
    names = [name for name in part.shared if name in fitted.free]
    today, new = ([fit.free.index(name) for name in names] for fit in (rival.fitted, fitted))
    factors = np.array([part.factors[name] for name in names])
    apart = np.array([fitted.estimates[name].value - part.values[name] for name in names])
    covariance = rival.fitted.covariance[np.ix_(today, today)] * np.outer(factors, factors)
    covariance = covariance + fitted.covariance[np.ix_(new, new)]
    scale = np.sqrt(np.diag(covariance))
    known = np.isfinite(scale) & (scale > 0)
    if not known.any():
        return 0.0
    correlation = (covariance / np.outer(scale, scale))[np.ix_(known, known)]
    standard = (apart / scale)[known]
    return float(standard @ np.linalg.pinv(correlation, hermitian=True) @ standard)
