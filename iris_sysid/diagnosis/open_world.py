"""Names in an open world: what can be said of a residual that no effect of the library explains to the noise.

No model is exactly right for measured data, and the likelihoods of two models that are both wrong prefer one at random
(Yang and Zhu 2018, PNAS 115, 1854). So an effect is kept only where it improves the free-run prediction of blocks that
its fit did not see, in most bootstraps of the blocks; it is named only where its rivals do worse there; and what can
imitate a piece of anything (a force of any frequency, a blow at any moment) is fitted, but not named.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.held_out_blocks import (
    ALIKE,
    SMALLEST_SHARE,
    SURE,
    BlockErrors,
    every_block,
    held_out_errors,
    wins,
)
from iris_sysid.diagnosis.linearised_blocks import linearised_errors
from iris_sysid.diagnosis.measurement_errors import is_resolved
from iris_sysid.diagnosis.refit import ModelWithEffects, Starts, fitted_forms, forms
from iris_sysid.diagnosis.relative_size import relative_size
from iris_sysid.diagnosis.residual_components import ranked_effects
from iris_sysid.diagnosis.screening import Candidate
from iris_sysid.types import Component, Components, Effect, Finding

MAX_EFFECTS = 3  # that are kept
AT_ONCE = 2  # effects that are tried together
TRIED = 4  # best sets that are refitted in each round
WINS = 0.8  # share of block bootstraps in which a named effect must predict better than a rival
EVEN = 0.5  # the same against a rival that can imitate anything
RIVALS = 3  # of an effect that are refitted
NAMED_SHARE = 0.25  # of the squared error over blocks left out that a named effect removes, others being in the model
ABSORBED_SHARE = 0.5  # the same of what can imitate a piece of anything
EVIDENT_SHARE = 0.2  # of what all effects remove, that one must remove which can imitate anything
DISAGREES = 0.1  # factor on the odds of an effect of a kind that the components do not have
MOSTLY = 0.75  # of the residual's squares that an effect explains, to be named beside one that imitates anything
DOMINANT_SHARE = 0.85  # the same where the components do not say it
AS_WELL = 0.9  # of what an effect explains: on a motion that never turns, one that explains this share is as good
LOCATED_SHARE = 0.05  # of the residual's variance from which a component without an effect is told


@dataclass(frozen=True, eq=False, slots=True)
class Judgement:
    """The model in the end, what is said of each of its effects, and the rivals of each.

    ``rivals`` holds, by effect, the probability of it and of those that predict as well. ``weak`` holds, one a clip
    and by name, the values in weak form and their standard errors where that form decided; else it is empty.
    """

    model: ModelWithEffects
    findings: tuple[Finding, ...]
    rivals: dict[str, dict[str, float]]
    weak: tuple[Mapping[str, tuple[float, float]], ...] = ()


class OpenWorld:
    """The effects that improve the prediction of blocks left out, and what can be said of them.

    Parameters
    ----------
    cache
        Refits of the clips.
    components
        Of the residual of the model without effects; None where they are not known.
    """

    def __init__(self, cache: FitCache, components: Components | None) -> None:
        self._cache, self._components = cache, components
        self._blocks = every_block(cache.base.fits)
        self._errors: dict[frozenset[str], BlockErrors] = {}
        self._estimated: dict[frozenset[str], BlockErrors] = {}
        self._reached = cache.base

    @property
    def base(self) -> ModelWithEffects:
        """The model without effects."""
        return self._cache.base

    @property
    def tried(self) -> list[ModelWithEffects]:
        """All models that were fitted and can be used."""
        return [model for model in self._cache.tried if model.usable]

    @property
    def testable(self) -> bool:
        """Whether the clips are long enough to leave out blocks."""
        return bool(self._blocks)

    def errors(self, model: ModelWithEffects) -> BlockErrors:
        """The errors of a model over blocks that its fits did not see."""
        if model.key not in self._errors:
            self._cache.report(f"predicting blocks left out with {', '.join(model.names_in_order) or 'no effect'}")
            self._errors[model.key] = held_out_errors(self._cache.clips, model, self._blocks)
        return self._errors[model.key]

    def _estimate(self, model: ModelWithEffects) -> BlockErrors:
        """The same to first order, without a fit."""
        if model.key not in self._estimated:
            self._estimated[model.key] = linearised_errors(model, self._blocks)
        return self._estimated[model.key]

    def heldout(self, model: ModelWithEffects) -> tuple[float, float]:
        """The error over blocks left out: root mean square, in the observed unit and in units of the noise; or NaN."""
        if not self.testable:
            return float("nan"), float("nan")
        errors = self.errors(model)
        return errors.rms, float(np.sqrt(errors.mean))

    def predicts_better(self, model: ModelWithEffects, other: ModelWithEffects) -> bool:
        """Whether a model surely predicts the blocks left out better than another one, with no more effects."""
        if not self.testable or len(model.effects) > len(other.effects) or model.key == other.key:
            return False
        return self.errors(model).share_below(self.errors(other)) >= SURE

    def judged(self) -> Judgement:
        """Search for the effects that predict, and say what each is."""
        if not self.testable:
            return Judgement(self._cache.base, (), {})
        driven = self._in_weak_form()
        if driven is not None:
            return driven
        current = self._with_nuisances(self._in_one(self._pruned(self._with_formulas())))
        rivals = {
            effect.name: with_others(self._rivals(current, effect), self.as_good_alone(current, effect, sure=False))
            for effect in current.effects
        }
        findings = [self._finding(current, effect, tuple(rivals[effect.name])) for effect in current.effects]
        return Judgement(current, self.surviving(current, findings), rivals)

    def _in_weak_form(self) -> Judgement | None:
        """What the weak form of a driven motion says, whose free run is far off; None where it says nothing."""
        found = self._cache.weak.best(self._cache.base, MAX_EFFECTS)
        if found is None or not found.effects:
            return None
        model = self._cache.with_added(self._cache.base, self._cache.weak.candidate(found))
        if not self.allows(model):
            return None
        judged = {effect.name: self._cache.weak.judged(found, effect) for effect in found.effects}
        findings = tuple(_weak_finding(effect, *judged[effect.name]) for effect in found.effects)
        return Judgement(model, findings, {name: odds for name, (_, odds) in judged.items()}, found.estimates)

    def so_far(self) -> Judgement:
        """What a search that was stopped has reached: in the fit, without a name, as rivals were not tried."""
        findings = tuple(
            Finding("located", effect.component, (effect.name,), float("nan"), "the search ended before its rivals")
            for effect in self._reached.effects
        )
        return Judgement(self._reached, findings, {effect.name: {effect.name: 1.0} for effect in self._reached.effects})

    def of_complete(
        self, model: ModelWithEffects, rivals: Mapping[str, Sequence[str]], sure: bool
    ) -> tuple[Finding, ...]:
        """The findings on a model that explains the data to the noise: a likelihood can tell effects apart there.

        What can imitate anything is named there too, if it is a good part of the residual.

        Parameters
        ----------
        model
            The final model.
        rivals
            By effect, those that explain the data as well.
        sure
            Whether the size of the noise is known; else what imitates anything must be what the components say.
        """
        findings = []
        for effect in model.effects:
            names, share = (effect.name, *rivals.get(effect.name, ())), self._removed(model, effect)
            if effect.absorbs and not self._is_evident(model, effect, sure):
                findings.append(_absorbing(effect, share))
            elif self._is_small(model, effect):
                findings.append(Finding("located", effect.component, names, share, "a small part of the residual"))
            elif len(names) > 1:
                findings.append(Finding("group", effect.component, names, share, "each explains the data as well"))
            else:
                findings.append(Finding("named", effect.component, names, share))
        return self.surviving(model, findings)

    def surviving(self, model: ModelWithEffects, findings: Sequence[Finding]) -> tuple[Finding, ...]:
        """The findings, one an effect; named is only what is needed with each rival of a larger effect in its place.

        An effect beside one whose form is not known may only make up for the wrong form.
        """
        kept = []
        for effect, finding in zip(model.effects, findings, strict=True):
            rival = self._not_needed_beside(model, effect, findings) if finding.word in ("named", "group") else ""
            kept.append(replace(finding, word="located", reason=f"not needed with {rival}") if rival else finding)
        return tuple(kept)

    def _not_needed_beside(self, model: ModelWithEffects, effect: Effect, findings: Sequence[Finding]) -> str:
        """The rival of a larger effect that predicts as well in its place without this one; empty where none does."""
        for main, finding in zip(model.effects, findings, strict=True):
            is_larger = main is not effect and self._alone(model, main) > self._alone(model, effect)
            if finding.word != "group" or not is_larger:
                continue
            rest = self._cache.without(model, main)
            for name in finding.effects[1 : 1 + RIVALS]:
                if name == effect.name or not rest.usable:
                    continue
                inside = name in model.names
                swapped = rest if inside else self._cache.with_added(rest, self._cache.screening(rest).single(name))
                if self._is_as_good(swapped, model) and not self._removed_in(swapped, effect) >= NAMED_SHARE:
                    return f"{name.replace('-', ' ')} in the place of {main.name.replace('-', ' ')}"
        return ""

    def _is_as_good(self, model: ModelWithEffects, other: ModelWithEffects) -> bool:
        """Whether a model with possible sizes predicts blocks left out about as well as another one."""
        if not self.allows(model):
            return False
        errors, others = self._estimate(model), self._estimate(other)
        return errors.mean <= ALIKE * others.mean or others.share_below(errors) < WINS

    def rests_on_absorbing(self, model: ModelWithEffects, sure: bool) -> bool:
        """Whether a good part of what a model explains is due to effects without evidence that imitate anything."""
        return any(
            effect.absorbs
            and not self._is_evident(model, effect, sure)
            and self.share_of(model, effect) >= EVIDENT_SHARE
            for effect in model.effects
        )

    def _is_small(self, model: ModelWithEffects, effect: Effect) -> bool:
        """Whether an effect is a small part of what the model explains, and of the error over blocks left out."""
        return self.share_of(model, effect) < SMALLEST_SHARE and not self._removed(model, effect) >= NAMED_SHARE

    def share_of(self, model: ModelWithEffects, effect: Effect) -> float:
        """The fraction that an effect has in what all effects of a model remove of the residual."""
        return max(self._share_in(each, effect) for each in self._contexts(model, effect))

    def _share_in(self, model: ModelWithEffects, effect: Effect) -> float:
        rest = self._cache.without(model, effect)
        explained = max(self._cache.base.squares - model.squares, 1e-300)
        return (rest.squares - model.squares) / explained if rest.usable else 1.0

    def _contexts(self, model: ModelWithEffects, effect: Effect) -> list[ModelWithEffects]:
        """The models in which an effect counts: as it is, and of a formula without what can imitate it."""
        formulas = [other for other in model.effects if not other.absorbs]
        if effect.absorbs or len(formulas) == len(model.effects):
            return [model]
        alone = self._cache.with_effects(formulas, starts_of(model, formulas))
        return [model, alone] if alone.usable else [model]

    @property
    def _kinds(self) -> set[str]:
        """The components of the residual, and those that can take their place."""
        return {kind for part in self._parts for kind in (part.kind, *part.similar)}

    def _large_kinds(self, of_range: bool) -> set[str]:
        """The same of the components that are a good part of what is no noise, and those that by their range can be."""
        least = EVIDENT_SHARE * sum(part.share for part in self._parts)
        large = [part for part in self._parts if part.share >= least]
        possible = [part for part in self._parts if of_range and part.share_range[1] >= least]
        return {kind for part in large for kind in (part.kind, *part.similar)} | {part.kind for part in possible}

    @property
    def _parts(self) -> tuple[Component, ...]:
        return () if self._components is None else self._components.parts

    def _is_evident(self, model: ModelWithEffects, effect: Effect, sure: bool) -> bool:
        """Whether an effect is a good part of the residual that the components say, or explains nearly all of it."""
        if self._has_formula(model, effect):
            return False
        share = self.share_of(model, effect)
        if self._agrees(effect, of_range=True) and (share >= EVIDENT_SHARE or self._dominant(model) is effect):
            return True
        blind = not self._components_turn and (self._kinds or self._removed(model, effect) >= DOMINANT_SHARE)
        return bool(sure and blind and share >= DOMINANT_SHARE)

    def _has_formula(self, model: ModelWithEffects, effect: Effect) -> bool:
        """Whether, on a motion that never turns, an effect with a formula alone explains about as much as this one."""
        others = self.as_good_alone(model, effect, sure=False) if self._never_turns else ()
        return any(not self._library[name].absorbs for name in others)

    @property
    def _never_turns(self) -> bool:
        return self._components is not None and not self._components.turns

    @property
    def _components_turn(self) -> bool:
        return self._components is not None and self._components.turns

    def _agrees(self, effect: Effect, *, of_range: bool = False) -> bool:
        """Whether an effect is of a kind that the components have; on a motion that never turns, they cannot tell.

        What can imitate anything must be a good part of the residual. Where the model explains the data to the noise,
        the shares may lie anywhere in their ranges.
        """
        if effect.absorbs and self._cache.base.fits[0].model.inputs:
            return False  # a motion that something drives has pieces of its own at any moment
        if self._components is None:
            return True
        kinds = self._large_kinds(of_range) if effect.absorbs else self._kinds
        return bool(kinds) and (effect.component in kinds or not self._components.turns)

    def as_good_alone(self, model: ModelWithEffects, effect: Effect, sure: bool) -> list[str]:
        """Effects that alone explain about as much as one does alone, where that is most of the residual.

        What can imitate anything must explain more. Where the size of the noise is known, a likelihood tells effects
        apart, but not what imitates anything from formulas. On a motion that never turns, a force or a reading that
        depends on anything is a function of the time: each effect is tried, and is as good as a component would be.
        """
        base, removed = self._cache.base.squares, self._alone(model, effect)
        if self._never_turns and not sure:
            alone, formulas = self._each_alone(), base * (1.0 - AS_WELL * removed)
            absorbing = formulas
        else:
            alone = [each for each in self._cache.tried if len(each.effects) == 1]
            itself, most = base * (1.0 - removed), base * (1.0 - MOSTLY)
            formulas = ALIKE * itself if itself < most else 0.0  # squares below which one with a formula is as good
            absorbing = itself if itself < most and not sure else 0.0  # and one that imitates anything
            if sure:
                formulas = (formulas if self._components_turn else most) if effect.absorbs else 0.0
        good = [
            each
            for each in alone
            if self.allows(each) and each.squares < (absorbing if each.effects[0].absorbs else formulas)
        ]
        names = [each.effects[0].name for each in good if each.effects[0].name != effect.name]
        return list(dict.fromkeys([*names, *self._exchangeable(model, effect)]))

    def _exchangeable(self, model: ModelWithEffects, effect: Effect) -> list[str]:
        """Effects of the same model that alone explain as much as one does alone, and little beside it."""
        left = 1.0 - self._alone(model, effect)
        return [
            other.name
            for other in model.effects
            if other is not effect
            and 1.0 - self._alone(model, other) <= (left if other.absorbs else ALIKE * left)
            and self._is_small(model, other)
        ]

    def _each_alone(self) -> list[ModelWithEffects]:
        """Refits of each effect alone that the parameters cannot imitate."""
        screening, testable = self._cache.screening(self.base), self._cache.testable(self.base)
        candidates = [screening.single(name) for name in screening.names if name in testable]
        allowed = [each for each in candidates if self._cache.library.allows(each)]
        return [self._cache.with_added(self.base, each) for each in allowed]

    def without_absorbing(self, model: ModelWithEffects, effect: Effect) -> ModelWithEffects:
        """A model without what only absorbs a part of the residual: it must explain the data for a name of ``effect``.

        On a motion that never turns, that is the effect alone: there two together imitate anything.
        """
        kept = [
            each
            for each in model.effects
            if each is effect or not (self._never_turns or (each.absorbs and not self._is_evident(model, each, True)))
        ]
        return self._cache.with_effects(kept, starts_of(model, kept))

    # the search ------------------------------------------------------------------------------------------------------

    def _with_formulas(self) -> ModelWithEffects:
        """The base with the effects that have a formula and improve the prediction, one or two at a time."""
        current = self._cache.base
        while len(current.effects) < MAX_EFFECTS and not current.at_noise:
            models = [model for model in self._refits(current) if len(model.effects) <= MAX_EFFECTS]
            found = self._best(current, models)
            if found is None:
                break
            self._reached = current = found
        return current

    def _refits(self, current: ModelWithEffects) -> list[ModelWithEffects]:
        """Refits of the best sets of one and two more effects, ranked to first order beside a flexible rest."""
        screening, testable = self._cache.screening(current), self._cache.testable(current)
        names = [name for name in screening.names if name in testable and not self._library[name].absorbs]
        names = [name for name in names if self._cache.library.allows(screening.single(name)) or current.far_off]
        effects = {name: (self._library[name], screening.scores_of(name)[0].shape) for name in names}
        odds = {name: float(np.log(self._library[name].plausibility)) for name in names}
        ranked = ranked_effects(self._cache.clips, current.fits, effects, odds, AT_ONCE)
        singles = [each for each in ranked if len(each.sizes) == 1]
        few = [each for each in ranked if each.sizes][:TRIED]
        located = [each for each in singles if self._library[next(iter(each.sizes))].component in self._kinds]
        chosen = [*few, *(each for each in [*singles[:AT_ONCE], *located[:TRIED]] if each not in few)]
        chosen = list({each.names: each for each in chosen}.values())
        models = [self._added(current, dict(each.sizes)) for each in chosen]
        models += [
            self._cache.with_free_form(current, each) for each in current.effects if self._may_be_freed(current, each)
        ]
        if current.far_off:  # what an effect removes to first order tells little along a motion that is far off
            models += [self._cache.with_added(current, each) for each in self._cache.best_of(current, names)]
        return [model for model in models if self.allows(model)]

    def _may_be_freed(self, current: ModelWithEffects, effect: Effect) -> bool:
        """Whether an effect has a form that is not fitted, and was not found in another one near that already."""
        if not forms(effect) or fitted_forms(effect):
            return False
        if effect.nearby is None:
            return True
        first = self._cache.screening(self.base).scores_of(effect.name)
        found = [start[effect.name][1] for start in starts_of(current, [effect])]
        return all(np.allclose(shape, score.shape) for shape, score in zip(found, first, strict=True))

    def _added(self, current: ModelWithEffects, sizes: dict[str, float]) -> ModelWithEffects:
        screening = self._cache.screening(current)
        shapes = {name: screening.scores_of(name) for name in sizes}
        starts = tuple(
            {name: (size, shapes[name][k].shape) for name, size in sizes.items()} for k in range(len(current.fits))
        )
        return self._cache.with_added(current, Candidate(tuple(sizes), starts, 0.0, 1.0))

    def allows(self, model: ModelWithEffects) -> bool:
        """Whether a refit succeeded, with sizes that are possible."""
        return model.usable and self._cache.library.allows_fit(model) and self._is_plausible(model)

    def _is_plausible(self, model: ModelWithEffects) -> bool:
        """Whether no effect is larger than it can be: beyond that it only cancels another one, or a fitted value."""
        clip, base = self._cache.clips[0], self._cache.base.fits[0].model
        return all(
            relative_size(effect, model.fits[0], base, clip.trajectory) <= effect.largest for effect in model.effects
        )

    def _best(self, current: ModelWithEffects, models: Sequence[ModelWithEffects]) -> ModelWithEffects | None:
        """The simplest model within one block standard error of the best of those that predict surely better.

        Models are compared to first order; the one that is chosen must hold in fits without each block as well.
        """
        better = [
            model
            for model in models
            if self.allows(model)
            and model.key != current.key
            and _removed_share(current, model) >= SMALLEST_SHARE
            and _is_surely_better(model, self._estimate(model), self._estimate(current))
        ]
        while better:
            found = self._simplest(better)
            if _is_surely_better(found, self.errors(found), self.errors(current)):
                return found
            better.remove(found)
        return None

    def _simplest(self, models: Sequence[ModelWithEffects]) -> ModelWithEffects:
        """Of those near the best, one with the fewest effects; of those about as good, the most plausible."""
        best = min(models, key=lambda model: self._estimate(model).mean)
        near = [model for model in models if self._is_near(model, best)]
        fewest = min(len(model.effects) for model in near)
        simple = [model for model in near if len(model.effects) == fewest]
        least = min(self._estimate(model).mean for model in simple)
        alike = [model for model in simple if self._estimate(model).mean <= ALIKE * least]
        return max(alike, key=lambda model: (self._plausibility(model), -self._estimate(model).mean))

    def _plausibility(self, model: ModelWithEffects) -> float:
        """The odds of all effects before the data, less where the components do not say that there is such a part."""
        return math.prod(effect.plausibility * (1.0 if self._agrees(effect) else DISAGREES) for effect in model.effects)

    def _is_near(self, model: ModelWithEffects, best: ModelWithEffects) -> bool:
        """Whether the best predicts no better than by a standard error, or removes hardly more of the residual."""
        gain, stderr = self._estimate(best).gain_over(self._estimate(model))
        return model is best or gain < stderr or model.squares - best.squares < SMALLEST_SHARE * self.base.squares

    def _is_resolved(self, before: ModelWithEffects, after: ModelWithEffects) -> bool:
        """Whether a step changes the prediction of a clip by more than its stated errors."""
        if not before.usable:
            return True
        fits = zip(before.fits, after.fits, self._cache.clips, strict=True)
        return any(is_resolved(one, other, clip.trajectory) for one, other, clip in fits)

    def _in_one(self, current: ModelWithEffects) -> ModelWithEffects:
        """One effect in the place of several, where these do not surely predict better.

        One of the kind of the largest component also takes their place if they explain hardly more. Of those about as
        good, one with a formula comes before what imitates anything.
        """
        if not current.effects:
            return current
        several = current.effects if len(current.effects) > 1 else ()
        singles = [self._cache.with_effects([effect], starts_of(current, [effect])) for effect in several]
        singles = [model for model in (*singles, *self._absorbing(self._cache.base)) if self.allows(model)]
        best = min(singles, key=lambda model: self._estimate(model).mean, default=current)
        if best is not current:
            least = ALIKE * self._estimate(best).mean
            formulas = [model for model in singles if not model.effects[0].absorbs]
            alike = [model for model in formulas if self._estimate(model).mean <= least]
            best = min(alike, key=lambda model: self._estimate(model).mean, default=best)
            if not several and best.effects[0].absorbs:  # a formula stays unless blocks say surely otherwise
                is_better = _is_surely_better(best, self.errors(best), self.errors(current))
                return best if is_better else current
            if self._is_main(best, current):
                return best
        is_better = self._estimate(current).share_below(self._estimate(best)) >= SURE
        return current if is_better or not several else best

    def _is_main(self, single: ModelWithEffects, several: ModelWithEffects) -> bool:
        """Whether one effect is of the kind of the largest component, and explains nearly as much as several."""
        if not self._components_turn or not self._parts:
            return False
        largest = self._parts[0]
        if single.effects[0].component not in (largest.kind, *largest.similar):
            return False
        least = (1.0 - SMALLEST_SHARE) * _removed_share(self._cache.base, several)
        return _removed_share(self._cache.base, single) >= least

    def _with_nuisances(self, current: ModelWithEffects) -> ModelWithEffects:
        """The model with what imitates anything added, or else in the place of another, where that predicts better."""
        for _ in range(AT_ONCE):
            if current.at_noise:
                break
            rests = (self._cache.without(current, effect) for effect in current.effects)
            found = self._best(current, self._absorbing(current)) or self._best(
                current, [model for rest in rests if rest.usable for model in self._absorbing(rest)]
            )
            if found is None:
                break
            self._reached = current = found
        return current

    def _absorbing(self, context: ModelWithEffects) -> list[ModelWithEffects]:
        """Refits of the best few effects that imitate anything."""
        screening, testable = self._cache.screening(context), self._cache.testable(context)
        names = [name for name in screening.names if name in testable and self._library[name].absorbs]
        return [self._cache.with_added(context, screening.single(name)) for name in names[:RIVALS]]

    def _pruned(self, current: ModelWithEffects) -> ModelWithEffects:
        """The model without the effects whose removal does not harm the prediction."""
        for effect in current.effects:
            if len(current.effects) < 2:
                break
            rest = self._cache.without(current, effect)
            if rest.usable and self._estimate(current).share_below(self._estimate(rest)) < SURE:
                current = rest
        return current

    # what is said ----------------------------------------------------------------------------------------------------

    @property
    def _library(self) -> dict[str, Effect]:
        return self._cache.library.by_name

    def _finding(self, model: ModelWithEffects, effect: Effect, names: tuple[str, ...]) -> Finding:
        share = self._removed(model, effect)
        if effect.absorbs and not self._is_named_absorbing(model, effect, share):
            return _absorbing(effect, share)
        is_rest = len(model.effects) > 1 and self.share_of(model, effect) < SMALLEST_SHARE
        if self._never_turns and effect is self._main(model):
            share, is_rest = self._alone(model, effect), False
        if share < NAMED_SHARE or is_rest:
            return Finding("located", effect.component, names, share, "it is a small part of the residual")
        if not any(
            self._is_resolved(self._cache.without(each, effect), each) for each in self._contexts(model, effect)
        ):
            return Finding("located", effect.component, names, share, "the stated errors of the samples can hide it")
        if len(names) > 1:
            return Finding("group", effect.component, names, share, "blocks that were left out are predicted as well")
        return Finding("named", effect.component, names, share)

    def _is_named_absorbing(self, model: ModelWithEffects, effect: Effect, removed: float) -> bool:
        """Whether what imitates anything is what the components say, or alone nearly all of it if they allow that."""
        said = self._components_turn and removed >= ABSORBED_SHARE and self._agrees(effect)
        return said or self._dominant(model) is effect

    def _dominant(self, model: ModelWithEffects) -> Effect | None:
        """What imitates anything and alone explains nearly all, more than any other, if the components allow it."""
        if self._components is None or not model.effects:
            return None
        shares = {effect.name: self._alone(model, effect) for effect in model.effects}
        most = max(model.effects, key=lambda effect: shares[effect.name])
        is_main = most.absorbs and shares[most.name] >= DOMINANT_SHARE
        return most if is_main and (self._never_turns or self._agrees(most, of_range=True)) else None

    def _main(self, model: ModelWithEffects) -> Effect:
        """The effect with a formula that alone explains most; on a motion that never turns the others imitate it."""
        return max(model.effects, key=lambda effect: (not effect.absorbs, self._alone(model, effect)))

    def _alone(self, model: ModelWithEffects, effect: Effect) -> float:
        """The fraction of the residual that an effect of a model removes without the others."""
        alone = self._cache.with_effects([effect], starts_of(model, [effect]))
        return _removed_share(self._cache.base, alone) if alone.usable else 0.0

    def _removed(self, model: ModelWithEffects, effect: Effect) -> float:
        """The fraction of the squared error over blocks left out that an effect removes beside the others."""
        if not self.testable:
            return float("nan")
        return max(self._removed_in(each, effect) for each in self._contexts(model, effect))

    def _removed_in(self, model: ModelWithEffects, effect: Effect) -> float:
        rest = self._cache.without(model, effect)
        if not rest.usable:
            return float("nan")
        before, after = self._estimate(rest).mean, self._estimate(model).mean
        return float(1.0 - after / before) if np.isfinite(after) and 0 < before < np.inf else float("nan")

    def _rivals(self, model: ModelWithEffects, effect: Effect) -> dict[str, float]:
        """An effect and those that predict the blocks as well in its place, with the share of bootstraps each wins.

        They are compared in the model in which the effect counts for most.
        """
        model = max(self._contexts(model, effect), key=lambda each: np.nan_to_num(self._removed_in(each, effect)))
        rest = self._cache.without(model, effect)
        if not rest.usable:
            return {effect.name: 1.0}
        screening = self._cache.screening(rest)
        others = {name: self._cache.with_added(rest, screening.single(name)) for name in self._worth(rest, effect)}
        near = {
            name: self._estimate(rival)
            for name, rival in others.items()
            if self.allows(rival)
            and self._estimate(model).share_below(self._estimate(rival))
            < (EVEN if self._library[name].absorbs else WINS)
        }
        shares = wins({effect.name: self._estimate(model), **near})
        exact = [name for name in screening.parallel(effect.name) if name not in shares and name not in model.names]
        each = shares[effect.name] / (1 + len(exact))
        return {**shares, effect.name: each, **dict.fromkeys(exact, each)}

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
        same = [name for name in allowed if self._library[name].component == effect.component][:RIVALS]
        return list(dict.fromkeys([*same, *best]))


def with_others(shares: Mapping[str, float], others: Sequence[str]) -> dict[str, float]:
    """The shares of rivals, with each of the others that is not among them as one more; the sum is the same."""
    more = [name for name in others if name not in shares]
    whole = len(shares) + len(more)
    return {name: share * len(shares) / whole for name, share in shares.items()} | dict.fromkeys(more, 1.0 / whole)


def _is_surely_better(model: ModelWithEffects, errors: BlockErrors, before: BlockErrors) -> bool:
    """Whether errors are smaller than those before in most bootstraps, and no size changes its sign without a block."""
    steady = all(errors.is_steady(effect.parameters[0].name) for effect in model.effects)
    return steady and errors.share_below(before) >= SURE


def _removed_share(before: ModelWithEffects, after: ModelWithEffects) -> float:
    """The fraction of the residual's sum of squares that a step removes."""
    return (before.squares - after.squares) / max(before.squares, 1e-300)


