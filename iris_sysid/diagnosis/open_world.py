"""Names in an open world: what can be said of a residual that no effect of the library explains to the noise.

No model is exactly right for measured data, and the likelihoods of two models that are both wrong prefer one at random
(Yang and Zhu 2018, PNAS 115, 1854). So an effect is kept only where it improves the free-run prediction of blocks that
its fit did not see, in most bootstraps of the blocks; it is named only where its rivals do worse there; and what can
imitate a piece of anything (a force of any frequency, a blow at any moment) is fitted, but not named.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.diagnosis.component_support import DOMINANT_SHARE, EVIDENT_SHARE, ComponentSupport
from iris_sysid.diagnosis.contributions import NAMED_SHARE, Contributions, starts_of
from iris_sysid.diagnosis.effect_search import AT_ONCE, MAX_EFFECTS, EffectSearch
from iris_sysid.diagnosis.evidence import DECISIVE
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.held_out_blocks import MIN_SHARE
from iris_sysid.diagnosis.refit import ModelWithEffects, with_values
from iris_sysid.diagnosis.residual_components import odds_over_curves
from iris_sysid.diagnosis.rivals import MAIN_SHARE, RIVALS, Rivals
from iris_sysid.diagnosis.weak_ranking import WeakSet
from iris_sysid.types import Component, Components, Effect, Finding

ABSORBED_SHARE = 0.5  # of the squared error over blocks left out that what can imitate anything removes, if it is named
READINGS = 2  # best errors of a reading, that are tried beside what short windows show
WEAK_SHARE = 0.5  # of the residual's variance, that a free run with values in weak form removes
WORSE = "beside the others it predicts blocks that were left out worse"
LOCATED_SHARE = 0.05  # of the residual's variance from which a component without an effect is reported


@dataclass(frozen=True, eq=False, slots=True)
class Judgement:
    """The model in the end, the finding on each of its effects, and the rivals of each.

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

    Attributes
    ----------
    shares
        What each effect of a model explains.
    rivals
        What explains the data as well.
    """

    def __init__(self, cache: FitCache, components: Components | None) -> None:
        self._cache = cache
        self.shares = Contributions(cache)
        self._support = ComponentSupport(components, bool(cache.base.fits[0].model.inputs))
        self.rivals = Rivals(cache, self.shares, self._support)
        self._search = EffectSearch(cache, self.shares, self._support)
        self._odds: dict[tuple[frozenset[str], str], float] = {}  # over curves, of an effect of a model

    @property
    def tried(self) -> list[ModelWithEffects]:
        """All models that were fitted and can be used."""
        return [model for model in self._cache.tried if model.usable]

    def searched(self) -> ModelWithEffects:
        """The model with the effects that improve the prediction of blocks left out."""
        found = self._search.run() if self.shares.testable else self._cache.base
        named = () if found.explains else self._named_absorbing(found)
        fixed = {effect.name for effect in found.effects if effect.name in named and effect.has_fixed_form}
        return self._search.beside(found, fixed) if fixed else found

    def judged(self, current: ModelWithEffects) -> Judgement:
        """What each effect of a model is that was searched for."""
        if not current.effects:
            return Judgement(current, (), {})
        named = self._named_absorbing(current)
        self.shares.trust(named)
        rivals = {effect.name: self.rivals.odds(current, effect) for effect in current.effects}
        findings = [self._finding(current, effect, tuple(rivals[effect.name]), named) for effect in current.effects]
        return Judgement(current, self.surviving(current, findings), rivals)

    def in_weak_form(self) -> Judgement | None:
        """What the weak form of a driven motion says, whose free run is far off; None where it says nothing.

        It is the largest set with a free run of possible sizes that is nearer than without the last effect: in short
        windows an effect may fit that cannot be. Nothing where an error of the reading explains more: short windows
        take it for a force.
        """
        if not self.shares.testable:
            return None
        chosen: tuple[WeakSet, ModelWithEffects] | None = None
        for found in self._cache.weak.grown(self._cache.base, MAX_EFFECTS):
            model = self._cache.with_added(self._cache.base, self._cache.weak.candidate(found))
            if not self.shares.allows(model):
                continue
            if chosen is not None and model.squares > chosen[1].squares:
                break
            chosen = found, model
        if chosen is None or not self._is_followed(*chosen) or self._is_misread(chosen[1]):
            return None
        return self._of_weak(*chosen)

    def _is_misread(self, model: ModelWithEffects) -> bool:
        """Whether one error of the reading explains the free run better than a model does that leaves a residual."""
        base, library = self._cache.base, self._cache.library.by_name
        if model.explains:
            return False
        names = [name for name in self._search.testable(base, absorbs=False) if library[name].observe]
        screening = self._cache.screening(base)
        readings = [self._cache.with_added(base, screening.single(name)) for name in names[:READINGS]]
        return any(self.shares.allows(each) and each.squares < model.squares for each in readings)

    def _is_followed(self, found: WeakSet, model: ModelWithEffects) -> bool:
        """Whether free runs with the values in weak form explain much of the residual; not where a sensor lags."""
        each = zip(self._cache.clips, model.fits, found.estimates, self._cache.base.fits, strict=True)
        runs = [(with_values(clip, fitted, values), before) for clip, fitted, values, before in each]
        return all(run.usable and bool(np.all(run.rms**2 < (1 - WEAK_SHARE) * before.rms**2)) for run, before in runs)

    def _of_weak(self, found: WeakSet, model: ModelWithEffects) -> Judgement:
        judged = {effect.name: self._cache.weak.judged(found, effect) for effect in found.effects}
        explained = self._cache.weak.explained(self._cache.base, found) if model.far_off else 1.0
        findings = tuple(_weak_finding(effect, *judged[effect.name], explained) for effect in found.effects)
        return Judgement(model, findings, {name: odds for name, (_, odds) in judged.items()}, found.estimates)

    def so_far(self) -> Judgement:
        """What a search that was stopped has reached: in the fit, without a name, as rivals were not tried."""
        reached = self._search.reached
        findings = tuple(
            Finding("located", effect.component, (effect.name,), float("nan"), "the search ended before its rivals")
            for effect in reached.effects
        )
        return Judgement(reached, findings, {effect.name: {effect.name: 1.0} for effect in reached.effects})

    def of_complete(self, model: ModelWithEffects, rivals: Mapping[str, Sequence[str]]) -> tuple[Finding, ...]:
        """The findings on a model that explains the data to the noise: a likelihood can tell effects apart there.

        What can imitate anything is named there too, if it is a good part of the residual.

        Parameters
        ----------
        model
            The final model.
        rivals
            By effect, those that explain the data as well.
        """
        findings = []
        imitating = self.imitating(model)
        absorbing = [each for each in model.effects if each.absorbs and each not in imitating]
        evident = self._with_own_evidence(model, absorbing)
        self.shares.trust(evident)
        for effect in model.effects:
            names, share = (effect.name, *rivals.get(effect.name, ())), self.shares.removed(model, effect)
            if effect.absorbs and effect.name not in evident:
                findings.append(_absorbing(effect, share))
            elif self.shares.is_small(model, effect):
                findings.append(Finding("located", effect.component, names, share, "a small part of the residual"))
            elif share < 0 and not effect.is_placed:  # what acts at one moment says nothing beyond its own block
                findings.append(Finding("located", effect.component, names, share, WORSE))
            elif len(names) > 1:
                findings.append(Finding("group", effect.component, names, share, "each explains the data as well"))
            else:
                findings.append(Finding("named", effect.component, names, share))
        return self.surviving(model, findings)

    def surviving(self, model: ModelWithEffects, findings: Sequence[Finding]) -> tuple[Finding, ...]:
        """The findings, one an effect; named is only what is needed whatever the form of a larger effect is.

        An effect beside one whose form is not known may only make up for the wrong form: it is tried with each rival
        of a larger effect in its place, and without a larger one that can imitate anything and is not named.
        """
        kept = []
        for effect, finding in zip(model.effects, findings, strict=True):
            reason = self._not_needed(model, effect, findings) if finding.word in ("named", "group") else ""
            kept.append(replace(finding, word="located", reason=reason) if reason else finding)
        return tuple(kept)

    def _not_needed(self, model: ModelWithEffects, effect: Effect, findings: Sequence[Finding]) -> str:
        """Why an effect is not needed beside another form of a larger one; empty where it is."""
        for main, finding in zip(model.effects, findings, strict=True):
            if main is effect or self.shares.alone(model, main) <= self.shares.alone(model, effect):
                continue
            name = main.name.replace("-", " ")
            if main.absorbs and finding.word == "located":
                formulas = self.shares.contexts(model, effect)[-1]
                if not self.shares.removed_in(formulas, effect) >= NAMED_SHARE:
                    return f"not needed without {name}"
            rival = self._rival_without(model, main, effect, finding) if finding.word == "group" else ""
            if rival:
                return f"not needed with {rival.replace('-', ' ')} in the place of {name}"
        return ""

    def _rival_without(self, model: ModelWithEffects, main: Effect, effect: Effect, finding: Finding) -> str:
        """The rival of ``main``, from its finding, that predicts as well in its place without ``effect``; or empty."""
        rest = self._cache.without(model, main)
        for name in finding.effects[1 : 1 + RIVALS]:
            if name == effect.name or not rest.usable:
                continue
            inside = name in model.names
            swapped = rest if inside else self._cache.with_added(rest, self._cache.screening(rest).single(name))
            is_as_good = self.shares.predicts_as_well(swapped, model)
            if is_as_good and not self.shares.removed_in(swapped, effect) >= NAMED_SHARE:
                return name
        return ""

    def imitating(self, model: ModelWithEffects) -> list[Effect]:
        """The effects of a model that can imitate a part of anything, without other evidence of them."""
        return [effect for effect in model.effects if effect.absorbs and not self._is_evident(model, effect)]

    def rests_on_imitation(self, model: ModelWithEffects) -> bool:
        """Whether a good part of what a model explains may only be imitated."""
        return any(self.shares.share_of(model, effect) >= EVIDENT_SHARE for effect in self.imitating(model))

    def _is_evident(self, model: ModelWithEffects, effect: Effect) -> bool:
        """Whether an effect beats curves of any shape, or is a good part of the residual that the components say."""
        if self._beats_curves(model, effect):
            return True
        is_large = self.shares.share_of(model, effect) >= EVIDENT_SHARE or self._dominant(model) is effect
        return is_large and not self._support.never_turns and self._support.agrees(effect, of_range=True)

    def _beats_curves(self, model: ModelWithEffects, effect: Effect) -> bool:
        """Whether an effect explains the data decisively better than curves of any shape in its place."""
        rest, key = self._cache.without(model, effect), (model.key, effect.name)
        if key not in self._odds:
            self._odds[key] = odds_over_curves(self._cache.clips, rest, model) if rest.usable else -math.inf
        return 2.0 * self._odds[key] >= DECISIVE

    def without_absorbing(self, model: ModelWithEffects, effect: Effect) -> ModelWithEffects:
        """A model without what only absorbs a part of the residual: it must explain the data for a name of ``effect``.

        On a motion that never turns, that is the effect alone: there two together imitate anything.
        """
        kept = [each for each in model.effects if each is effect or self._is_certain(model, each)]
        return self._cache.with_effects(kept, starts_of(model, kept))

    def _is_certain(self, model: ModelWithEffects, effect: Effect) -> bool:
        return not self._support.never_turns and (not effect.absorbs or self._is_evident(model, effect))

    def _named_absorbing(self, model: ModelWithEffects) -> set[str]:
        """The effects of a model that are named although they can imitate anything."""
        absorbing = [each for each in model.effects if each.absorbs]
        named = [each for each in absorbing if self._is_named_absorbing(model, each, self.shares.removed(model, each))]
        return self._with_own_evidence(model, named)

    def _with_own_evidence(self, model: ModelWithEffects, effects: Sequence[Effect]) -> set[str]:
        """Of effects that can imitate anything those with a component of their own: one component is evidence of one.

        First comes an effect of the kind of a component, then one that can take its place and alone explains more.
        """
        evidence = {each.name: self._support.evidence(each) for each in effects}
        order = sorted(effects, key=lambda each: -self.shares.alone(model, each))
        order.sort(key=lambda each: each.component not in evidence[each.name])
        claimed: set[str] = set()
        named: set[str] = set()
        for effect in order:
            if not self._support.turns or not named or evidence[effect.name] - claimed:
                named.add(effect.name)
            claimed |= evidence[effect.name]
        return named

    def _finding(
        self, model: ModelWithEffects, effect: Effect, names: tuple[str, ...], named: Collection[str]
    ) -> Finding:
        share = self.shares.removed(model, effect)
        if effect.absorbs and effect.name not in named:
            return _absorbing(effect, share)
        is_rest = len(model.effects) > 1 and self.shares.share_of(model, effect) < MIN_SHARE
        if self._support.never_turns and effect is self._main(model):
            share, is_rest = self.shares.alone(model, effect), False
        if math.isnan(share):
            return Finding("located", effect.component, names, share, "the model cannot be fitted without it")
        if share < NAMED_SHARE or is_rest:
            return Finding("located", effect.component, names, share, "it is a small part of the residual")
        contexts = self.shares.contexts(model, effect)
        if not any(self.shares.is_resolved(self._cache.without(each, effect), each) for each in contexts):
            return Finding("located", effect.component, names, share, "the stated errors of the samples can hide it")
        if len(names) > 1:
            return Finding("group", effect.component, names, share, "blocks that were left out are predicted as well")
        return Finding("named", effect.component, names, share)

    def _is_named_absorbing(self, model: ModelWithEffects, effect: Effect, removed: float) -> bool:
        """Whether what imitates anything is what the components say, or alone nearly all of it if they allow that."""
        said = self._support.turns and removed >= ABSORBED_SHARE and self._support.agrees(effect)
        return said or self._dominant(model) is effect

    def _dominant(self, model: ModelWithEffects) -> Effect | None:
        """What imitates anything and alone explains nearly all, as no formula does, if the components allow it."""
        if not self._support.known or not model.effects:
            return None
        shares = {effect.name: self.shares.alone(model, effect) for effect in model.effects}
        nearly_all = [effect for effect in model.effects if shares[effect.name] >= DOMINANT_SHARE]
        if not nearly_all or not all(effect.absorbs for effect in nearly_all):
            return None
        most = max(nearly_all, key=lambda effect: shares[effect.name])
        if self._support.never_turns:  # two that imitate anything beat curves together, whatever acts
            is_only = sum(effect.absorbs for effect in model.effects) == 1
            return most if is_only and self._beats_curves(model, most) else None
        return most if self._support.agrees(most, of_range=True) else None

    def _main(self, model: ModelWithEffects) -> Effect:
        """The effect with a formula that alone explains most; on a motion that never turns the others imitate it."""
        return max(model.effects, key=lambda effect: (not effect.absorbs, self.shares.alone(model, effect)))


def with_components(
    findings: Sequence[Finding], base: Components | None, remaining: Components | None
) -> tuple[Finding, ...]:
    """The findings on effects and on components for which none is named, each with its share in the residual.

    Those are the components that remain with all effects. Where no effect is named, the components of the whole
    residual come first: what only fits does not explain them.

    Parameters
    ----------
    findings
        One an effect.
    base, remaining
        The components without the effects, and with them.
    """
    if base is None or remaining is None or not base.residual_rms > 0:
        return tuple(findings)
    if any(finding.word in ("named", "group") for finding in findings):
        whole = (remaining.residual_rms / base.residual_rms) ** 2
        return (*findings, *_unnamed(remaining, whole))
    told = {finding.component for finding in findings}
    return (*(each for each in _unnamed(base, 1.0) if each.component not in told), *findings)


def _unnamed(components: Components, whole: float) -> list[Finding]:
    shares = [(part, whole * part.share) for part in components.parts]
    return [_located(part, share) for part, share in shares if share >= LOCATED_SHARE]


def _weak_finding(effect: Effect, share: float, odds: Mapping[str, float], explained: float) -> Finding:
    """The finding on one of a set of effects that explain a fraction of the force in short windows, or the free run."""
    names = (effect.name, *(name for name in odds if name != effect.name))
    if not explained >= MAIN_SHARE:
        reason = f"the effects explain {100 * explained:.0f} % of the force in short windows"
        return Finding("located", effect.component, names, share, reason)
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
