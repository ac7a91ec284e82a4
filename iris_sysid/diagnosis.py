"""Close the loop: find what a fit leaves over, name the effect that the model lacks, add it, say what changed.

1. Fit the model to every clip. 2. Screen every effect that applies by a score test: its sensitivity, freed of what
the fitted parameters can imitate, against the residual. 3. Refit with the best few; the one that explains most is
added when its size differs from zero at 5 % over the whole library, autocorrelation allowed for, and when it lowers
the held-out error as well. 4. Repeat until nothing is significant. Effects that do as well as the one added are named
beside it, and for every effect that was not added there is an upper limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from fitters.compose import with_effect
from fitters.ode import fit, simulate
from fitters.random_effects import random_effects
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS
from iris_sysid.reservations import reservations
from iris_sysid.scores import Score, combined, screen, shaped, significant_from
from iris_sysid.types import Array, DiscoveredTerm, Effect, Estimate, FitResult, OdeModel, Trajectory

FAMILY_LEVEL = 0.05  # chance of adding anything to a model that lacks nothing
MOST_ADDED = 4
PARTS = 10  # of the clip, the ends of which are held out to judge what acts at one moment
REFITTED = 4  # best of the screen that are refitted in each round
WORTH_REFITTING = 0.7  # of the chi-square that is significant; a refit can find more than the first order shows
ABOVE_NOISE = 1.1  # times the noise floor, which is itself known to a few percent: more is left than noise
ALIKE = 0.99  # cosine between projected sensitivities above which two effects cannot be told apart


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest size of an effect that the data allow, at 95 % confidence; NaN where they say nothing."""

    effect: str
    parameter: str
    upper_95: float
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class Errors:
    """Root mean square of the residual, in the observed unit: over what was fitted, and over what was held out.

    Held out is the end of each clip, after a fit to its beginning; of several clips, also the size of every effect
    added, which then comes from the other clips.
    """

    fitted: float
    heldout: float


