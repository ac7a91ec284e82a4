"""A cache of refits: every set of effects is fitted, screened and validated once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from fitters.ode import FitRequest
from iris_sysid.diagnosis.block_means import RANKED, SEARCHED, at_samples, one_a_block
from iris_sysid.diagnosis.evidence import DECISIVE, best_first, cost_above
from iris_sysid.diagnosis.form_test import is_form_open
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.prediction_error import validation_error
from iris_sysid.diagnosis.refit import (
    ModelWithEffects,
    Starts,
    fit_from,
    fitted_forms,
    forms,
    free_values,
    refitted,
    with_free_form,
)
from iris_sysid.diagnosis.screening import Candidate, Screening
from iris_sysid.diagnosis.weak_ranking import WeakRanking
from iris_sysid.types import Array, Effect, FitResult, OdeModel

REFITTED = 4  # best candidates that are refitted in each round
WORTH_REFITTING = 0.7  # fraction of the significant chi-square; a refit can explain more than the first-order test
SAMPLES_A_PART = 10  # samples of each short part of a clip whose end is left out
BEYOND_NOISE = 3.0  # residual over noise from which a long record is searched with few of its samples
GAIN_MARGIN = 0.2  # a rival's first-order gain may be smaller by this fraction; a refit can be that much better


class FitCache:
    """Refits of one set of clips, each computed once.

    Parameters
    ----------
    clips
        The fit requests, one a clip, with their fixed and free values.
    model
        The governing equation to test.
    library
        The effects to test.
    base
        The fits without effects.
    holdout
        Fraction of each short part of a clip that is left out to validate an effect.
    report
        Called with a line of text at each step.
    """

    def __init__(
        self,
        clips: Sequence[FitRequest],
        model: OdeModel,
        library: EffectLibrary,
        base: ModelWithEffects,
        holdout: float,
        report: Callable[[str], None],
    ) -> None:
        self.clips, self.library, self.base, self.report = clips, library, base, report
        self._model, self._holdout = model, holdout
        self.weak = WeakRanking(clips, model, library)
        self._models: dict[frozenset[str], ModelWithEffects] = {base.key: base}
        self._screenings: dict[frozenset[str], Screening] = {}
        self._errors: dict[frozenset[str], float] = {}
        self._open: dict[tuple[frozenset[str], str], bool] = {}  # whether a model and an effect call for another form
        self._few: FitCache | None = None
        self._searched: FitCache | None = None

    @property
    def failed(self) -> list[tuple[str, FitResult]]:
        """The effects that could not be added to the base alone, each with the first fit that failed."""
        alone = [model for model in self._tried() if len(model.effects) == 1 and not model.usable]
        failed = {model.effects[0].name: next(fit for fit in model.fits if not fit.usable) for model in alone}
        return list(failed.items())

    @property
    def tried(self) -> list[ModelWithEffects]:
        """All models that were fitted to all samples."""
        return list(self._models.values())

    def _tried(self) -> Iterator[ModelWithEffects]:
        """All refits, rough ones and those to few samples as well."""
        yield from self._models.values()
        for rough in (self._few, self._searched):
            if rough is not None:
                yield from rough._tried()

    @property
    def _no_starts(self) -> list[Starts]:
        """Starts of effects that the model has already: none, one a clip."""
        return [{} for _ in self.clips]

    def screening(self, current: ModelWithEffects) -> Screening:
        """The score tests of every effect that a model does not have yet."""
        if current.key not in self._screenings:
            effects = self.library.by_name.values()
            self.report(f"screening {len(effects) - len(current.effects)} effects")
            self._screenings[current.key] = Screening.of(effects, current, self.clips)
        return self._screenings[current.key]

    def validation_error(self, current: ModelWithEffects) -> float:
        """The error, in units of the noise, at the ends of many short parts that are left out; NaN where none can be.

        Every part of a clip shows the effects that act at one moment; its last third often does not.
        """
        if current.key not in self._errors:
            parts = max(min(fitted.n for fitted in self.base.fits) // SAMPLES_A_PART, 1)
            self._errors[current.key] = validation_error(self.clips, current, self._holdout, parts)
        return self._errors[current.key]

    def with_added(self, current: ModelWithEffects, candidate: Candidate) -> ModelWithEffects:
        """The model with the effects of a candidate added."""
        effects = [*current.effects, *(self.library.by_name[name] for name in candidate.names)]
        return self._fitted(current, effects, candidate.starts, candidate.names)

    def with_effects(self, effects: Sequence[Effect], starts: Sequence[Starts]) -> ModelWithEffects:
        """The model with these effects, from the sizes and shapes of ``starts``, one a clip."""
        return self._fitted(self.base, effects, starts, [effect.name for effect in effects])

    def continued(self, found: ModelWithEffects, effects: Sequence[Effect]) -> ModelWithEffects:
        """The model with some effects of one that was fitted to fewer samples or roughly, from where that fit ended."""
        return self._fitted(replace(found, units=self.base.units), effects, self._no_starts, ())

    def refitted_again(self, found: ModelWithEffects, *, rough: bool = False) -> ModelWithEffects:
        """The same model as one that was fitted to fewer samples, in its shapes; takes the place of one that failed.

        Parameters
        ----------
        found
            The model.
        rough
            Whether to end as fits do that compare models: a fit of long records can creep for ever.
        """
        start = replace(found, units=self.base.units)
        clips = [clip.roughly() for clip in self.clips] if rough else self.clips
        self._models[found.key] = refitted(clips, start, self._model, found.effects, self._no_starts)
        return self._models[found.key]

    def without(self, current: ModelWithEffects, effect: Effect) -> ModelWithEffects:
        """The model with one of its effects removed."""
        effects = [other for other in current.effects if other.name != effect.name]
        if len(effects) != 1 or fitted_forms(effects[0]):
            return self._fitted(current, effects, self._no_starts, ())
        # a model with a single effect is always fitted from the base
        alone = self.with_added(self.base, self.screening(self.base).single(effects[0].name))
        if not alone.usable:
            alone = refitted(self.clips, current, self._model, effects, self._no_starts)
            self._models[alone.key] = alone
        return alone

    def _fitted(
        self, current: ModelWithEffects, effects: Sequence[Effect], starts: Sequence[Starts], added: Sequence[str]
    ) -> ModelWithEffects:
        names = [effect.name for effect in effects]
        key = frozenset([*names, *(name for effect in effects for name in fitted_forms(effect))])
        if key not in self._models:
            if added:
                self.report(f"refitting with {', '.join(added)}")
            self._models[key] = refitted(self.clips, current, self._model, effects, starts)
        return self._models[key]

    def with_free_form(self, current: ModelWithEffects, effect: Effect) -> ModelWithEffects | None:
        """The model with the form of one of its effects fitted, instead of the one that it usually has.

        None where the effect has no form that is held, or the residual does not call for another one.
        """
        if not forms(effect) or fitted_forms(effect):
            return None
        key = current.key, effect.name
        if key not in self._open:
            self._open[key] = is_form_open(self.clips, current, effect)
        if not self._open[key]:
            return None
        effects = [with_free_form(other) if other.name == effect.name else other for other in current.effects]
        return self._fitted(current, effects, self._no_starts, forms(effect))

    def with_usual_form(self, current: ModelWithEffects, effect: Effect) -> ModelWithEffects | None:
        """The model with the form of one of its effects as it usually is, instead of fitted; None where it is held."""
        if not fitted_forms(effect):
            return None
        usual = self.library.by_name[effect.name]
        effects = [usual if other.name == effect.name else other for other in current.effects]
        sizes = [fitted.estimates[effect.parameters[0].name].value for fitted in current.fits]
        starts: list[Starts] = [{effect.name: (size, ())} for size in sizes]
        return self._fitted(current, effects, starts, [effect.name])

    def refits(self, current: ModelWithEffects, candidates: Sequence[Candidate]) -> list[ModelWithEffects]:
        """The usable refits with the most promising candidates, the one with the smallest criterion first."""
        allowed = [candidate for candidate in candidates if self.library.allows(candidate)]
        worth = [candidate for candidate in allowed if candidate.ratio > WORTH_REFITTING][:REFITTED]
        alone = [candidate for candidate in candidates if len(candidate.names) == 1]
        # far off, neither gains nor signs are to be trusted
        chosen = self._best_of(current, alone) if current.far_off and alone else worth
        models = [self.with_added(current, candidate) for candidate in self._contending(current, chosen)]
        usable = [model for model in models if model.usable and self.library.allows_fit(model)]
        return best_first(usable)

    def _contending(self, current: ModelWithEffects, candidates: Sequence[Candidate]) -> Sequence[Candidate]:
        """Of candidates those that the first samples of a long driven record do not rule out against the best."""
        driven = self.clips[0].trajectory.inputs is not None
        few = self._with_few_samples() if driven and len(candidates) > 1 else None
        if few is None:
            return candidates
        start = replace(current, units=few.base.units)
        models = [few.with_added(start, candidate) for candidate in candidates]
        best = best_first([model for model in models if model.usable])[:1]
        pairs = zip(candidates, models, strict=True)
        return [
            candidate
            for candidate, model in pairs
            if not model.usable or all(cost_above(model, each) < DECISIVE for each in best)
        ]

    def best_of(self, current: ModelWithEffects, names: Sequence[str]) -> Sequence[Candidate]:
        """Of single effects those that explain most, by rough refits to few samples; all of a short clip.

        Parameters
        ----------
        current
            The model that they are added to.
        names
            Of the effects.
        """
        screening = self.screening(current)
        return self._best_of(current, [screening.single(name) for name in names])

    def _best_of(self, current: ModelWithEffects, candidates: Sequence[Candidate]) -> Sequence[Candidate]:
        """The best of many candidates, and those nearly as good, by rough refits to few samples; all of short clips."""
        few = self._with_few_samples() if len(candidates) > REFITTED else None
        if few is None:
            return candidates
        start = replace(current, units=few.base.units)
        models = [few.with_added(start, candidate) for candidate in candidates]
        ranked = best_first([model for model in models if model.usable and self.library.allows_fit(model)])
        near = [model for model in ranked[REFITTED:] if cost_above(model, ranked[0]) < DECISIVE]
        names = {model.names - current.names for model in (*ranked[:REFITTED], *near)}
        return [candidate for candidate in candidates if frozenset(candidate.names) in names]

    def _with_few_samples(self) -> FitCache | None:
        """A cache of rough refits to one sample of each short block of the clips; None where blocks have one sample."""
        if self._few is None:
            clips, units = self._at_samples(RANKED)
            if units is None:
                return None
            rough = [clip.roughly() for clip in clips]
            base = replace(self.base, units=units)
            self._few = FitCache(rough, self._model, self.library, base, self._holdout, self.report)
        return self._few

    def for_search(self) -> FitCache:
        """A cache of rough refits, of long clips to one sample of each short block."""
        clips, units = self._at_samples(SEARCHED)
        if units is None or self.base.squares < BEYOND_NOISE**2 * sum(unit.size for unit in self.base.units):
            clips, units = list(self.clips), self.base.units
        rough = [clip.roughly() for clip in clips]
        fits = [
            fit_from(clip, fitted.model, free_values(fitted))
            for clip, fitted in zip(rough, self.base.fits, strict=True)
        ]
        base = replace(self.base, fits=tuple(fits), units=units)
        if not base.usable:
            return self
        self._searched = FitCache(rough, self._model, self.library, base, self._holdout, self.report)
        return self._searched

    def _at_samples(self, few: int) -> tuple[list[FitRequest], tuple[Array, ...] | None]:
        """The clips at one sample of each block, and the units of their residuals; None where each sample is one."""
        pairs = list(zip(self.clips, self.base.fits, strict=True))
        which = [one_a_block(fitted, clip.trajectory, few) for clip, fitted in pairs]
        if all(each.size == fitted.n for each, fitted in zip(which, self.base.fits, strict=True)):
            return list(self.clips), None
        clips = [
            clip.with_(trajectory=at_samples(clip.trajectory, kept))
            for clip, kept in zip(self.clips, which, strict=True)
        ]
        each = zip(self.base.units, which, clips, strict=True)
        return clips, tuple(unit if clip.trajectory.n == len(unit) else unit[kept] for unit, kept, clip in each)

    def testable(self, current: ModelWithEffects) -> frozenset[str]:
        """The effects that the parameters of neither this model nor the base can imitate."""
        return self.screening(self.base).visible & self.screening(current).visible

    def rivals(self, rest: ModelWithEffects, effect: Effect) -> list[ModelWithEffects]:
        """Refits of ``rest`` with one effect whose first-order gain is nearly that of ``effect``, or larger."""
        screening, testable = self.screening(rest), self.testable(rest)
        least = (1.0 - GAIN_MARGIN) * screening.score(effect.name).gain
        near = [name for name in screening.names if name in testable and screening.score(name).gain > least]
        return self.refits(rest, [screening.single(name) for name in near])

    def refitted(self, rest: ModelWithEffects) -> frozenset[str]:
        """The effects that have a usable refit beside those of ``rest``"""
        added = [model.names - rest.names for model in self._tried() if model.key > rest.key and model.usable]
        return frozenset(name for names in added if len(names) == 1 for name in names)

    def in_place_of(self, final: ModelWithEffects, effect: Effect) -> list[ModelWithEffects]:
        """The models in which another effect replaces ``effect``: the nearest are refitted, and all there are count."""
        rest = self.without(final, effect)
        rivals = {model.key: model for model in (*self.rivals(rest, effect), *self._beside(rest))}
        return [rival for rival in rivals.values() if rival.names != final.names]

    def equally_good(self, final: ModelWithEffects, effect: Effect) -> list[ModelWithEffects]:
        """The models in which another effect replaces ``effect`` and explains the data as well, best first."""
        return best_first([rival for rival in self.in_place_of(final, effect) if cost_above(rival, final) < DECISIVE])

    def _beside(self, rest: ModelWithEffects) -> list[ModelWithEffects]:
        """The usable refits there are already with one more effect than ``rest``."""
        more = [
            model
            for model in self._models.values()
            if model.names > rest.names and len(model.effects) == len(rest.effects) + 1 and model.key >= rest.key
        ]
        return [model for model in more if model.usable and self.library.allows_fit(model)]
