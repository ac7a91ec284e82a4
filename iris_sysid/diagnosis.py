"""Close the loop: find what a fit leaves over, name the effect that the model lacks, add it, say what changed.

1. Fit the model. 2. Screen every effect that applies by a score test: its sensitivity, freed of what the
fitted parameters can imitate, against the residual. 3. Refit with the best few; the one that explains most
is added when its size differs from zero at 5 % over the whole library, autocorrelation allowed for, and
when it lowers the held-out error as well.
4. Repeat until nothing is significant. Effects that do as well as the one added are named beside it, and
for every effect that was not added there is an upper limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from fitters._covariance import inverse_normal, random_uncertainty
from fitters.compose import with_effect
from fitters.ode import fit, simulate
from fitters.screen import sensitivity
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS
from iris_sysid.types import Array, Effect, Estimate, FitResult, OdeModel, Trajectory

FAMILY_LEVEL = 0.05  # chance of adding anything to a model that lacks nothing
MOST_ADDED = 4
REFITTED = 4  # best of the screen that are refitted in each round
ALIKE = 0.99  # cosine between projected sensitivities above which two effects cannot be told apart
HIDDEN = 1e-4  # share of a sensitivity that must be left after the parameters have taken theirs


@dataclass(frozen=True, slots=True)
class Score:
    """One effect in one round of the screen.

    ``size`` and ``stderr`` are its first-order estimate in ``unit``; ``gain`` is the share of the residual's
    sum of squares that it would take away; ``z`` is size / stderr. All NaN when the data cannot show it.
    """

    effect: str
    size: float
    stderr: float
    unit: str
    gain: float

    @property
    def z(self) -> float:
        """Size in standard errors."""
        return self.size / self.stderr if self.stderr > 0 else float("nan")


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest size of an effect that the data allow, at 95 % confidence; NaN where they say nothing."""

    effect: str
    parameter: str
    upper_95: float
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class Errors:
    """Root mean square of the residual, in the observed unit: over what was fitted, and over what was held out."""

    fitted: float
    heldout: float


@dataclass(frozen=True, eq=False, slots=True)
class Diagnosis:
    """What a model lacks, if anything.

    ``base`` and ``final`` are fits to the same samples; ``added`` are the effects in the order in which they
    were found. ``rounds`` hold the screen of each round, best first. ``indistinguishable`` names, for each
    effect added, those that explain the data as well. ``noise_floor`` is the noise of the measurement.
    """

    base: FitResult
    final: FitResult
    added: tuple[Effect, ...]
    rounds: tuple[tuple[Score, ...], ...]
    indistinguishable: Mapping[str, tuple[str, ...]]
    ruled_out: tuple[Limit, ...]
    before: Errors
    after: Errors
    noise_floor: float
    unit: str


@dataclass(frozen=True, eq=False, slots=True)
class _Question:
    """What is asked: the same for every refit."""

    trajectory: Trajectory
    fixed: Mapping[str, float | Estimate]
    free: Sequence[str]

    def refit(self, model: OdeModel, start: Mapping[str, float] | None = None) -> FitResult:
        begin = start or {}
        return fit(self.trajectory, model, fixed=self.fixed, free=self.free, start=begin, nearby=bool(begin))

    def with_open_geometry(self, model: OdeModel) -> _Question:
        """The same question with the geometry that was measured with an error left open, where the data fix it."""
        measured = self.trajectory.geometry
        names = [one.name for one in model.parameters if one.constant and one.name in measured]
        unsure = [name for name in names if measured[name].stderr > 0 and name not in {*self.fixed, *self.free}]
        wider = replace(self, free=[*self.free, *unsure])
        return wider if unsure and wider.refit(model).status in ("ok", "misfit") else self


