"""Stepwise search at the noise, where a likelihood can compare effects: additions, pairs and revisions.

Two effects may mask one another: each is significant only when the other is in the model. And an effect that was added
early may imitate two that are added later. So pairs are tried where no single effect is significant; and after each
addition every effect must still be significant, and better than its rivals, given all others.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from iris_sysid.diagnosis.evidence import DECISIVE, best_first, cost_above
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.measurement_errors import is_resolved
from iris_sysid.diagnosis.refit import ModelWithEffects, significance
from iris_sysid.types import Effect

MAX_ADDED = 4
MAX_REVISIONS = 4
FORMED = 2  # rivals of an effect that are tried in another form
FAR_LESS = 0.6  # fraction of the best first-order gain: a refit does not make up for a larger difference


class StepwiseSearch:
    """The search for the effects that the clips of a cache need.

    Parameters
    ----------
    cache
        Fits, score tests and prediction errors of every set of effects.

    Attributes
    ----------
    reached
        The models of the best path so far, the base first; what there is where the search is stopped.
    """

    def __init__(self, cache: FitCache) -> None:
        self._cache = cache
        self.reached: tuple[ModelWithEffects, ...] = (cache.base,)

    def run(self, start: ModelWithEffects, extend: bool) -> tuple[ModelWithEffects, ...]:
        """The models of each step: the base first, the last without any further significant effect.

        Parameters
        ----------
        start
            A model that explains much of the residual: its effects are compared with their rivals.
        extend
            Whether further effects may be added: only where the size of the noise is known.
        """
        revised = self._revised(start) if start.effects else start
        self.reached = (self._cache.base, revised) if revised.effects else (self._cache.base,)
        if extend:
            self.reached = tuple(self._continued(list(self.reached)))
        return self.reached

    def _continued(self, path: list[ModelWithEffects]) -> list[ModelWithEffects]:
        """The path, extended by significant effects step by step."""
        while len(path[-1].effects) < MAX_ADDED:
            longer = self._longer(path[-1])
            if longer is None:
                break
            current = self._in_another_form(path[-1], longer) or self._revised(longer)
            if current.key in {model.key for model in path}:
                break
            self._cache.report(f"added {', '.join(effect.name for effect in current.effects)}")
            path = [*path, current]
            if len(path) > len(self.reached):
                self.reached = tuple(path)
        return path

    def _in_another_form(self, current: ModelWithEffects, longer: ModelWithEffects) -> ModelWithEffects | None:
        """The model with another form of one of its effects, where that explains what one more effect would.

        A friction that is rounded off, or a drag of another power, does not call for a second effect.
        """
        best = best_first(self._formed([current]))[:1]
        return next((model for model in best if cost_above(model, longer) < DECISIVE), None)

    def _longer(self, current: ModelWithEffects) -> ModelWithEffects | None:
        """The model with the best effect, or pair, that is significant and predicts better; None when there is none."""
        single = next(self._singles(current), None)
        return single or next(self._pairs(current), None)  # pairs are fitted only where no single effect qualifies

    def _singles(self, current: ModelWithEffects) -> Iterator[ModelWithEffects]:
        """The model with one more effect that is significant and predicts better, best first.

        Effects with a far smaller first-order gain are refitted only where none of the others qualifies.
        """
        screening, testable = self._cache.screening(current), self._cache.testable(current)
        singles = [(screening.score(name).gain, screening.single(name)) for name in screening.names if name in testable]
        allowed = [(gain, single) for gain, single in singles if self._cache.library.allows(single)]
        least = FAR_LESS * max((gain for gain, _ in allowed), default=0.0)
        if current.far_off:  # a strong drag explains little along a fall without drag
            allowed, least = singles, 0.0
        near, far = ([single for gain, single in allowed if (gain >= least) == close] for close in (True, False))
        for group in (near, far):
            for model in self._cache.refits(current, group):
                if self._is_needed(model, model.effects[-1]) and self._predicts_better(model, current):
                    yield model

    def _pairs(self, current: ModelWithEffects) -> Iterator[ModelWithEffects]:
        """The model with two more effects that are significant as a pair and each given the other, best first."""
        if len(current.effects) + 2 > MAX_ADDED:
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
        """Whether an effect is significant given all others, and larger than the stated errors."""
        rest = self._cache.without(current, effect)
        if not rest.usable:
            return True
        fits = zip(rest.fits, current.fits, self._cache.clips, strict=True)
        if not any(is_resolved(before, after, clip.trajectory) for before, after, clip in fits):
            return False
        # as many shapes are tried as in the base, whatever the other effects
        needed = self._cache.screening(self._cache.base).needed(effect.name)
        return significance(rest, current, [effect]) ** 2 > needed

    def _revised(self, current: ModelWithEffects) -> ModelWithEffects:
        """The model without effects that are no longer needed, and with better rivals substituted."""
        for _ in range(MAX_REVISIONS):
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
        usual = self._cache.with_usual_form(current, effect)  # it may have made up for what was added since
        if usual is not None and usual.usable and cost_above(usual, current) < 0.0:
            return usual
        rivals = self._cache.rivals(rest, effect)
        better = _likelier(current, rivals)
        if better or not current.at_noise:  # one may lack no more than its form
            better += _likelier(current, self._formed([current, *rivals[:FORMED]]))
        return next(iter(best_first(better)), None)

    def _formed(self, models: Sequence[ModelWithEffects]) -> list[ModelWithEffects]:
        """The models with the form of one of their effects fitted as well."""
        formed = [self._cache.with_free_form(model, effect) for model in models for effect in model.effects]
        found = filter(None, formed)
        return [model for model in found if model.usable and self._cache.library.allows_fit(model)]

    def _predicts_better(self, candidate: ModelWithEffects, current: ModelWithEffects) -> bool:
        """Whether samples that were left out are predicted better; false where none can be left out."""
        return self._cache.validation_error(candidate) < self._cache.validation_error(current)


def _likelier(current: ModelWithEffects, rivals: Sequence[ModelWithEffects]) -> list[ModelWithEffects]:
    """The rivals that are decisively likelier."""
    return [rival for rival in rivals if cost_above(current, rival) > DECISIVE]
