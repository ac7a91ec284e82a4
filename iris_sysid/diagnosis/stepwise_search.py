"""Stepwise search for missing effects: one at a time, two at once where no single one is significant, with revisions.

An effect that hides behind another is significant only when both are there, and one that was added early may be a
substitute for two that came later. So pairs are tried where no single effect is significant, and after each addition
every effect must still be significant, and better than its rivals, beside all the others.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.measurement_errors import is_resolved
from iris_sysid.diagnosis.refit import ModelWithEffects, significance
from iris_sysid.types import Effect

MOST_ADDED = 4
MOST_REVISIONS = 4
FAR_LESS = 0.6  # of the gain to first order of the best: no refit makes up for that
SAMPLES_A_PART = 10  # of a clip that is cut into short parts, the ends of which are held out


class StepwiseSearch:
    """The search for the effects that the clips of a cache need.

    Parameters
    ----------
    cache
        Fits, score tests and prediction errors of every set of effects.
    """

    def __init__(self, cache: FitCache) -> None:
        self._cache = cache

    def run(self) -> tuple[ModelWithEffects, ...]:
        """The models on the way: the base, then with more and more effects, until nothing is significant."""
        base = self._cache.base
        path = self._continued([base])
        pairs = self._cache.screening(base).pairs(self._cache.testable(base)) if len(path[-1].effects) > 1 else []
        if not pairs or path[-1].names == set(pairs[0].names):
            return tuple(path)
        best = next(self._pairs(base), path[-1])
        other = self._continued([base, best])
        return tuple(path if path[-1].cost <= other[-1].cost else other)

    def _continued(self, path: list[ModelWithEffects]) -> list[ModelWithEffects]:
        """The path, continued with what is significant at its end, step by step."""
        while len(path[-1].effects) < MOST_ADDED:
            longer = self._longer(path[-1])
            if longer is None:
                break
            current = self._revised(longer)
            if current.names in {model.names for model in path}:
                break
            self._cache.report(f"added {', '.join(effect.name for effect in current.effects)}")
            path = [*path, current]
        return path

    def _longer(self, current: ModelWithEffects) -> ModelWithEffects | None:
        """The model with the effect, or the pair, that explains most and predicts better; None when none does."""
        single = next(self._singles(current), None)
        return single or next(self._pairs(current), None)  # pairs are fitted only where no single effect will do

    def _singles(self, current: ModelWithEffects) -> Iterator[ModelWithEffects]:
        """The model with one more effect that is significant and predicts better, best first.

        What explains far less than another is refitted only where that one will not do.
        """
        screening, testable = self._cache.screening(current), self._cache.testable(current)
        singles = [(screening.score(name).gain, screening.single(name)) for name in screening.names if name in testable]
        allowed = [(gain, single) for gain, single in singles if self._cache.library.allows(single)]
        least = FAR_LESS * max((gain for gain, _ in allowed), default=0.0)
        near, far = ([single for gain, single in allowed if (gain >= least) == close] for close in (True, False))
        for group in (near, far):
            for model in self._cache.refits(current, group):
                if self._is_needed(model, model.effects[-1]) and self._predicts_better(model, current):
                    yield model

    def _pairs(self, current: ModelWithEffects) -> Iterator[ModelWithEffects]:
        """The model with two more effects that are significant at once, and each beside the other, best first."""
        if len(current.effects) + 2 > MOST_ADDED:
            return
        candidates = self._cache.screening(current).pairs(self._cache.testable(current))
        needed = {frozenset(candidate.names): candidate.needed for candidate in candidates}
        for model in self._cache.refits(current, candidates):
            added = model.effects[-2:]
            if (
                significance(current, model, added) ** 2 > needed[model.names - current.names]
                and all(self._is_needed(model, effect) for effect in added)
                and self._predicts_better(model, current)
            ):
                yield model

    def _is_needed(self, current: ModelWithEffects, effect: Effect) -> bool:
        """Whether an effect is significant beside all the others, and larger than the stated errors."""
        rest = self._cache.without(current, effect)
        if not rest.usable:
            return True
        fits = zip(rest.fits, current.fits, self._cache.clips, strict=True)
        if not any(is_resolved(before, after, clip.trajectory) for before, after, clip in fits):
            return False
        # as many shapes are tried as in the base, whatever else is there
        needed = self._cache.screening(self._cache.base).needed(effect.name)
        return significance(rest, current, [effect]) ** 2 > needed

    def _revised(self, current: ModelWithEffects) -> ModelWithEffects:
        """The model without effects that are no longer needed, and with better rivals in their place."""
        for _ in range(MOST_REVISIONS if len(current.effects) > 1 else 0):
            better = next(filter(None, (self._revision(current, effect) for effect in current.effects)), None)
            if better is None:
                break
            current = better
        return current

    def _revision(self, current: ModelWithEffects, effect: Effect) -> ModelWithEffects | None:
        rest = self._cache.without(current, effect)
        if not rest.usable:
            return None
        if not self._is_needed(current, effect) and self._cache.library.allows_fit(rest):
            return rest
        better = [rival for rival in self._cache.rivals(rest, effect) if rival.cost < current.cost - rival.margin]
        return min(better, key=lambda rival: rival.cost, default=None)

    def _predicts_better(self, candidate: ModelWithEffects, current: ModelWithEffects) -> bool:
        """Whether held-out samples are predicted better; true where none can be held out.

        The end of a short clip, or what acts at one moment in it, can often not be learnt from the beginning: it is
        enough when the ends of many short parts are predicted better.
        """
        parts = max(min(fitted.n for fitted in current.fits) // SAMPLES_A_PART, 1)
        for count in (1, parts):
            after, before = (self._cache.errors(model, count).weighed for model in (candidate, current))
            if after < before or np.isnan(before):
                return True
        return False
