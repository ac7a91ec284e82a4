"""A cache of refits: every set of effects is fitted, screened and validated once."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from fitters.ode import FitRequest
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.prediction_error import errors_of
from iris_sysid.diagnosis.refit import ModelWithEffects, Starts, refitted
from iris_sysid.diagnosis.screening import Candidate, Screening
from iris_sysid.types import Effect, Errors, FitResult, OdeModel

REFITTED = 4  # best candidates that are refitted in each round
WORTH_REFITTING = 0.7  # fraction of the significant chi-square; a refit can explain more than the first-order test
NEARLY = 0.2  # a rival's first-order gain may be smaller by this fraction; a refit can be that much better


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
        Fraction of each clip that is held out for the prediction error.
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
        self._models: dict[frozenset[str], ModelWithEffects] = {base.names: base}
        self._screenings: dict[frozenset[str], Screening] = {}
        self._errors: dict[tuple[frozenset[str], int], Errors] = {}

    @property
    def failed(self) -> list[tuple[str, FitResult]]:
        """The effects that could not be added to the base alone, each with the first fit that failed."""
        alone = [model for model in self._models.values() if len(model.effects) == 1 and not model.usable]
        return [(model.effects[0].name, next(fit for fit in model.fits if not fit.usable)) for model in alone]

    def screening(self, current: ModelWithEffects) -> Screening:
        """The score tests of every effect that a model does not have yet."""
        if current.names not in self._screenings:
            effects = self.library.by_name.values()
            self.report(f"screening {len(effects) - len(current.effects)} effects")
            self._screenings[current.names] = Screening.of(effects, current, self.clips)
        return self._screenings[current.names]

    def errors(self, current: ModelWithEffects, parts: int = 1) -> Errors:
        """The prediction errors of a model; each clip is cut into ``parts`` and the end of each part is held out."""
        key = current.names, parts
        if key not in self._errors:
            self._errors[key] = errors_of(self.clips, current, self._holdout, parts)
        return self._errors[key]

    def with_added(self, current: ModelWithEffects, candidate: Candidate) -> ModelWithEffects:
        """The model with the effects of a candidate added."""
        effects = [*current.effects, *(self.library.by_name[name] for name in candidate.names)]
        return self._fitted(current, effects, candidate.starts, candidate.names)

    def without(self, current: ModelWithEffects, effect: Effect) -> ModelWithEffects:
        """The model with one of its effects removed."""
        effects = [other for other in current.effects if other.name != effect.name]
        no_starts: list[Starts] = [{}] * len(self.clips)
        if len(effects) != 1:
            return self._fitted(current, effects, no_starts, ())
        # a model with a single effect is always fitted from the base
        alone = self.with_added(self.base, self.screening(self.base).single(effects[0].name))
        if not alone.usable:
            alone = refitted(self.clips, current, self._model, effects, no_starts)
            self._models[alone.names] = alone
        return alone

    def _fitted(
        self, current: ModelWithEffects, effects: Sequence[Effect], starts: Sequence[Starts], added: Sequence[str]
    ) -> ModelWithEffects:
        key = frozenset(effect.name for effect in effects)
        if key not in self._models:
            if added:
                self.report(f"refitting with {', '.join(added)}")
            self._models[key] = refitted(self.clips, current, self._model, effects, starts)
        return self._models[key]

    def refits(self, current: ModelWithEffects, candidates: Sequence[Candidate]) -> list[ModelWithEffects]:
        """The usable refits with the most promising candidates, smallest cost first."""
        allowed = [candidate for candidate in candidates if self.library.allows(candidate)]
        worth = [candidate for candidate in allowed if candidate.ratio > WORTH_REFITTING]
        models = [self.with_added(current, candidate) for candidate in worth[:REFITTED]]
        usable = [model for model in models if model.usable and self.library.allows_fit(model)]
        return sorted(usable, key=lambda model: model.cost)

    def testable(self, current: ModelWithEffects) -> frozenset[str]:
        """The effects that the parameters of neither this model nor the base can imitate."""
        return self.screening(self.base).visible & self.screening(current).visible

    def rivals(self, rest: ModelWithEffects, effect: Effect) -> list[ModelWithEffects]:
        """Refits of ``rest`` with one effect whose first-order gain is nearly that of ``effect``, or larger."""
        screening, testable = self.screening(rest), self.testable(rest)
        least = (1.0 - NEARLY) * screening.score(effect.name).gain
        near = [name for name in screening.names if name in testable and screening.score(name).gain > least]
        return self.refits(rest, [screening.single(name) for name in near])

    def equally_good(self, final: ModelWithEffects, effect: Effect) -> list[ModelWithEffects]:
        """The models in which another effect replaces ``effect`` and explains the data as well."""
        rivals = self.rivals(self.without(final, effect), effect)
        return [rival for rival in rivals if rival.names != final.names and rival.cost - final.cost < final.margin]
