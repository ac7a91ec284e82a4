"""Rank the changes of a set-up by how likely one more clip leaves a single name, or by the precision of a value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from iris_sysid.diagnosis.planning.changes import REPEAT, SetUpChange, changes_for
from iris_sysid.diagnosis.planning.power import Power, power_of
from iris_sysid.diagnosis.planning.precision import Need, needs
from iris_sysid.diagnosis.planning.predicted_clip import Design, PredictedClip, imitating
from iris_sysid.diagnosis.planning.rivals import Question, Rival, as_clips, probabilities_of, rivals_of
from iris_sysid.errors import UnknownNameError
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.types import Array, Diagnosis, FitResult, Shown, Trajectory

REFINED = 4  # best proposals whose power is found by refits
JOINED = 4  # best proposals, tried in pairs
CLEAR = 0.9  # power above which no pair is tried
PRACTICAL = 0.5  # power below which a proposal is not worth making


@dataclass(frozen=True, eq=False, slots=True)
class Proposal:
    """One more clip, with a change of the set-up.

    ``power`` is the probability that a single name is left, and the right one; ``by_name`` that for each name if it is
    the right one; both are NaN where one name is left already. ``stderr`` holds by name the random standard error of
    what both clips share, with both, in the unit of today's estimate. ``cost`` is what was stated, or 1.
    ``t_s`` (n,) s are the times of the new clip, and ``differences`` (n, d), in the observed unit, what each name
    predicts there less what the first one does, after a refit of all values.
    """

    change: SetUpChange
    power: float
    by_name: Mapping[str, float]
    stderr: Mapping[str, float]
    cost: float
    t_s: Array
    differences: Mapping[str, Array]

    @property
    def text(self) -> str:
        """What to do, in words."""
        return self.change.text


@dataclass(frozen=True, eq=False, slots=True)
class Plan(Shown):
    """What to measure next: ``proposals``, best first by power over cost, or by precision where nothing is in question.

    ``probabilities`` are those of the names in question today, ``stderr`` today's random standard errors by name;
    ``repeat`` is the proposal to do the same once more, with which all others compare. ``fitted`` is today's fit of
    the most probable name.
    """

    probabilities: Mapping[str, float]
    stderr: Mapping[str, float]
    repeat: Proposal
    proposals: tuple[Proposal, ...]
    fitted: FitResult

    def __repr__(self) -> str:
        power = "" if np.isnan(self.best.power) else f", which decides with a chance of {self.best.power:.0%}"
        today = ", ".join(f"{name} {share:.0%}" for name, share in self.probabilities.items())
        return f"Plan of {self.fitted.model.name}: next {self.best.text}{power}\n  today: {today}"

    @property
    def best(self) -> Proposal:
        """The first proposal."""
        return self.proposals[0]

    def named(self, change: str) -> Proposal:
        """The proposal with the change of that name; UnknownNameError lists the names there are."""
        for proposal in self.proposals:
            if proposal.change.name == change:
                return proposal
        names = ", ".join(proposal.change.name for proposal in self.proposals)
        raise UnknownNameError(f"no change is named {change!r}; there are: {names}")

    def needs(self, name: str, stderr: float) -> tuple[Need, ...]:
        """The ways to know a fitted value to a standard error, in its unit; UnknownNameError lists the values.

        Parameters
        ----------
        name
            Of a fitted value that the motion shares with a repeat: not a starting value.
        stderr
            Wanted, of all sources together.
        """
        shared = self.repeat.stderr
        if name not in shared:
            raise UnknownNameError(f"no value that clips share is named {name!r}; there are: {', '.join(shared)}")
        return needs(self.fitted.budget[name], shared[name], stderr)

    @property
    def practical(self) -> bool:
        """Whether some proposal is more likely than not to leave a single name."""
        return any(proposal.power > PRACTICAL for proposal in self.proposals)


@on_one_thread
def plan(
    diagnosis: Diagnosis | Question,
    trajectories: Trajectory | Sequence[Trajectory],
    *,
    changes: Sequence[SetUpChange] | None = None,
    costs: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Plan:
    """Rank what to film next: the power of each change to tell the names of a missing effect apart.

    Every name is refitted to today's clips; each then predicts the new one, and clips drawn from each are refitted with
    all others. What a change leaves alone (the length, the size of a drag) is shared by both clips.

    Parameters
    ----------
    diagnosis
        What :func:`iris_sysid.diagnose` returned, or the question it left open.
    trajectories
        The clips that were diagnosed; the new one is planned from the first.
    changes
        Those to rank, beside a repeat; by default all that make sense for the model.
    costs
        Of changes, by their names; 1 for all others. Proposals are ranked by power over cost.
    seed
        Of the drawn clips.

    Returns
    -------
    Plan
        With the precision of each shared value too, also where only one name is left.

    Raises
    ------
    FitError
        When no name can be fitted to the clips.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, diagnose, plan, simulate, with_effects
    >>> t_s = np.arange(300) / 60
    >>> truth = {"length": 0.5, "damping": 0.1, "quadratic_drag": 0.1, "theta_0": 0.3, "omega_0": 0.0}
    >>> theta = simulate(with_effects("pendulum", ["quadratic-drag"]), t_s, truth).observed
    >>> theta += 2e-3 * np.random.default_rng(0).standard_normal(theta.shape)
    >>> clip = Trajectory(t_s, MODELS["pendulum"].observed, theta, np.full_like(theta, np.nan), np.ones(300, bool))
    >>> planned = plan(diagnose(clip, "pendulum", effects=["quadratic-drag", "coulomb-friction"]), clip)
    >>> planned.best.stderr["quadratic_drag"] < 0.1 * planned.stderr["quadratic_drag"]
    True
    """
    clips = as_clips(trajectories)
    question = Question.of(diagnosis) if isinstance(diagnosis, Diagnosis) else diagnosis
    rivals = rivals_of(question, clips)
    study = _Study(question, rivals, clips[0], dict(costs or {}), seed)
    start = {name: rivals[0].values[name] for name in question.model.initial_names}
    effects = [effect for rival in rivals for effect in rival.effects]
    tried = changes_for(question.model, start, effects) if changes is None else [REPEAT, *changes]
    first = study.proposals(tried, refined=False)
    best = study.ranked(first)
    if len(rivals) > 1:
        best = study.with_pairs(study.refined(best))
    repeat = next(each for each in best if each.change.name == "repeat")
    shares = probabilities_of(np.array([rival.above for rival in rivals]))
    return Plan(
        {rival.name: float(share) for rival, share in zip(rivals, shares, strict=True)},
        study.today(),
        repeat,
        tuple(best),
        rivals[0].fitted,
    )


@dataclass(frozen=True, eq=False, slots=True)
class _Study:
    """The proposals for one question, each computed with the same drawn noise."""

    question: Question
    rivals: tuple[Rival, ...]
    clip: Trajectory
    costs: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0

    def design(self, change: SetUpChange) -> Design:
        return Design.of(change, self.rivals[0], self.question.model, self.clip)

    def today(self) -> dict[str, float]:
        """Today's standard errors."""
        fitted = self.rivals[0].fitted
        errors = np.sqrt(np.maximum(np.diag(fitted.covariance), 0.0))
        return {name: float(error) for name, error in zip(fitted.free, errors, strict=True)}

    def proposals(self, changes: Sequence[SetUpChange], refined: bool) -> list[Proposal]:
        found = [self._proposal(change, refined) for change in changes]
        return [proposal for proposal in found if proposal is not None]

    def ranked(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        """Best first: by power over cost, then by the gain in precision."""
        return sorted(proposals, key=lambda each: (-np.nan_to_num(each.power) / each.cost, self._remaining(each)))

    def refined(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        """The best of the proposals, and a repeat, with refits; the others follow as they were."""
        best = proposals[:REFINED]
        best = [*best, *(each for each in proposals[REFINED:] if each.change.name == "repeat")]
        again = self.proposals([each.change for each in best], refined=True)
        return self.ranked([*again, *(each for each in proposals if each not in best)])

    def with_pairs(self, proposals: Sequence[Proposal]) -> list[Proposal]:
        """The proposals, with pairs of the best ones where no single one is likely to decide."""
        if proposals[0].power > CLEAR:
            return list(proposals)
        joined = [one.change.joined(other.change) for one, other in combinations(proposals[:JOINED], 2)]
        pairs = self.proposals([change for change in joined if change is not None], refined=True)
        return self.ranked([*proposals, *pairs])

    def _remaining(self, proposal: Proposal) -> float:
        """Geometric mean of the standard errors over today's, of the values that both determine."""
        today = self.today()  # an error that rounding left without a variance is none
        ratios = [stderr / today[name] for name, stderr in proposal.stderr.items() if stderr > 0 < today.get(name, 0.0)]
        return float(np.exp(np.mean(np.log(ratios)))) if ratios else 1.0

    def _proposal(self, change: SetUpChange, refined: bool) -> Proposal | None:
        design = self.design(change)
        found = power_of(self.rivals, design, np.random.default_rng(self.seed), refined)
        if found is None:
            return None
        alone = len(self.rivals) < 2
        cost = self.costs.get(change.name, 1.0)
        return Proposal(
            change,
            float("nan") if alone else found.overall,
            {} if alone else found.by_name,
            _errors_after(found.clips[0], design),
            cost,
            design.t_s,
            _differences(found, design),
        )


def _errors_after(clip: PredictedClip, design: Design) -> dict[str, float]:
    """Standard errors of the shared values with both clips, in today's scale."""
    count = len(clip.roles.shared)
    if not count:
        return {}
    rows = np.concatenate([clip.columns, clip.priors])
    own = rows[:, count:]
    inside = np.linalg.qr(own)[0] if own.size else np.zeros((len(rows), 0))
    rest = rows[:, :count] - inside @ (inside.T @ rows[:, :count])
    covariance = np.linalg.inv(rest.T @ rest)
    root = clip.root
    scale = np.array([clip.roles.factors[name] for name in clip.roles.shared])
    errors = np.sqrt(np.maximum(np.diag(root @ covariance @ root.T), 0.0)) / np.abs(scale)
    return {name: float(error) for name, error in zip(clip.roles.shared, errors, strict=True)}


def _differences(found: Power, design: Design) -> dict[str, Array]:
    """What each rival predicts less what the first does, after a refit of its values to that."""
    first, *others = found.clips
    return {other.rival.name: imitating(other, first.centre, design, 1).seen - first.seen for other in others}
