"""The results of a finished search: indistinguishable effects, model-averaged sizes, limits, rejected effects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.diagnosis.evidence import cost_above, cost_of_value, credible
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.model_averaging import (
    CompetingEffect,
    averaged_over_alternatives,
    averaged_over_competitors,
    competing_effect,
)
from iris_sysid.diagnosis.notes import rejected_effect_note
from iris_sysid.diagnosis.refit import ModelWithEffects, pooled
from iris_sysid.diagnosis.selection_bias import corrected_for_selection
from iris_sysid.types import DiagnosticNote, Effect, Estimate, FitResult, Limit, Score, normal_isf


def holds_zero(size: Estimate) -> bool:
    """Whether the 95 % interval of a size holds zero, or there is none.

    An error of zero is none: a motion that is too sensitive to its values tells their errors no more.
    """
    low, high = size.interval
    return not (low > 0.0 or high < 0.0) or not size.stderr > 0.0


@dataclass(frozen=True, eq=False, slots=True)
class RivalModel:
    """A model with the effects ``instead`` of an added one; its criterion is ``above`` that of the final model."""

    model: ModelWithEffects
    instead: tuple[str, ...]
    above: float


class SearchReport:
    """The results of a finished search.

    Parameters
    ----------
    cache
        The refits of the search.
    final
        The model with which the search ended.
    """

    def __init__(self, cache: FitCache, final: ModelWithEffects) -> None:
        self._cache, self._final = cache, final
        self._screening = cache.screening(final)
        self._rivals: dict[str, list[RivalModel]] = {}
        self._classes: dict[str, dict[str, float]] = {}

    @property
    def final(self) -> ModelWithEffects:
        """The model that is reported on."""
        return self._final

    def _rivals_of(self, effect: Effect) -> list[RivalModel]:
        """The refits in which an effect of the class of an added one replaces it."""
        alike = self.indistinguishable(effect)
        return [rival for rival in self._tried_instead_of(effect) if {*rival.instead} <= {*alike}]

    def _tried_instead_of(self, effect: Effect) -> list[RivalModel]:
        """The refits in which another effect replaces an added one, compared once."""
        if effect.name not in self._rivals:
            cache, final = self._cache, self._final
            rest = cache.without(final, effect).names
            self._rivals[effect.name] = [
                RivalModel(model, tuple(sorted(model.names - rest)), cost_above(model, final))
                for model in cache.in_place_of(final, effect)
            ]
        return self._rivals[effect.name]

    def _every_rival(self) -> list[RivalModel]:
        return [rival for effect in self._final.effects for rival in self._rivals_of(effect)]

    def indistinguishable(self, effect: Effect) -> tuple[str, ...]:
        """The other effects of the class of an added one: all other added effects being in the model, one of them acts.

        See :func:`iris_sysid.diagnosis.evidence.credible`.
        """
        return tuple(name for name in self.probabilities(effect) if name != effect.name)

    def probabilities(self, effect: Effect) -> dict[str, float]:
        """The probability of an added effect and of each of its class, most probable first; one of them acts.

        It is that of refits. For effects that were not refitted it is by what they explain to first order.
        """
        if effect.name not in self._classes:
            self._classes[effect.name] = self._class_of(effect)
        return self._classes[effect.name]

    def _class_of(self, effect: Effect) -> dict[str, float]:
        above = {**self._above_to_first_order(effect), effect.name: 0.0}
        for rival in sorted(self._tried_instead_of(effect), key=lambda rival: -rival.above):
            above |= dict.fromkeys(rival.instead, rival.above)
        return credible(above | self._equivalent(effect), effect.name)

    def _equivalent(self, effect: Effect) -> dict[str, float]:
        """By how much the criterion of each effect is above that of an added one that can do exactly what it does.

        No data tell the two apart, in whatever minima their fits end.
        """
        library = self._cache.library.by_name
        parallel = self._cache.screening(self._cache.without(self._final, effect)).parallel(effect.name)
        imitated = {*self._screening.names} - self._screening.visible
        return {name: self._price(library[name]) - self._price(effect) for name in parallel if name in imitated}

    def _above_to_first_order(self, effect: Effect) -> dict[str, float]:
        """By how much the criterion of each effect that was not refitted is above that of an added one in its place."""
        cache, final, library = self._cache, self._final, self._cache.library
        rest = cache.without(final, effect)
        screening, tried = cache.screening(rest), cache.refitted(rest)
        names = [name for name in screening.names if name not in {effect.name, *tried} | final.names]
        explained = max(screening.score(effect.name).explained, rest.squares - final.squares)
        own = self._price(effect)
        return {
            name: (explained - screening.score(name).explained) / final.inflation
            + self._price(library.by_name[name])
            - own
            for name in names
            if library.allows(screening.single(name)) and screening.score(name).stderr > 0
        }

    def _price(self, effect: Effect) -> float:
        """The criterion of an effect beside what it explains: its values in each clip, and its odds before the data."""
        values = sum(not parameter.constant for parameter in effect.parameters) + effect.is_placed
        each_clip = sum(cost_of_value(fitted.n * len(fitted.rms)) for fitted in self._final.fits)
        return values * each_clip - 2.0 * float(np.log(effect.plausibility))

    def size(self, name: str) -> Estimate:
        """A size over all clips; its error allows for alternatives to the added effects, and for one more effect."""
        alternatives = [
            (pooled(rival.model.sizes_of(name)), rival.above)
            for rival in self._every_rival()
            if name in rival.model.sizes
        ]
        size = averaged_over_alternatives(self._unbiased(name), alternatives)
        return averaged_over_competitors(size, self._competing(name))

    def finals(self) -> tuple[FitResult, ...]:
        """The fits with the effects; the error of each value allows for the effects that may act instead of them.

        What explains the data as well may leave the model with another length or gravity.
        """
        rivals = self._every_rival()
        return tuple(
            replace(fitted, estimates=_averaged(fitted, [(rival.model.fits[k], rival.above) for rival in rivals]))
            for k, fitted in enumerate(self._final.fits)
        )

    def _unbiased(self, name: str) -> Estimate:
        """The size over all clips, corrected for being named only where it is significant."""
        size = pooled(self._final.sizes_of(name))
        named = [effect.name for effect in self._final.effects if effect.parameters[0].name == name]
        if not named:
            return size
        needed = self._cache.screening(self._cache.base).needed(named[0])
        return corrected_for_selection(size, float(np.sqrt(needed)))

    def _competing(self, name: str) -> list[CompetingEffect]:
        """How each effect that was not added would change a size, if its sign is allowed.

        Effects parallel to the effect of that size, or indistinguishable from it, do not compete: they may act instead
        of it, which its class says, and the size is that in the case that it acts.
        """
        own = next(
            effect for effect in self._final.effects if name in [parameter.name for parameter in effect.parameters]
        )
        parallel = self._cache.screening(self._cache.without(self._final, own)).parallel(own.name)
        instead = {*parallel, *self.indistinguishable(own)}
        allowed = [other for other in self._screening.names if other not in instead and self._allows(other)]
        competing = [
            competing_effect(self._screening.scores_of(other), name, self._final.independent) for other in allowed
        ]
        return [effect for effect in competing if effect is not None]

    def limit(self, score: Score) -> Limit:
        """The upper limit on the size of an effect that was not added, one-sided, at 95 % confidence."""
        upper = abs(score.size) + normal_isf(0.05) * score.stderr
        size = self._cache.library.by_name[score.effect].parameters[0].name
        return Limit(score.effect, size, max(upper, score.resolvable_size), score.unit)

    def rejected(self) -> tuple[DiagnosticNote, ...]:
        """Effects that would explain the residual, but with a forbidden sign or a size below their resolution."""
        names = [name for name in self._screening.names if self._screening.single(name).ratio > 1.0]
        wrong_sign = [self._screening.score(name) for name in names if not self._allows(name)]
        allowed = [self._screening.score(name) for name in names if self._allows(name)]
        too_small = [score for score in allowed if abs(score.size) < score.resolvable_size]
        return (
            *rejected_effect_note(wrong_sign, "rejected-sign"),
            *rejected_effect_note(too_small, "rejected-size"),
        )

    def _allows(self, name: str) -> bool:
        return self._cache.library.allows(self._screening.single(name))


def _averaged(fitted: FitResult, rivals: Sequence[tuple[FitResult, float]]) -> dict[str, Estimate]:
    """The estimates of a fit, the model's own averaged over other fits; with each, how far its criterion is above."""
    return {
        name: averaged_over_alternatives(
            estimate,
            [(rival.estimates[name], above) for rival, above in rivals if name in rival.free and name in fitted.free],
        )
        for name, estimate in fitted.estimates.items()
    }
