"""The search for the effects that a model lacks: one at a time, two where one alone does not show, and over again.

An effect that hides behind another is seen only when both are there, and one that was added early may be a stand-in
for two that came later. So pairs are tried where no single effect is significant, and after each addition every
effect must still be significant, and better than its rivals, beside all the others.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from math import prod

import numpy as np
from scipy.stats import chi2

from iris_sysid.diagnosis.measurement_errors import stands_out
from iris_sysid.diagnosis.model_averaging import Companion, among, beside, companion
from iris_sysid.diagnosis.notes import TOO_FAINT, WRONG_SIGN, why, would_take
from iris_sysid.diagnosis.refit import (
    Clip,
    Errors,
    Starts,
    State,
    errors_of,
    pooled,
    refitted,
    sizes_of,
    standard_errors,
)
from iris_sysid.diagnosis.score_test import ALIKE, Score, Screen, combined, screen, significant_from
from iris_sysid.types import Effect, Estimate, OdeModel

SINGLE_LEVEL = 0.04  # chance of adding a single effect to a model that lacks nothing
PAIR_LEVEL = 0.01  # and of adding two together
MOST_ADDED = 4
MOST_REVISIONS = 4
REFITTED = 4  # best of the screen that are refitted in each round, and of the pairs
WORTH_REFITTING = 0.7  # of the chi-square that is significant; a refit can find more than the first order shows
NEARLY = 0.2  # less of the gain to first order than another's; a refit can be that much better
FAR_LESS = 0.6  # of the gain to first order of the best: no refit makes up for that
SAMPLES_A_PART = 10  # of a clip that is cut into short parts, the ends of which are held out


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """Effects that may be added together, ``names``, from ``starts``, one a clip.

    ``chi2`` is what they would take off the chi-square of white noise, to first order, ``needed`` what is significant.
    """

    names: tuple[str, ...]
    starts: tuple[Starts, ...]
    chi2: float
    needed: float

    @property
    def ratio(self) -> float:
        """1 where the first order is significant for white noise."""
        return self.chi2 / self.needed


@dataclass(frozen=True, eq=False, slots=True)
class Screened:
    """The screens of all clips, of all effects of a library of so many that a state does not have yet.

    ``scores`` holds one a clip for each effect, best effect first.
    """

    screens: tuple[Screen, ...]
    scores: tuple[tuple[Score, ...], ...]
    library: int

    @classmethod
    def of(cls, library: Collection[Effect], current: State, clips: Sequence[Clip]) -> Screened:
        """Screen what a state leaves over."""
        left = [one for one in library if one.name not in current.names]
        screens = tuple(screen(left, fit, clip.trajectory) for fit, clip in zip(current.fits, clips, strict=True))
        together = [tuple(each.scores[one.name] for each in screens) for one in left]
        together.sort(key=lambda one: -combined(one).gain)
        return cls(screens, tuple(together), len(library))

    @property
    def names(self) -> list[str]:
        """The effects, best first."""
        return [one[0].effect for one in self.scores]

    @property
    def visible(self) -> frozenset[str]:
        """The effects that the fitted parameters cannot imitate, in every clip."""
        return frozenset.intersection(*(one.visible for one in self.screens))

    def single(self, name: str) -> Candidate:
        """One effect, from the size that all clips give and the shape that explains most in each."""
        scores = self._scores_of(name)
        together = combined(scores)
        starts = tuple({name: (together.size, one.shape)} for one in scores)
        return Candidate((name,), starts, together.chi2, self.needed(name))

    def needed(self, name: str) -> float:
        """The chi-square from which one effect is significant."""
        scores = self._scores_of(name)
        return significant_from(SINGLE_LEVEL / self.library, scores[0].tried ** len(scores)) ** 2

    def _scores_of(self, name: str) -> tuple[Score, ...]:
        return next(one for one in self.scores if one[0].effect == name)

    def pairs(self, names: frozenset[str]) -> list[Candidate]:
        """All pairs of these effects, best first."""
        if not names:
            return []
        each = [one.pairs(names) for one in self.screens]
        tried = {one[0].effect: one[0].tried for one in self.scores}
        degrees, total = (sum(one) for one in zip(*((s.degrees, s.total) for s in self.scores[0]), strict=True))
        found = []
        for pair in set.intersection(*(set(one) for one in each)):
            clips = [one[pair] for one in each]
            share = min(sum(one.gain for one in clips) / total, 1.0 - 1e-12)
            tries = prod(tried[name] for name in pair) ** len(clips) * len(each[0])
            starts = tuple(dict(zip(pair, zip(one.sizes, one.shapes, strict=True), strict=True)) for one in clips)
            needed = float(chi2.isf(PAIR_LEVEL / tries, 2))
            found.append(Candidate(pair, starts, degrees * share / (1.0 - share), needed))
        return sorted(found, key=lambda one: (-one.ratio, one.names))

    def taking(self, chi2: float) -> list[str]:
        """Effects that take more than this off the chi-square, to first order."""
        return [one[0].effect for one in self.scores if combined(one).chi2 > chi2]

    def parallel(self, name: str) -> list[str]:
        """Effects whose sensitivity is parallel to that of the one named, in every clip."""
        others = [one for one in self.names if one != name]
        return [one for one in others if all(abs(each.cosine(name, one)) > ALIKE for each in self.screens)]


def two_sided(effect: Effect) -> Effect:
    """The effect with a size that may be fitted below zero too, so that sizes near zero have no bias."""
    size, *rest = effect.parameters
    return replace(effect, parameters=(replace(size, lower=-np.inf), *rest)) if size.lower == 0.0 else effect


class Search:
    """The search in one set of clips; every set of effects is fitted once.

    Parameters
    ----------
    clips
        What is asked of each.
    model
        The governing equation to question.
    library
        The effects that it may lack.
    base
        The fits without any.
    holdout
        Share of each clip that is held out.
    say
        Told each step in words.
    """

    def __init__(
        self,
        clips: Sequence[Clip],
        model: OdeModel,
        library: Sequence[Effect],
        base: State,
        holdout: float,
        say: Callable[[str], None],
    ) -> None:
        self.clips, self.model, self.library = clips, model, {one.name: two_sided(one) for one in library}
        self._one_sided = frozenset(one.name for one in library if one.parameters[0].lower == 0.0)
        self.base, self.holdout, self.say = base, holdout, say
        self._states: dict[frozenset[str], State] = {base.names: base}
        self._screened: dict[frozenset[str], Screened] = {}
        self._errors: dict[tuple[frozenset[str], int], Errors] = {}

    def run(self) -> tuple[State, ...]:
        """The states on the way: the base, with more and more effects, until nothing is significant."""
        path = self._onwards([self.base])
        first = self.screened(self.base).pairs(self._candidates(self.base)) if len(path[-1].effects) > 1 else []
        if not first or path[-1].names == set(first[0].names):
            return tuple(path)
        best = next(self._pairs(self.base), path[-1])
        other = self._onwards([self.base, best])
        return tuple(path if path[-1].cost <= other[-1].cost else other)

    def _onwards(self, path: list[State]) -> list[State]:
        """The path with what is significant at its end, step by step."""
        while len(path[-1].effects) < MOST_ADDED:
            longer = self._longer(path[-1])
            if longer is None:
                break
            current = self._revised(longer)
            if current.names in {one.names for one in path}:
                break
            self.say(f"added {', '.join(one.name for one in current.effects)}")
            path = [*path, current]
        return path

    @property
    def failed(self) -> list[str]:
        """A text for each effect that could not be added to the base alone."""
        alone = [one for one in self._states.values() if len(one.effects) == 1 and not one.usable]
        first = [(one.effects[0].name, next(fit for fit in one.fits if not fit.usable)) for one in alone]
        return [f"the refit with {name} is {fit.status}{why(fit)}" for name, fit in first]

    def refused(self, final: State) -> list[str]:
        """What is left, in words, where effects would explain it with a sign that makes them something else."""
        found = self.screened(final)
        asked = [one for one in found.scores if found.single(one[0].effect).ratio > 1.0]
        wrong = [combined(one) for one in asked if not self._may_be(found.single(one[0].effect))]
        faint = [combined(one) for one in asked if self._may_be(found.single(one[0].effect))]
        faint = [one for one in faint if abs(one.size) < one.stands_out]
        return [*would_take(wrong, WRONG_SIGN), *would_take(faint, TOO_FAINT)]

    def _may_be(self, candidate: Candidate) -> bool:
        """Whether no effect that only takes energy away, or lets water out, has a size below zero."""
        return all(
            start[name][0] >= 0.0 for start in candidate.starts for name in self._one_sided & set(candidate.names)
        )

    def _makes_sense(self, state: State) -> bool:
        """The same of the sizes that were fitted, over all clips."""
        sizes = [one.parameters[0].name for one in state.effects if one.name in self._one_sided]
        return all(pooled(sizes_of(state.fits, name)).value >= 0.0 for name in sizes)

    def screened(self, current: State) -> Screened:
        """The screen of every effect that is not there yet."""
        if current.names not in self._screened:
            self.say(f"screening {len(self.library) - len(current.effects)} effects")
            self._screened[current.names] = Screened.of(self.library.values(), current, self.clips)
        return self._screened[current.names]

    def errors(self, current: State, parts: int = 1) -> Errors:
        """The errors of a state, what is held out being the ends of so many parts of each clip."""
        key = current.names, parts
        if key not in self._errors:
            self._errors[key] = errors_of(self.clips, current, self.holdout, parts)
        return self._errors[key]

    def equals(self, final: State, effect: Effect) -> tuple[str, ...]:
        """Effects that explain the data as well as one of those added, beside all the others.

        When refitted in its place, by a parallel sensitivity, or by what they take off the chi-square to first order.
        """
        rest = self._without(final, effect)
        rivals, found = self._as_good(final, effect), self.screened(rest)
        enough = max(found.single(effect.name).chi2, rest.cost - final.cost) - final.margin
        others = [*found.parallel(effect.name), *found.taking(enough)]
        alike = [one for one in others if self._may_be(found.single(one))]
        names = dict.fromkeys([*(one.effects[-1].name for one in rivals), *alike])
        return tuple(one for one in names if one not in final.names)

    def size(self, final: State, name: str) -> Estimate:
        """A value over all clips, with what may be there instead, or as well, in its error."""
        as_good = [one for effect in final.effects for one in self._as_good(final, effect) if name in one.sizes]
        others = [(pooled(sizes_of(one.fits, name)), one.cost - final.cost) for one in as_good]
        return beside(among(pooled(sizes_of(final.fits, name)), others), self._companions(final, name))

    def _companions(self, final: State, name: str) -> list[Companion]:
        """What each effect that was not added would do to a size, if it were there with a sign that makes sense.

        Those whose sensitivity is parallel to that of its effect are no company: they are named beside it.
        """
        own = next(one for one in final.effects if any(name == parameter.name for parameter in one.parameters))
        found, alike = self.screened(final), self.screened(self._without(final, own)).parallel(own.name)
        asked = [
            one for one in found.scores if one[0].effect not in alike and self._may_be(found.single(one[0].effect))
        ]
        each = [companion(one, name, final.independent) for one in asked]
        return [one for one in each if one is not None]

    def _as_good(self, final: State, effect: Effect) -> list[State]:
        """The states with another effect in place of one of those added, that explain the data as well."""
        rivals = self._rivals(self._without(final, effect), effect)
        return [one for one in rivals if one.names != final.names and one.cost - final.cost < final.margin]

    def _longer(self, current: State) -> State | None:
        """The state with the effect, or the pair, that explains most and predicts better; None when none does."""
        single = next(self._singles(current), None)
        return single or next(self._pairs(current), None)  # pairs are fitted only where no single effect will do

    def _candidates(self, current: State) -> frozenset[str]:
        """What the model itself can imitate cannot be told from it, whatever else is added."""
        return self.screened(self.base).visible & self.screened(current).visible

    def _singles(self, current: State) -> Iterator[State]:
        """The state with an effect added that is significant and predicts better, best first.

        What explains far less than another is refitted only where that one will not do.
        """
        found, names = self.screened(current), self._candidates(current)
        each = [(combined(one).gain, found.single(one[0].effect)) for one in found.scores if one[0].effect in names]
        sensible = [(gain, one) for gain, one in each if self._may_be(one)]
        enough = FAR_LESS * max((gain for gain, _ in sensible), default=0.0)
        near, far = ([one for gain, one in sensible if (gain >= enough) == close] for close in (True, False))
        for group in (near, far):
            for one in self._refitted(current, group):
                if self._is_needed(one, one.effects[-1]) and self._predicts_better(one, current):
                    yield one

    def _rivals(self, rest: State, effect: Effect) -> list[State]:
        """The state with each of the effects in place of one that explain nearly as much to first order, or more."""
        found, names = self.screened(rest), self._candidates(rest)
        gains = {one[0].effect: combined(one).gain for one in found.scores}
        near = [one for one in names if gains[one] > (1.0 - NEARLY) * gains[effect.name]]
        candidates = [found.single(name) for name in gains if name in near]
        return self._refitted(rest, candidates)

    def _refitted(self, current: State, candidates: Sequence[Candidate]) -> list[State]:
        """The state with each of the candidates that are worth it, best first."""
        worth = [one for one in candidates if one.ratio > WORTH_REFITTING and self._may_be(one)][:REFITTED]
        usable = [state for state in (self._with(current, one) for one in worth) if state.usable]
        return sorted(filter(self._makes_sense, usable), key=lambda one: one.cost)

    def _with(self, current: State, candidate: Candidate) -> State:
        """The state with effects added."""
        effects = [*current.effects, *(self.library[name] for name in candidate.names)]
        return self._fitted(current, effects, candidate.starts, candidate.names)

    def _without(self, current: State, effect: Effect) -> State:
        """The state with one of its effects taken away."""
        left = [one for one in current.effects if one.name != effect.name]
        nothing: list[Starts] = [{}] * len(self.clips)
        if len(left) != 1:
            return self._fitted(current, left, nothing, ())
        alone = self._with(self.base, self.screened(self.base).single(left[0].name))  # as wherever it is fitted
        if not alone.usable:
            alone = refitted(self.clips, current, self.model, left, nothing)
            self._states[alone.names] = alone
        return alone

    def _fitted(
        self, current: State, effects: Sequence[Effect], starts: Sequence[Starts], added: Sequence[str]
    ) -> State:
        """The state with these effects; fitted from where another is, unless it was fitted before."""
        key = frozenset(one.name for one in effects)
        if key not in self._states:
            if added:
                self.say(f"refitting with {', '.join(added)}")
            self._states[key] = refitted(self.clips, current, self.model, effects, starts)
        return self._states[key]

    def _pairs(self, current: State) -> Iterator[State]:
        """The state with two effects that are significant together, and each beside the other, best first."""
        if len(current.effects) + 2 > MOST_ADDED:
            return
        candidates = self.screened(current).pairs(self._candidates(current))
        needed = {frozenset(one.names): one.needed for one in candidates}
        for both in self._refitted(current, candidates):
            added = both.effects[-2:]
            if (
                standard_errors(current, both, added) ** 2 > needed[both.names - current.names]
                and all(self._is_needed(both, effect) for effect in added)
                and self._predicts_better(both, current)
            ):
                yield both

    def _is_needed(self, current: State, effect: Effect) -> bool:
        """Whether an effect is significant beside all the others, and more than the errors stated may be."""
        rest = self._without(current, effect)
        if not rest.usable:
            return True
        each = zip(rest.fits, current.fits, self.clips, strict=True)
        if not any(stands_out(before, after, clip.trajectory) for before, after, clip in each):
            return False
        needed = self.screened(self.base).needed(effect.name)  # so many shapes are tried, whatever else is there
        return standard_errors(rest, current, [effect]) ** 2 > needed

    def _revised(self, current: State) -> State:
        """The state without effects that are no longer needed, and with rivals that do better in their place."""
        for _ in range(MOST_REVISIONS if len(current.effects) > 1 else 0):
            better = next(filter(None, (self._revision(current, one) for one in current.effects)), None)
            if better is None:
                break
            current = better
        return current

    def _revision(self, current: State, effect: Effect) -> State | None:
        rest = self._without(current, effect)
        if not rest.usable:
            return None
        if not self._is_needed(current, effect) and self._makes_sense(rest):
            return rest
        rivals = [one for one in self._rivals(rest, effect) if one.cost < current.cost - one.margin]
        return min(rivals, key=lambda one: one.cost, default=None)

    def _predicts_better(self, candidate: State, current: State) -> bool:
        """Whether held-out samples are predicted better; true where there are none, as no part of the clip is held out.

        The end of a short clip, or what acts at one moment in it, can often not be learnt from the beginning: it is
        enough when the ends of many short parts are predicted better.
        """
        parts = max(min(one.n for one in current.fits) // SAMPLES_A_PART, 1)
        for count in (1, parts):
            now, before = (self.errors(one, count).weighed for one in (candidate, current))
            if now < before or np.isnan(before):
                return True
        return False