@dataclass(frozen=True, eq=False, slots=True)
class Diagnosis:
    """What a model lacks, if anything.

    ``bases`` and ``finals`` are fits to the same samples, one a clip, without and with the effects; ``added`` are
    the effects in the order in which they were found, ``sizes`` by parameter name their size over all clips.
    ``rounds`` hold the screen of each round, best first. ``indistinguishable`` names, for each effect added, those
    that explain the data as well. ``noise_floor`` is the noise of the measurement. ``proposed`` are terms without a
    named effect, for what is left above that floor. ``notes`` say what could not be asked, or answered, and why.
    """

    bases: tuple[FitResult, ...]
    finals: tuple[FitResult, ...]
    added: tuple[Effect, ...]
    sizes: Mapping[str, Estimate]
    rounds: tuple[tuple[Score, ...], ...]
    indistinguishable: Mapping[str, tuple[str, ...]]
    ruled_out: tuple[Limit, ...]
    before: Errors
    after: Errors
    noise_floor: float
    unit: str
    proposed: tuple[DiscoveredTerm, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def base(self) -> FitResult:
        """The first clip's fit without the effects."""
        return self.bases[0]

    @property
    def final(self) -> FitResult:
        """The first clip's fit with the effects."""
        return self.finals[0]


@dataclass(frozen=True, eq=False, slots=True)
class _Clip:
    """What is asked of one clip: the same for every refit."""

    trajectory: Trajectory
    fixed: Mapping[str, float | Estimate]
    free: Sequence[str]

    def refit(self, model: OdeModel, start: Mapping[str, float] | None = None) -> FitResult:
        begin = start or {}
        return fit(self.trajectory, model, fixed=self.fixed, free=self.free, start=begin, nearby=bool(begin))

    def with_open_geometry(self, model: OdeModel) -> tuple[_Clip, FitResult]:
        """The same question with the geometry that was measured with an error left open, where the data fix it.

        And the model's fit to the clip, so asked. Without a default it is no part of the motion, e.g. a board's angle.
        """
        measured, own = self.trajectory.geometry, [one for one in model.parameters if one.default is not None]
        names = [one.name for one in own if one.constant and one.name in measured]
        unsure = [name for name in names if measured[name].stderr > 0 and name not in {*self.fixed, *self.free}]
        wider = replace(self, free=[*self.free, *unsure])
        fitted = wider.refit(model)
        return (wider, fitted) if not unsure or fitted.status in ("ok", "misfit") else (self, self.refit(model))


@dataclass(frozen=True, eq=False, slots=True)
class _State:
    """The fits of all clips with the effects added so far, and their errors."""

    fits: tuple[FitResult, ...]
    errors: Errors


def diagnose(
    trajectories: Trajectory | Sequence[Trajectory],
    model: OdeModel,
    *,
    fixed: Mapping[str, float | Estimate] | None = None,
    free: Sequence[str] = (),
    effects: Sequence[Effect] | None = None,
    holdout: float = 0.3,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find the effects that a model lacks, add them, and measure the error before and after.

    Parameters
    ----------
    trajectories
        What was measured: one clip, or several of the same kind. Each clip has its own values of the model's
        parameters; an effect has the same size in all, up to the scatter that they show.
    model
        The governing equation to question.
    fixed
        Known values by name.
    free
        Constants of the model to estimate as well.
    effects
        What it may lack; every registered effect that applies when not given.
    holdout
        Share of each clip, at its end, that the held-out error is computed on after fitting the rest.
    progress
        Called with a line of text at each step.

    Returns
    -------
    Diagnosis
        With nothing added when the model lacks nothing that the data can show.

    Raises
    ------
    FitError
        When the base model cannot be fitted to a clip, so that there is no residual to explain.
    """
    say = progress or (lambda text: None)
    measured = [trajectories] if isinstance(trajectories, Trajectory) else list(trajectories)
    asked = [_Clip(one, dict(fixed or {}), free).with_open_geometry(model) for one in measured]
    clips = [clip for clip, _ in asked]
    base = _base(clips, tuple(fitted for _, fitted in asked), holdout)
    library = [one for one in (effects if effects is not None else EFFECTS.values()) if one.applies(model)]
    share = FAMILY_LEVEL / max(len(library), 1)
    current, alike = base, {}
    added: list[Effect] = []
    rounds: list[tuple[Score, ...]] = []
    failed: list[str] = []
    for _ in range(MOST_ADDED):
        left = _without(library, added)
        say(f"screening {len(left)} effects")
        scores, parallel = _screened(clips, current, left)
        rounds.append(tuple(combined(one) for one in scores))
        chosen = _best_refit(clips, current, left, scores, share, holdout, say, failed)
        if chosen is None:
            break
        effect, current, equals = chosen
        alike[effect.name] = tuple(dict.fromkeys([*equals, *parallel.get(effect.name, ())]))
        added.append(effect)
        say(f"added {effect.name}")
    else:
        left = _without(library, added)
        rounds.append(tuple(combined(one) for one in _screened(clips, current, left)[0]))
    floor = float(np.sqrt(np.mean([np.mean(one.noise**2) for one in base.fits])))
    return Diagnosis(
        bases=base.fits,
        finals=current.fits,
        added=tuple(added),
        sizes={name: pooled(_sizes(current.fits, name)) for effect in added for name in _names(effect)},
        rounds=tuple(rounds),
        indistinguishable=alike,
        ruled_out=tuple(_limit(score, library) for score in rounds[-1]),
        before=base.errors,
        after=current.errors,
        noise_floor=floor,
        unit=base.fits[0].model.observed[0].unit,
        proposed=_proposed(clips, current, floor),
        notes=reservations(base.fits, rounds[0], failed),
    )


def _proposed(clips: Sequence[_Clip], current: _State, floor: float) -> tuple[DiscoveredTerm, ...]:
    """Terms for what the effects have left, if that is more than noise."""
    if not current.errors.fitted > ABOVE_NOISE * floor:
        return ()
    from fitters.sindy_proposals import proposals  # pysindy takes half a second to import

    return proposals([clip.trajectory for clip in clips], current.fits)


def pooled(sizes: Sequence[Estimate]) -> Estimate:
    """Mean of estimates of one size in independent clips, with the scatter between them in its standard error.

    The only one, where there is but one. Estimates without a standard error are left out.
    """
    known = [one for one in sizes if one.stderr > 0]
    if len(known) < 2:
        return known[0] if known else sizes[0]
    values, stderrs = np.array([one.value for one in known]), np.array([one.stderr for one in known])
    return random_effects(values, stderrs, known[0].unit).mean


def _base(clips: Sequence[_Clip], fits: tuple[FitResult, ...], holdout: float) -> _State:
    for number, one in enumerate(fits, start=1):
        if not one.usable:
            which = f" to clip {number} of {len(fits)}" if len(fits) > 1 else ""
            raise FitError(f"the base model cannot be diagnosed, its fit{which} failed ({one.status}): {one.message}")
    return _State(fits, _errors(clips, fits, (), holdout))


def _screened(
    clips: Sequence[_Clip], current: _State, effects: Sequence[Effect]
) -> tuple[list[tuple[Score, ...]], dict[str, list[str]]]:
    """Scores in all clips, best effect first, and for each those whose sensitivity is parallel in every clip."""
    each = [screen(effects, one, clip.trajectory) for one, clip in zip(current.fits, clips, strict=True)]
    by_name = [{score.effect: score for score in scores} for scores, _ in each]
    together = [tuple(scores[effect.name] for scores in by_name) for effect in effects]
    directions = [projected for _, projected in each]
    names = [name for name in directions[0] if all(name in one for one in directions)]
    parallel = {
        name: [
            other
            for other in names
            if other != name and all(abs(float(one[name] @ one[other])) > ALIKE for one in directions)
        ]
        for name in names
    }
    return sorted(together, key=lambda one: -combined(one).gain), parallel


def _best_refit(
    clips: Sequence[_Clip],
    current: _State,
    effects: Sequence[Effect],
    scores: Sequence[tuple[Score, ...]],
    share: float,
    holdout: float,
    say: Callable[[str], None],
    failed: list[str],
) -> tuple[Effect, _State, list[str]] | None:
    """The effect that explains most once all is refitted, its fits, and those that explain as much."""
    by_name = {effect.name: effect for effect in effects}
    worth = [one for one in scores if combined(one).chi2 > WORTH_REFITTING * _threshold(one, share) ** 2]
    trials: list[tuple[float, Effect, tuple[FitResult, ...]]] = []
    for score in worth[:REFITTED]:
        effect = by_name[score[0].effect]
        say(f"refitting with {effect.name}")
        fits = _refitted(clips, current.fits, effect, score)
        failed += [f"the refit with {effect.name} is {one.status}: {one.message}" for one in fits if not one.usable][:1]
        if all(one.usable for one in fits) and _significant(fits, effect, _threshold(score, share)):
            trials.append((sum(_sum_of_squares(one) for one in fits), effect, fits))
    if not trials:
        return None
    trials.sort(key=lambda trial: trial[0])
    best, effect, fits = trials[0]
    state = _State(fits, _errors(clips, fits, _names(effect), holdout))
    if not _predicts_better(clips, state, current, effect, holdout):
        return None
    margin = _margin(fits)
    return effect, state, [other.name for cost, other, _ in trials[1:] if cost - best < margin]


def _significant(fits: Sequence[FitResult], effect: Effect, threshold: float) -> bool:
    size = pooled(_sizes(fits, effect.parameters[0].name))
    return abs(size.value) > threshold * size.stderr


def _predicts_better(
    clips: Sequence[_Clip], candidate: _State, current: _State, effect: Effect, holdout: float
) -> bool:
    """Whether held-out samples are predicted better; true where nothing can be held out.

    What acts at one moment only may act in the part that is held out, and cannot be learnt then: for such an effect
    it is enough when the ends of many short parts of the clip are predicted better.
    """
    if not candidate.errors.heldout >= current.errors.heldout:
        return True
    if effect.trials is None:
        return False
    now, before = (_errors(clips, one.fits, _names(effect), holdout, PARTS).heldout for one in (candidate, current))
    return not now >= before


def _threshold(scores: Sequence[Score], share: float) -> float:
    """Standard errors from which a size is significant, when an effect was tried in several shapes in each clip."""
    return significant_from(share, scores[0].tried ** len(scores))


def _without(library: Sequence[Effect], added: Sequence[Effect]) -> list[Effect]:
    names = {one.name for one in added}
    return [one for one in library if one.name not in names]


def _refitted(
    clips: Sequence[_Clip], fits: Sequence[FitResult], effect: Effect, scores: Sequence[Score]
) -> tuple[FitResult, ...]:
    """Every clip's fit with the effect added, from the size and the shape that the screen found there."""
    refits = []
    for clip, fitted, score in zip(clips, fits, scores, strict=True):
        own = shaped(effect, score.shape)
        start = {name: fitted.estimates[name].value for name in fitted.free}
        start |= {one.name: one.default or 0.0 for one in own.parameters if not one.constant}
        size = np.nan_to_num(combined(scores).size)
        refits.append(clip.refit(with_effect(fitted.model, own), {**start, effect.parameters[0].name: float(size)}))
    return tuple(refits)


def _margin(fits: Sequence[FitResult]) -> float:
    """Twice the log of 20 : 1, inflated as the residual's correlation thins out the independent samples."""
    correlation = max(abs(one.correlation) for one in fits)
    return float(2 * np.log(20.0) * (1 + correlation) / max(1 - correlation, 0.05))


def _names(effect: Effect) -> tuple[str, ...]:
    return tuple(parameter.name for parameter in effect.parameters)


def _sizes(fits: Sequence[FitResult], name: str) -> list[Estimate]:
    return [one.estimates[name] for one in fits]


def _sum_of_squares(fitted: FitResult) -> float:
    noise = np.where(fitted.noise > 0, fitted.noise, 1.0)
    return float(np.sum((fitted.residual[fitted.used] / noise) ** 2))


def _limit(score: Score, effects: Sequence[Effect]) -> Limit:
    effect = next(one for one in effects if one.name == score.effect)
    upper = abs(score.size) + float(norm.isf(0.05)) * score.stderr
    return Limit(effect.name, effect.parameters[0].name, upper, score.unit)


def _errors(
    clips: Sequence[_Clip], fits: Sequence[FitResult], added: Sequence[str], holdout: float, parts: int = 1
) -> Errors:
    """The error over the samples fitted, and over those held out; NaN where a clip has none to spare."""
    inside = np.concatenate([one.residual[one.used].ravel() for one in fits])
    later = []
    for k, (clip, fitted) in enumerate(zip(clips, fits, strict=True)):
        others = [one for j, one in enumerate(fits) if j != k]
        given = {name: pooled(_sizes(others, name)).value for name in added} if others else {}
        later.append(_prediction_error(replace(clip, fixed={**clip.fixed, **given}), fitted, holdout, parts))
    return Errors(_rms(inside), _rms(np.concatenate(later)))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _prediction_error(clip: _Clip, fitted: FitResult, holdout: float, parts: int) -> Array:
    """Observed - predicted over the last samples (m,) of each part after a fit to the others; one NaN without any."""
    unknown = np.array([np.nan])
    used = np.flatnonzero(fitted.used)
    later = used[(np.arange(len(used)) * parts / len(used)) % 1.0 >= 1.0 - holdout]
    if len(used) - len(later) < 3 * len(fitted.free) or len(later) == 0:
        return unknown
    trajectory = clip.trajectory
    kept = trajectory.valid.copy()
    kept[later] = False
    start = {name: fitted.estimates[name].value for name in fitted.free if name not in clip.fixed}
    part = replace(clip, trajectory=trajectory.with_(valid=kept)).refit(fitted.model, start)
    if not part.usable:
        return unknown
    values = {name: estimate.value for name, estimate in part.estimates.items()}
    span = slice(used[0], used[-1] + 1)
    known = trajectory.inputs[span] if trajectory.inputs is not None else None
    _, predicted = simulate(fitted.model, trajectory.t_s[span], values, inputs=known)
    columns = [trajectory.column(quantity.name) for quantity in fitted.model.observed]
    return np.asarray((trajectory.position[later][:, columns] - predicted[later - used[0]]).ravel())