def unexplained(base: Components | None, remaining: Components | None) -> tuple[Finding, ...]:
    """The components that remain with all effects of a model, with their shares in the residual without them.

    Parameters
    ----------
    base, remaining
        The components without the effects, and with them.
    """
    if base is None or remaining is None or not base.residual_rms > 0:
        return ()
    whole = (remaining.residual_rms / base.residual_rms) ** 2
    return tuple(_located(part, whole * part.share) for part in remaining.parts if whole * part.share >= LOCATED_SHARE)


def starts_of(model: ModelWithEffects, effects: Sequence[Effect]) -> tuple[Starts, ...]:
    """The fitted sizes and shapes of some effects of a model, one a clip."""
    return tuple(
        {
            effect.name: (values[0], tuple(values[1:]))
            for effect in effects
            for values in [[fitted.estimates[parameter.name].value for parameter in effect.parameters]]
        }
        for fitted in model.fits
    )


def _weak_finding(effect: Effect, share: float, odds: Mapping[str, float]) -> Finding:
    names = (effect.name, *(name for name in odds if name != effect.name))
    if not share >= NAMED_SHARE:
        return Finding("located", effect.component, names, share, "it is a small part of the residual")
    if len(names) > 1:
        return Finding("group", effect.component, names, share, "each explains the force in short windows as well")
    return Finding("named", effect.component, names, share)


def _absorbing(effect: Effect, share: float) -> Finding:
    reason = f"it can imitate a part of anything, and there is no other evidence of {effect.name.replace('-', ' ')}"
    return Finding("located", effect.component, (effect.name,), share, reason)


def _located(part: Component, share: float) -> Finding:
    if part.similar:
        reason = f"{', '.join(part.similar)} would explain it as well"
        return Finding("open" if len(part.similar) > AT_ONCE else "located", part.kind, (), share, reason)
    return Finding("located", part.kind, (), share)