def diagnose(
    trajectory: Trajectory,
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
    trajectory
        What was measured.
    model
        The governing equation to question.
    fixed
        Known values by name.
    free
        Constants of the model to estimate as well.
    effects
        What it may lack; every registered effect that applies when not given.
    holdout
        Share of the clip, at its end, that the held-out error is computed on after fitting the rest.
    progress
        Called with a line of text at each step.

    Returns
    -------
    Diagnosis
        With nothing added when the model lacks nothing that the data can show.

    Raises
    ------
    FitError
        When the base model cannot be fitted, so that there is no residual to explain.
    """
    say = progress or (lambda text: None)
    question = _Question(trajectory, dict(fixed or {}), free).with_open_geometry(model)
    base = question.refit(model)
    if not base.usable:
        raise FitError(f"the base model cannot be diagnosed, its fit failed ({base.status}): {base.message}")
    library = [one for one in (effects if effects is not None else EFFECTS.values()) if one.applies(model)]
    threshold = float(norm.isf(FAMILY_LEVEL / 2 / max(len(library), 1)))
    current, added, rounds, alike = base, [], [], {}
    for _ in range(MOST_ADDED):
        left = [one for one in library if one not in added]
        say(f"screening {len(left)} effects")
        scores, projected = screen(left, current, trajectory)
        rounds.append(scores)
        chosen = _best_refit(question, current, left, scores, threshold, say)
        if chosen is None or not _predicts_better(question, chosen[1], current, holdout):
            break
        effect, current, equals = chosen
        alike[effect.name] = _indistinguishable(effect, equals, scores, projected)
        added.append(effect)
        say(f"added {effect.name}")
    scores, _ = screen([one for one in library if one not in added], current, trajectory)
    return Diagnosis(
        base=base,
        final=current,
        added=tuple(added),
        rounds=tuple(rounds),
        indistinguishable=alike,
        ruled_out=tuple(_limit(score, library, model) for score in scores),
        before=_errors(question, base, holdout),
        after=_errors(question, current, holdout),
        noise_floor=float(np.sqrt(np.mean(base.noise**2))),
        unit=model.observed[0].unit,
    )


def screen(
    effects: Sequence[Effect], fitted: FitResult, trajectory: Trajectory
) -> tuple[tuple[Score, ...], dict[str, Array]]:
    """Score each effect against the residual of a fit, best first, without refitting.

    With s the effect's sensitivity, J those of the fitted parameters and r the residual, all in units of the
    noise, s' = s - J (J'J)^-1 J's is what the parameters cannot imitate, (s'r) / (s's') estimates the size
    to first order (Rao 1948, Proc. Camb. Phil. Soc. 44, 50), and (s'r)^2 / (s's' r'r) is the gain.

    Parameters
    ----------
    effects
        All apply to the fitted model.
    fitted
        The model without them.
    trajectory
        What it was fitted to.

    Returns
    -------
    scores : tuple of Score
        In falling order of gain.
    projected : dict of str to ndarray
        s' of each effect, of unit length; absent when the parameters imitate it entirely.
    """
    noise = np.where(fitted.noise > 0, fitted.noise, 1.0)
    residual = fitted.residual[fitted.used] / noise
    jacobian = fitted.jacobian / np.tile(noise, len(residual))[:, None]
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    scores, projected = [], {}
    for effect in effects:
        along = (sensitivity(effect, fitted, trajectory) / noise).ravel()
        apart = along - basis @ (basis.T @ along)
        unit = effect.parameters[0].unit.replace("{x}", fitted.model.observed[0].unit)
        length = float(np.linalg.norm(apart))
        if not np.isfinite(length) or length <= HIDDEN * float(np.linalg.norm(along)):
            scores.append(Score(effect.name, np.nan, np.nan, unit, 0.0))
            continue
        projected[effect.name] = apart / length
        scores.append(_score(effect.name, unit, apart, jacobian, residual, fitted.t_s[fitted.used]))
    return tuple(sorted(scores, key=lambda score: -score.gain)), projected


def _score(name: str, unit: str, apart: Array, jacobian: Array, residual: Array, t_s: Array) -> Score:
    flat = residual.ravel()
    size = float(apart @ flat / (apart @ apart))
    rest = (flat - size * apart).reshape(residual.shape)
    together = np.column_stack([jacobian, apart]).reshape(*residual.shape, -1)
    bread = inverse_normal(together.reshape(-1, together.shape[2]))
    variance = random_uncertainty(t_s, rest, together, bread).covariance[-1, -1]
    gain = size**2 * float(apart @ apart) / max(float(flat @ flat), 1e-300)
    return Score(name, size, float(np.sqrt(variance)), unit, gain)


def _best_refit(
    question: _Question,
    current: FitResult,
    effects: Sequence[Effect],
    scores: Sequence[Score],
    threshold: float,
    say: Callable[[str], None],
) -> tuple[Effect, FitResult, list[str]] | None:
    """The effect that explains most once all is refitted, its fit, and those that explain as much."""
    by_name = {effect.name: effect for effect in effects}
    start = {name: estimate.value for name, estimate in current.estimates.items() if name in current.free}
    trials: list[tuple[float, Effect, FitResult]] = []
    for score in [one for one in scores if one.gain > 0][:REFITTED]:
        effect = by_name[score.effect]
        say(f"refitting with {effect.name}")
        first = {**start, effect.parameters[0].name: score.size}
        refitted = question.refit(with_effect(current.model, effect), first)
        size = refitted.estimates.get(effect.parameters[0].name)
        if refitted.usable and size is not None and abs(size.value) > threshold * size.stderr:
            trials.append((_sum_of_squares(refitted), effect, refitted))
    if not trials:
        return None
    trials.sort(key=lambda trial: trial[0])
    best, effect, refitted = trials[0]
    # twice the log of 20 : 1, inflated as the residual's correlation thins out the independent samples
    margin = 2 * np.log(20.0) * (1 + abs(refitted.correlation)) / max(1 - abs(refitted.correlation), 0.05)
    return effect, refitted, [other.name for cost, other, _ in trials[1:] if cost - best < margin]


def _predicts_better(question: _Question, candidate: FitResult, current: FitResult, holdout: float) -> bool:
    """Whether the candidate predicts what was held out better too; true where nothing can be held out."""
    now, before = _errors(question, candidate, holdout).heldout, _errors(question, current, holdout).heldout
    return not now >= before


def _sum_of_squares(fitted: FitResult) -> float:
    noise = np.where(fitted.noise > 0, fitted.noise, 1.0)
    return float(np.sum((fitted.residual[fitted.used] / noise) ** 2))


def _indistinguishable(
    effect: Effect, equals: Sequence[str], scores: Sequence[Score], projected: Mapping[str, Array]
) -> tuple[str, ...]:
    own = projected.get(effect.name)
    parallel = [
        score.effect
        for score in scores
        if own is not None
        and score.effect != effect.name
        and score.effect in projected
        and abs(float(projected[score.effect] @ own)) > ALIKE
    ]
    return tuple(dict.fromkeys([*equals, *parallel]))


def _limit(score: Score, effects: Sequence[Effect], model: OdeModel) -> Limit:
    effect = next(one for one in effects if one.name == score.effect)
    upper = abs(score.size) + float(norm.isf(0.05)) * score.stderr
    return Limit(effect.name, effect.parameters[0].name, upper, score.unit)


def _errors(question: _Question, fitted: FitResult, holdout: float) -> Errors:
    """The error over the samples fitted, and over the last of them after a fit to the others alone."""
    used = np.flatnonzero(fitted.used)
    inside = float(np.sqrt(np.mean(fitted.residual[used] ** 2)))
    kept = used[: round(len(used) * (1 - holdout))]
    if len(kept) < 3 * len(fitted.free) or len(kept) == len(used):
        return Errors(inside, float("nan"))
    trajectory = question.trajectory
    early = trajectory.valid.copy()
    early[kept[-1] + 1 :] = False
    start = {name: fitted.estimates[name].value for name in fitted.free}
    part = replace(question, trajectory=trajectory.with_(valid=early)).refit(fitted.model, start)
    if not part.usable:
        return Errors(inside, float("nan"))
    values = {name: estimate.value for name, estimate in part.estimates.items()}
    span = slice(used[0], used[-1] + 1)
    known = trajectory.inputs[span] if trajectory.inputs is not None else None
    _, predicted = simulate(fitted.model, trajectory.t_s[span], values, inputs=known)
    columns = [trajectory.column(quantity.name) for quantity in fitted.model.observed]
    later = used[len(kept) :]
    difference = trajectory.position[later][:, columns] - predicted[later - used[0]]
    return Errors(inside, float(np.sqrt(np.mean(difference**2))))
