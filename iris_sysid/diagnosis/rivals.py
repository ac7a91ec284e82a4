"""The rivals of an effect: what explains the data as well in its place."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from iris_sysid.diagnosis.component_support import ComponentSupport
from iris_sysid.diagnosis.contributions import WINS, Contributions
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.held_out_blocks import ALIKE, wins
from iris_sysid.diagnosis.refit import ModelWithEffects
from iris_sysid.types import Effect

EVEN = 0.5  # share of block bootstraps in which a named effect must predict better than a flexible rival
RIVALS = 3  # of an effect that are refitted
MAIN_SHARE = 0.75  # of the residual's squares to be explained where the rest could be the same in another form
AS_WELL = 0.9  # of what an effect explains: on a motion that never turns, one that explains this share is as good


class Rivals:
    """What explains the data as well as an effect of a model.

    Parameters
    ----------
    cache
        Refits of the clips.
    contributions
        What each effect explains.
    support
        What the components say of it.
    """

    def __init__(self, cache: FitCache, contributions: Contributions, support: ComponentSupport) -> None:
        self._cache, self._shares, self._support = cache, contributions, support

    def odds(self, model: ModelWithEffects, effect: Effect) -> dict[str, float]:
        """The probability of an effect and of each that predicts blocks left out as well, in its place or alone."""
        return self.with_alone(self._wins(model, effect), model, effect, sure=False)

    def with_alone(
        self, odds: Mapping[str, float], model: ModelWithEffects, effect: Effect, *, sure: bool
    ) -> dict[str, float]:
        """The probabilities of an effect and its rivals, with those that alone explain as much; the sum is the same.

        Parameters
        ----------
        odds
            By name, of the effect and its rivals.
        model, effect
            What they belong to.
        sure
            Whether the size of the noise is known.
        """
        more = [name for name in self.as_good_alone(model, effect, sure=sure) if name not in odds]
        whole = len(odds) + len(more)
        return {name: share * len(odds) / whole for name, share in odds.items()} | dict.fromkeys(more, 1.0 / whole)

    def instead_of(self, model: ModelWithEffects, effect: Effect, names: Collection[str]) -> list[ModelWithEffects]:
        """The refits there are of a model with one of some rivals in the place of an effect, of possible sizes."""
        rest = model.names - {effect.name}
        wanted = {rest | {name} for name in names if name not in model.names}
        return [each for each in self._cache.tried if each.names in wanted and self._shares.allows(each)]

    def _wins(self, model: ModelWithEffects, effect: Effect) -> dict[str, float]:
        """The share of bootstraps that an effect wins, and each that predicts as well in its place.

        They are compared in the model in which the effect counts for most.
        """
        contexts = self._shares.contexts(model, effect)
        model = max(contexts, key=lambda each: np.nan_to_num(self._shares.removed_in(each, effect)))
        rest = self._cache.without(model, effect)
        if not rest.usable:
            return {effect.name: 1.0}
        screening = self._cache.screening(rest)
        others = {name: self._cache.with_added(rest, screening.single(name)) for name in self._worth(rest, effect)}
        errors = {name: self._shares.estimate(rival) for name, rival in others.items() if self._shares.allows(rival)}
        own = self._shares.estimate(model)
        near = {name: each for name, each in errors.items() if own.share_below(each) < self._least_wins(name)}
        shares = wins({effect.name: own, **near})
        exact = [name for name in screening.parallel(effect.name) if name not in shares and name not in model.names]
        each = shares[effect.name] / (1 + len(exact))
        return {**shares, effect.name: each, **dict.fromkeys(exact, each)}

    def _least_wins(self, name: str) -> float:
        return EVEN if self._cache.library.by_name[name].is_flexible else WINS

    def _worth(self, rest: ModelWithEffects, effect: Effect) -> list[str]:
        """The rivals of an effect that are refitted: the best of its component, and the best of all."""
        screening, testable = self._cache.screening(rest), self._cache.testable(rest)
        allowed = [
            name
            for name in screening.names
            if name in testable
            and name != effect.name
            and (self._cache.library.allows(screening.single(name)) or rest.far_off)
        ]
        best = sorted(allowed, key=lambda name: -screening.score(name).gain)[:RIVALS]
        same = [name for name in allowed if self._cache.library.by_name[name].component == effect.component][:RIVALS]
        return list(dict.fromkeys([*same, *best]))

    def as_good_alone(self, model: ModelWithEffects, effect: Effect, *, sure: bool) -> list[str]:
        """Effects that alone explain about as much as one does alone, where that is most of the residual.

        What can imitate anything by its shape must explain more. Where the size of the noise is known, a likelihood
        tells effects apart, but not what imitates anything from formulas. On a motion that never turns, a force or a
        reading that depends on anything is a function of the time: each effect is tried, and is as good as a component
        would be.
        """
        base, removed = self._cache.base.squares, self._shares.alone(model, effect)
        if self._support.never_turns and not sure:
            alone, formulas = self._each_alone(), base * (1.0 - AS_WELL * removed)
            absorbing = formulas
        else:
            alone = [each for each in self._cache.tried if len(each.effects) == 1]
            itself, most = base * (1.0 - removed), base * (1.0 - MAIN_SHARE)
            formulas = ALIKE * itself if itself < most else 0.0  # squares below which one with a formula is as good
            absorbing = itself if itself < most and not sure else 0.0  # and one that imitates anything
            if sure:
                formulas = (formulas if self._support.turns else most) if effect.absorbs else 0.0
        good = [
            each
            for each in alone
            if self._shares.allows(each) and each.squares < (absorbing if each.effects[0].is_flexible else formulas)
        ]
        names = [each.effects[0].name for each in good if each.effects[0].name != effect.name]
        return list(dict.fromkeys([*names, *self._exchangeable(model, effect)]))

    def _each_alone(self) -> list[ModelWithEffects]:
        """Refits of each effect alone that the parameters cannot imitate."""
        screening, testable = self._cache.screening(self._cache.base), self._cache.testable(self._cache.base)
        candidates = [screening.single(name) for name in screening.names if name in testable]
        allowed = [each for each in candidates if self._cache.library.allows(each)]
        return [self._cache.with_added(self._cache.base, each) for each in allowed]

    def _exchangeable(self, model: ModelWithEffects, effect: Effect) -> list[str]:
        """Effects of the same model that alone explain as much as one does alone, and little beside it."""
        left = 1.0 - self._shares.alone(model, effect)
        return [
            other.name
            for other in model.effects
            if other is not effect
            and 1.0 - self._shares.alone(model, other) <= (left if other.is_flexible else ALIKE * left)
            and self._shares.is_small(model, other)
        ]
