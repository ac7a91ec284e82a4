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
from iris_sysid.types import Array, Diagnosis, FitResult, Mask, Trajectory


@dataclass(frozen=True, slots=True)
class Decision:
    """``probabilities`` of the names with the new clip, most probable first; ``names`` are those that it leaves.

    ``described`` says whether the best of the names describes every clip; else they are the best of wrong names.
    """

    probabilities: Mapping[str, float]
    names: tuple[str, ...]
    described: bool = True


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
        The probability of each name, those that are left, and whether the best of them describes every clip.

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
    clips = as_clips(new)
    parts = [roles(rival, change, question.model, clips[0].view is not None) for rival in rivals]
    known = [_Known.today(rival, part) for rival, part in zip(rivals, parts, strict=True)]
    misfits = np.array([[fit.status == "misfit" for fit in rival.fits] for rival in rivals])
    for clip in clips:
        costs, misfit = _costs(question, parts, known, clip)
        above, misfits = above + costs, np.column_stack([misfits, misfit])
    best = int(np.argmin(above))
    return _decision(rivals, above - above[best], described=not misfits[best].any())


def _costs(question: Question, parts: Sequence[Roles], known: list[_Known], new: Trajectory) -> tuple[Array, Mask]:
    """What a new clip adds to the criterion (r,) of each rival; infinite where it cannot be fitted. Which are misfits.

    What is ``known`` of the values that all clips share becomes what is known with the new one.
    """
    fits = [_fitted(question, part, new) for part in parts]
    request = question.request(new)
    units = ModelWithEffects.without_effects([request], [solve(request)]).units
    models = {k: ModelWithEffects((fit,), units) for k, fit in enumerate(fits) if fit.usable}
    if not models:
        raise FitError(f"no name can be fitted to the new clip: {fits[0].message}")
    closest = min(models.values(), key=lambda model: model.squares)
    costs = np.full(len(parts), np.inf)
    for k, model in models.items():
        shared = len(parts[k].shared) * float(np.log(max(fits[k].n, 2)))
        known[k], apart = known[k].joined(fits[k])
        costs[k] = cost_above(model, closest) - shared + apart
    return costs, np.array([fit.status == "misfit" for fit in fits])


def _decision(rivals: Sequence[Rival], above: Array, described: bool) -> Decision:
    order = np.argsort(above)
    shares = probabilities_of(above)
    return Decision(
        {rivals[k].name: float(shares[k]) for k in order},
        tuple(rivals[k].name for k in order if above[k] < DECISIVE),
        described,
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


@dataclass(frozen=True, eq=False, slots=True)
class _Known:
    """What the clips so far say of the values (s,) that all share: ``names``, ``values``, ``covariance`` (s, s)."""

    names: tuple[str, ...]
    values: Array
    covariance: Array

    @classmethod
    def today(cls, rival: Rival, part: Roles) -> _Known:
        """What today's clip says, in the scale of the new one."""
        rows = [rival.fitted.free.index(name) for name in part.shared]
        factors = np.array([part.factors[name] for name in part.shared])
        covariance = rival.fitted.covariance[np.ix_(rows, rows)] * np.outer(factors, factors)
        return cls(part.shared, np.array([part.values[name] for name in part.shared]), covariance)

    def joined(self, fitted: FitResult) -> tuple[_Known, float]:
        """The same with one more clip, and the chi-square of its difference (Kalman 1960, J. Basic Eng. 82, 35)."""
        both = [k for k, name in enumerate(self.names) if name in fitted.free]
        rows = [fitted.free.index(self.names[k]) for k in both]
        total = self.covariance[np.ix_(both, both)] + fitted.covariance[np.ix_(rows, rows)]
        scale = np.sqrt(np.diag(total))
        usable = np.isfinite(scale) & (scale > 0)
        if not usable.any():
            return self, 0.0
        which, scale = np.array(both)[usable], scale[usable]
        new = np.array([fitted.estimates[self.names[k]].value for k in which])
        inverse = np.linalg.pinv(total[np.ix_(usable, usable)] / np.outer(scale, scale), hermitian=True)
        inverse = inverse / np.outer(scale, scale)
        apart, gain = new - self.values[which], self.covariance[:, which] @ inverse
        joined = _Known(self.names, self.values + gain @ apart, self.covariance - gain @ self.covariance[which])
        return joined, float(apart @ inverse @ apart)
