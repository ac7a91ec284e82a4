"""Score tests of all clips together, and the effects and pairs of effects that they suggest to refit with."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import prod

from fitters.ode import FitRequest
from iris_sysid.diagnosis.refit import ModelWithEffects, Starts
from iris_sysid.diagnosis.score_test import (
    PARALLEL,
    Pair,
    Screen,
    combined,
    critical_value,
    in_one_shape,
    screen,
    shapes_in_common,
)
from iris_sysid.types import Effect, Score, chi2_isf

SINGLE_LEVEL = 0.04  # probability of adding a single effect to a complete model
PAIR_LEVEL = 0.01  # probability of adding a pair of effects to a complete model


@dataclass(frozen=True, eq=False, slots=True)
class Candidate:
    """Effects ``names`` that may be added at once, with their starting values ``starts``, one a clip.

    ``chi2`` is the first-order decrease of the chi-square for white noise; ``needed`` is the significant decrease.
    """

    names: tuple[str, ...]
    starts: tuple[Starts, ...]
    chi2: float
    needed: float

    @property
    def ratio(self) -> float:
        """First-order chi-square over the significant one: 1 is just significant for white noise."""
        return self.chi2 / self.needed


@dataclass(frozen=True, eq=False, slots=True)
class Screening:
    """The score tests, in all clips, of every effect that a model does not have yet.

    ``scores`` holds one score a clip for each effect, best effect first, its size as the first clip has it;
    ``library`` is the size of the library, ``factors`` by effect those on the size in each clip.
    """

    screens: tuple[Screen, ...]
    scores: tuple[tuple[Score, ...], ...]
    library: int
    factors: Mapping[str, tuple[float, ...]]

    @classmethod
    def of(cls, library: Collection[Effect], current: ModelWithEffects, clips: Sequence[FitRequest]) -> Screening:
        """Score every effect of the library that the model does not have."""
        effects = [effect for effect in library if effect.name not in current.names]
        common = shapes_in_common(effects, current.fits, [clip.trajectory for clip in clips])
        screens = tuple(
            screen(effects, fitted, clip.trajectory, common) for fitted, clip in zip(current.fits, clips, strict=True)
        )
        factors = {effect.name: tuple(current.factors(effect)) for effect in effects}
        scores = [
            tuple(score.over(factor) for score, factor in zip(in_one_shape(screens, name), by_clip, strict=True))
            for name, by_clip in factors.items()
        ]
        scores.sort(key=lambda by_clip: -combined(by_clip).gain)
        return cls(screens, tuple(scores), len(library), factors)

    @property
    def names(self) -> list[str]:
        """Names of the effects, best first."""
        return [first.effect for first, *_ in self.scores]

    @property
    def visible(self) -> frozenset[str]:
        """The effects that the fitted parameters cannot imitate, in every clip."""
        return frozenset.intersection(*(clip.visible for clip in self.screens))

    def score(self, name: str) -> Score:
        """The score of one effect in all clips."""
        return combined(self.scores_of(name))

    def scores_of(self, name: str) -> tuple[Score, ...]:
        """The scores of one effect, one a clip."""
        return next(by_clip for by_clip in self.scores if by_clip[0].effect == name)

    def single(self, name: str) -> Candidate:
        """One effect as a candidate: it starts from the common size and, in each clip, from its best shape."""
        scores = self.scores_of(name)
        joint = combined(scores)
        clips = zip(scores, self.factors[name], strict=True)
        starts = tuple({name: (factor * joint.size, score.shape)} for score, factor in clips)
        return Candidate((name,), starts, joint.chi2, self.needed(name))

    def needed(self, name: str) -> float:
        """The chi-square above which one effect is significant."""
        scores = self.scores_of(name)
        return critical_value(SINGLE_LEVEL / self.library, scores[0].tried ** len(scores)) ** 2

    def pairs(self, names: frozenset[str]) -> list[Candidate]:
        """All pairs of these effects, best first."""
        if not names:
            return []
        by_clip = [clip.pairs(names) for clip in self.screens]
        common = set.intersection(*(set(pairs) for pairs in by_clip))
        candidates = [self._pair(pair, [pairs[pair] for pairs in by_clip], len(by_clip[0])) for pair in common]
        return sorted(candidates, key=lambda candidate: (-candidate.ratio, candidate.names))

    def _pair(self, names: tuple[str, str], clips: Sequence[Pair], pairs: int) -> Candidate:
        """A candidate of two effects; ``pairs`` is the number of pairs that are tried."""
        degrees, total = sum(score.degrees for score in self.scores[0]), sum(score.total for score in self.scores[0])
        gain = min(sum(clip.gain for clip in clips) / total, 1.0 - 1e-12)
        tries = prod(self.scores_of(name)[0].tried for name in names) ** len(clips) * pairs
        starts = tuple(dict(zip(names, zip(clip.sizes, clip.shapes, strict=True), strict=True)) for clip in clips)
        return Candidate(names, starts, degrees * gain / (1.0 - gain), chi2_isf(PAIR_LEVEL / tries, 2))

    def parallel(self, name: str) -> list[str]:
        """Effects whose sensitivity is parallel to that of the named effect in every clip."""
        others = [other for other in self.names if other != name]
        return [other for other in others if all(abs(clip.cosine(name, other)) > PARALLEL for clip in self.screens)]
