"""The search for the effects that improve the prediction of blocks left out.

Effects with a formula come first, one or two at a time, ranked to first order beside a flexible rest and refitted; then
one effect in the place of several; then what can imitate a piece of anything.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import numpy as np

from iris_sysid.diagnosis.component_support import ComponentSupport, can_cause
from iris_sysid.diagnosis.contributions import Contributions, is_surely_better, removed_share, starts_of
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.held_out_blocks import ALIKE, MIN_SHARE, SURE
from iris_sysid.diagnosis.refit import ModelWithEffects
from iris_sysid.diagnosis.residual_components import ranked_effects
from iris_sysid.diagnosis.screening import Candidate
from iris_sysid.types import Component, Effect

MAX_EFFECTS = 3  # that are kept
AT_ONCE = 2  # effects that are tried together
TRIED = 4  # best sets that are refitted in each round
ABSORBING = 3  # best effects that imitate anything, refitted in each round
DISAGREES = 0.1  # factor on the odds of an effect of a kind that the components do not have


class EffectSearch:
    """The effects that the clips of a cache need, by what they predict.

    Parameters
    ----------
    cache
        Refits of the clips.
    contributions
        What each effect explains.
    support
        What the components say of it.

    Attributes
    ----------
    reached
        The best model so far; what there is where the search is stopped.
    """

    def __init__(self, cache: FitCache, contributions: Contributions, support: ComponentSupport) -> None:
        self._cache, self._shares, self._support = cache, contributions, support
        self.reached = cache.base

    def run(self) -> ModelWithEffects:
        """The model in the end; the base where no effect predicts better."""
        alone = self._alone()
        if alone is not None:
            self.reached = alone
            return alone
        current = self._in_one(self._pruned(self._with_formulas(self._cache.base)))
        if any(effect.absorbs for effect in current.effects):  # it took the place of formulas: others act beside it
            current = self._with_formulas(current)
        if current.effects and all(effect.absorbs for effect in current.effects):  # it may imitate two of them
            current = self._best(self._cache.base, [current, *self._of_parts()]) or current
        return self._with_nuisances(current)

    def _alone(self) -> ModelWithEffects | None:
        """The best single effect that explains the data to the noise; None where none does.

        Then no set is tried: a likelihood can tell there what else is needed. What can imitate anything counts where
        the motion turns and the components say that there is such a part.
        """
        base, library, support = self._cache.base, self._cache.library.by_name, self._support
        screening, formulas = self._cache.screening(base), self._formulas(base)[:TRIED]
        absorbing = [
            name for name in self.testable(base, absorbs=True) if support.turns and support.agrees(library[name])
        ]
        models = [self._cache.with_added(base, screening.single(name)) for name in (*formulas, *absorbing[:ABSORBING])]
        return self._best(base, [model for model in models if model.usable and model.explains])

    def testable(self, current: ModelWithEffects, *, absorbs: bool | None = None) -> list[str]:
        """The effects that can be tested beside a model, best first: all, with a formula, or that imitate anything."""
        testable, library = self._cache.testable(current), self._cache.library.by_name
        names = self._cache.screening(current).names
        return [name for name in names if name in testable and absorbs in (None, library[name].absorbs)]

    def _possible(self, current: ModelWithEffects, names: Sequence[str]) -> list[str]:
        """Those of a possible sign to first order; all where that tells nothing."""
        screening = self._cache.screening(current)
        return [name for name in names if self._cache.library.allows(screening.single(name)) or current.far_off]

    def _formulas(self, current: ModelWithEffects) -> list[str]:
        """Those with a formula that are of a possible sign."""
        return self._possible(current, self.testable(current, absorbs=False))

    def _evident(self, current: ModelWithEffects) -> list[str]:
        """Those that can imitate anything, where the components say that nearly all of the residual is of that kind."""
        library = self._cache.library.by_name
        return [name for name in self.testable(current, absorbs=True) if self._support.is_nearly_all(library[name])]

    def _with_formulas(self, current: ModelWithEffects) -> ModelWithEffects:
        """The model with the effects that have a formula and improve the prediction, one or two at a time."""
        while len(current.effects) < MAX_EFFECTS and not current.at_noise:
            models = [model for model in self._refits(current) if len(model.effects) <= MAX_EFFECTS]
            found = self._best(current, models)
            if found is None:
                break
            self.reached = current = found
        return current

    def _refits(self, current: ModelWithEffects) -> list[ModelWithEffects]:
        """Refits of the best sets of one and two more effects, ranked to first order beside a flexible rest."""
        library = self._cache.library.by_name
        screening, names = self._cache.screening(current), [*self._formulas(current), *self._evident(current)]
        effects = {name: (library[name], screening.scores_of(name)[0].shape) for name in names}
        odds = {name: float(np.log(library[name].plausibility)) for name in names}
        ranked = ranked_effects(self._cache.clips, current.fits, effects, odds, AT_ONCE)
        singles = [each for each in ranked if len(each.sizes) == 1]
        few = [each for each in ranked if each.sizes][:TRIED]
        located = [each for each in singles if self._support.shows(library[next(iter(each.sizes))])]
        chosen = [*few, *(each for each in [*singles[:AT_ONCE], *located[:TRIED]] if each not in few)]
        chosen = list({each.names: each for each in chosen}.values())
        models = [self._added(current, dict(each.sizes)) for each in chosen]
        freed = [each for each in current.effects if self._may_be_freed(current, each)]
        models += filter(None, (self._cache.with_free_form(current, each) for each in freed))
        if current.far_off:  # what an effect removes to first order tells little along a motion that is far off
            models += [self._cache.with_added(current, each) for each in self._cache.best_of(current, names)]
        return [model for model in models if self._shares.allows(model)]

    def _may_be_freed(self, current: ModelWithEffects, effect: Effect) -> bool:
        """Whether an effect was not found in another form near the usual one already."""
        if effect.nearby is None:
            return True
        first = self._cache.screening(self._cache.base).scores_of(effect.name)
        found = [start[effect.name][1] for start in starts_of(current, [effect])]
        return all(np.allclose(shape, score.shape) for shape, score in zip(found, first, strict=True))

    def _added(self, current: ModelWithEffects, sizes: dict[str, float]) -> ModelWithEffects:
        screening = self._cache.screening(current)
        shapes = {name: screening.scores_of(name) for name in sizes}
        starts = tuple(
            {name: (size, shapes[name][k].shape) for name, size in sizes.items()} for k in range(len(current.fits))
        )
        return self._cache.with_added(current, Candidate(tuple(sizes), starts, 0.0, 1.0))

    def _best(self, current: ModelWithEffects, models: Sequence[ModelWithEffects]) -> ModelWithEffects | None:
        """The simplest model within one block standard error of the best of those that predict surely better.

        Models are compared to first order; the one that is chosen must hold in fits without each block as well.
        """
        better = [
            model
            for model in models
            if self._shares.allows(model)
            and model.key != current.key
            and removed_share(current, model) >= MIN_SHARE
            and is_surely_better(model, self._shares.estimate(model), self._shares.estimate(current))
        ]
        while better:
            found = self._simplest(better)
            if is_surely_better(found, self._shares.errors(found), self._shares.errors(current)):
                return found
            better.remove(found)
        return None

    def _simplest(self, models: Sequence[ModelWithEffects]) -> ModelWithEffects:
        """With as few effects as one of those near the best; of those as few and about as good, the most plausible."""
        best = min(models, key=lambda model: self._shares.estimate(model).score)
        fewest = min(len(model.effects) for model in models if self._is_near(model, best))
        simple = [model for model in models if len(model.effects) == fewest]
        least = min(simple, key=lambda model: self._shares.estimate(model).score)
        alike = [model for model in simple if self._is_alike(model, least)]
        return max(alike, key=lambda model: (self._plausibility(model), -self._shares.estimate(model).score))

    def _is_alike(self, model: ModelWithEffects, best: ModelWithEffects) -> bool:
        """Whether a model predicts about as well as the best, or explains as much with no more values.

        A prediction to first order of one that explains less is not to be trusted: its fit ended at a bound.
        """
        is_simple = len(model.fits[0].free) <= len(best.fits[0].free)
        explains = model.squares <= (ALIKE if is_simple else 1.0) * best.squares
        return explains or self._shares.estimate(model).score <= ALIKE * self._shares.estimate(best).score

    def _plausibility(self, model: ModelWithEffects) -> float:
        """The odds of all effects before the data, less where the components do not say that there is such a part."""
        agrees = self._support.agrees
        return math.prod(each.plausibility * (1.0 if agrees(each) else DISAGREES) for each in model.effects)

    def _is_near(self, model: ModelWithEffects, best: ModelWithEffects) -> bool:
        """Whether the best predicts no better than by a standard error, or a model is like it."""
        gain, stderr = self._shares.estimate(best).gain_over(self._shares.estimate(model))
        return gain < stderr or self._is_alike(model, best)

    def _in_one(self, current: ModelWithEffects) -> ModelWithEffects:
        """One effect in the place of several, where these do not surely predict better.

        A formula of the kind of the largest component gives way only to what the components allow; as the only one, it
        also takes their place if they explain little more. Of those about as good, one with a formula comes before what
        imitates anything.
        """
        if not current.effects:
            return current
        several = current.effects if len(current.effects) > 1 else ()
        singles = [self._cache.with_effects([effect], starts_of(current, [effect])) for effect in several]
        absorbing = self._absorbing(self._cache.base, instead_of=current.effects)
        singles = [model for model in (*singles, *absorbing) if self._shares.allows(model)]
        best = min(singles, key=lambda model: self._shares.estimate(model).score, default=current)
        if best is not current:
            least = ALIKE * self._shares.estimate(best).score
            formulas = [model for model in singles if not model.effects[0].absorbs]
            alike = [model for model in formulas if self._shares.estimate(model).score <= least]
            best = min(alike, key=lambda model: self._shares.estimate(model).score, default=best)
            if not several and best.effects[0].absorbs:  # a formula stays unless blocks say surely otherwise
                is_better = is_surely_better(best, self._shares.errors(best), self._shares.errors(current))
                return best if is_better else current
            if self._is_main(best, current):
                return best
        is_better = self._shares.estimate(current).share_below(self._shares.estimate(best)) >= SURE
        return current if is_better or not several else best

    def _is_main(self, single: ModelWithEffects, several: ModelWithEffects) -> bool:
        """Whether one effect is of the kind of the largest component, and explains nearly as much as several."""
        if not self._support.turns or not self._support.parts:
            return False
        if not can_cause(single.effects[0], self._support.parts[0]):
            return False
        least = (1.0 - MIN_SHARE) * removed_share(self._cache.base, several)
        return removed_share(self._cache.base, single) >= least

    def _with_nuisances(self, current: ModelWithEffects) -> ModelWithEffects:
        """The model with what imitates anything added, or in the place of another, where that predicts better."""
        for _ in range(AT_ONCE):
            if current.at_noise:
                break
            models = self._absorbing(current)
            for effect in current.effects:
                models += self._absorbing(self._cache.without(current, effect), instead_of=[effect])
            found = self._best(current, models) or self._best(current, self._of_parts())
            if found is None:
                break
            self.reached = current = found
        return current

    def _of_parts(self) -> list[ModelWithEffects]:
        """Refits with an effect for each of the two largest components of the residual without effects.

        Two that act together may both predict badly alone: the fit with one makes up for the other.
        """
        base, parts = self._cache.base, self._support.parts[:AT_ONCE]
        if len(parts) < AT_ONCE:
            return []
        singles = self._with_causes(base, parts[0])
        return [model for single in singles if single.usable for model in self._with_causes(single, parts[1])]

    def _with_causes(self, current: ModelWithEffects, part: Component) -> list[ModelWithEffects]:
        """Refits with the best effect of the kind of a component, and with the best of all that can be its cause."""
        library, screening = self._cache.library.by_name, self._cache.screening(current)
        names = [name for name in self.testable(current) if can_cause(library[name], part)]
        own = [name for name in names if library[name].component == part.kind]
        chosen = self._possible(current, list(dict.fromkeys((*own[:1], *names[:1]))))
        return [self._cache.with_added(current, screening.single(name)) for name in chosen]

    def beside(self, found: ModelWithEffects, certain: Collection[str]) -> ModelWithEffects:
        """The model with formulas beside what imitates anything and is named for itself, where that predicts better.

        A large one that is found late hid the others. Beside one that only fits, or whose shape is fitted, a formula
        would make up for its form.

        Parameters
        ----------
        found
            Where the search ended.
        certain
            Names of its effects that imitate anything, of one form, and are named.
        """
        kept = [each for each in found.effects if not each.absorbs or each.name in certain]
        start = self._cache.with_effects(kept, starts_of(found, kept))
        grown = self._with_formulas(start) if start.usable else found
        if grown is start or self._shares.estimate(grown).score >= self._shares.estimate(found).score:
            return found
        self.reached = grown
        return grown

    def _absorbing(self, context: ModelWithEffects, instead_of: Sequence[Effect] = ()) -> list[ModelWithEffects]:
        """Refits of the best few effects that imitate anything.

        In the place of a formula of the kind of the largest component only those that the components allow.
        """
        if not context.usable:
            return []
        screening, names = self._cache.screening(context), self.testable(context, absorbs=True)
        library, support = self._cache.library.by_name, self._support
        is_free = not any(support.is_largest(effect) for effect in instead_of)
        chosen = [name for name in names[:ABSORBING] if is_free or support.agrees(library[name], of_range=True)]
        return [self._cache.with_added(context, screening.single(name)) for name in chosen]

    def _pruned(self, current: ModelWithEffects) -> ModelWithEffects:
        """The model without the effects whose removal does not harm the prediction."""
        for effect in current.effects:
            if len(current.effects) < 2:
                break
            rest = self._cache.without(current, effect)
            if rest.usable and self._shares.estimate(current).share_below(self._shares.estimate(rest)) < SURE:
                current = rest
        return current
