"""The result of a diagnosis: missing effects, the error before and after, and limits on all other effects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from iris_sysid.types._component_words import KINDS_IN_WORDS
from iris_sysid.types._components import Component, Components, Finding
from iris_sysid.types._discovery import DiscoveredTerm
from iris_sysid.types._display import Shown, text_of, values_of
from iris_sysid.types._model import Effect, EffectCause
from iris_sysid.types._numbers import Estimate
from iris_sysid.types._result import FitResult, imprecise, relative_errors
from iris_sysid.types._verdict import Completeness, Doubt, Verdict, VerdictWord, times_text, worst_verdict

UNEXPLAINED = 2.0  # residual / noise above which the model is incomplete: the noise estimate errs by less
NOISE_UNSURE = 3.0  # the same where it may be correlated or quantised noise: 3 is a correlation of 0.8 over one sample
NAMED = 0.9  # probability of an added effect below which another one may act instead
INCOMPLETE = "The equation lacks more than was found: look at the parts of the residual"
SEVERAL_NAMES = "A longer clip, a larger motion or a second clip tells them apart"

NoteKind = Literal[
    "base-fit",
    "noise",
    "no-effect",
    "refit-failed",
    "rejected-sign",
    "rejected-size",
    "negative-damping",
    "weak",
    "quantisation",
    "level-noise",
    "input-gap",
    "stopped",
]


@dataclass(frozen=True, slots=True)
class Score:
    """One effect in one round of score tests, from its sensitivity alone: nothing is refitted.

    ``size`` and ``stderr`` are its first-order estimate in ``unit``; ``gain`` is the fraction of the residual's
    sum of squares ``total``, in units of the noise, that it would explain; ``chi2`` is the resulting decrease of
    the chi-square for white noise, with ``degrees`` degrees of freedom. ``size`` and ``stderr`` are NaN when the data
    cannot show the effect. ``shape`` holds the best values of its other parameters, of ``tried`` sets of them.
    Below ``resolvable_size`` the effect changes the trajectory by less than its stated errors. ``shifts`` say by
    how much each fitted value changes when the effect is added, per unit of its size.
    """

    effect: str
    size: float
    stderr: float
    unit: str
    gain: float
    total: float
    chi2: float
    degrees: int = 1
    shape: tuple[float, ...] = ()
    tried: int = 1
    resolvable_size: float = 0.0
    shifts: Mapping[str, float] = field(default_factory=dict)

    @property
    def z(self) -> float:
        """Size in standard errors; NaN where there is none."""
        return self.size / self.stderr if self.stderr > 0 else float("nan")

    @property
    def explained(self) -> float:
        """The sum of squares that it would explain, in units of the noise."""
        return self.gain * self.total

    def over(self, factor: float) -> Score:
        """The same with the size in a unit that is ``factor`` times as large."""
        if factor == 1.0:
            return self
        shifts = {name: factor * shift for name, shift in self.shifts.items()}
        sizes = {name: getattr(self, name) / factor for name in ("size", "stderr", "resolvable_size")}
        return replace(self, shifts=shifts, **sizes)


def _left_open(fitted: FitResult) -> set[str]:
    """The free values that the data of a fit do not determine."""
    found = fitted.estimates
    return {name for name in fitted.free if name in found and not math.isfinite(found[name].stderr)}


@dataclass(frozen=True, slots=True)
class Limit:
    """The largest size of an effect that the data allow, at 95 % confidence; NaN where they say nothing.

    Never below the size that the stated errors of the track can hide.
    """

    effect: str
    parameter: str
    upper_95: float
    unit: str


@dataclass(frozen=True, slots=True)
class PredictionErrors:
    """Root mean square of the residual, in the observed unit: over the samples fitted, and over those held out.

    Blocks of each clip are left out in turn, as a whole, and predicted by the fit to the rest. With several clips, the
    size of every effect comes from the other clips. ``weighed`` is the held-out error in units of each sample's noise.
    NaN where nothing could be held out.
    """

    fitted: float
    heldout: float
    weighed: float


@dataclass(frozen=True, slots=True)
class DiagnosticNote:
    """A note on the result: ``kind`` is its code, ``text`` its wording.

    ``base-fit``: the fit without effects is doubtful. ``noise``: the noise hides the motion. ``no-effect``: no effect
    of the library applies, or the fitted parameters imitate all of them. ``refit-failed``: an effect could not be
    fitted. ``rejected-sign``: the residual fits an effect whose size would add energy, or water. ``rejected-size``: it
    fits an effect that changes the trajectory by less than its stated errors. ``negative-damping``: a damping of the
    model is below zero. ``weak``: an effect was significant, but the interval of its size holds zero.
    ``quantisation``: a sensor's step makes most of the residual. ``level-noise``: the noise depends on the level.
    ``stopped``: the search ended before all was tried.
    """

    kind: NoteKind
    text: str


@dataclass(frozen=True, eq=False, slots=True)
class Diagnosis(Shown):
    """The effects that a model lacks, if any.

    ``bases`` and ``finals`` are fits to the same samples, one a clip, without and with the effects; ``added`` are
    the effects in the order in which they were found; ``sizes`` by parameter name their model-averaged size over all
    clips. ``rounds`` hold the score tests of each round, best first. ``indistinguishable`` names, for each effect
    added, those that explain the data as well, and ``probabilities`` the probability of each of them and of the effect
    itself, given that one of them acts; ``causes`` sums them up: physics, measurement or clock. ``ruled_out`` has a
    limit for every other effect. ``before`` and ``after`` are the errors without and with the effects,
    ``noise_floor`` the noise of the measurement, all in ``unit``. ``proposed`` are terms without a named effect, where
    the residual is above that noise. ``notes`` say what could not be tested, or was rejected, and why.
    ``components`` are the parts of the first clip's residual without effects, ``remaining`` those of the residual with
    them; None where the clip is too short to be split. ``findings`` say of each part what can be said: an effect, a
    group of effects, where it lies, or that it is open. ``nuisances`` are effects that are in ``finals`` as well,
    because they improve the prediction, but which are not named: they can imitate a part of anything.
    """

    bases: tuple[FitResult, ...]
    finals: tuple[FitResult, ...]
    added: tuple[Effect, ...]
    sizes: Mapping[str, Estimate]
    rounds: tuple[tuple[Score, ...], ...]
    indistinguishable: Mapping[str, tuple[str, ...]]
    ruled_out: tuple[Limit, ...]
    before: PredictionErrors
    after: PredictionErrors
    noise_floor: float
    unit: str
    proposed: tuple[DiscoveredTerm, ...] = ()
    notes: tuple[DiagnosticNote, ...] = ()
    probabilities: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    causes: Mapping[str, Mapping[EffectCause, float]] = field(default_factory=dict)
    components: Components | None = None
    remaining: Components | None = None
    findings: tuple[Finding, ...] = ()
    nuisances: tuple[Effect, ...] = ()

    @property
    def base(self) -> FitResult:
        """The first clip's fit without the effects."""
        return self.bases[0]

    @property
    def final(self) -> FitResult:
        """The first clip's fit with the effects."""
        return self.finals[0]

    @property
    def residual_ratio(self) -> float:
        """The residual that remains, over the noise of the measurement; 1 where that is zero."""
        return self.after.fitted / self.noise_floor if self.noise_floor > 0 else 1.0

    @property
    def incomplete(self) -> bool:
        """Whether the residual that remains is far above the noise.

        The noise is measured from sample to sample, which tells less than there is of correlated noise: up to three
        times as much is noise where neither the components nor the fit say that it has another form.
        """
        left = self.remaining if self.added else self.components
        formless = left is not None and not left.parts and all(final.ok for final in self.finals)
        return self.residual_ratio > (NOISE_UNSURE if formless else UNEXPLAINED)

    @property
    def verdict(self) -> Verdict:
        """Whether the values with the effects can be used, and whether the equation with them is complete."""
        fits = worst_verdict(final.verdict for final in self._telling)
        accuracy = {**fits.accuracy, **relative_errors(self.sizes, fits.accuracy)}  # a size allows for further effects
        lacks = self.incomplete or self._lacking is not None
        if lacks:
            finding = f"the residual is {times_text(self.residual_ratio)} the noise"  # once, not of each fit as well
            found, last = fits.number_reasons, [Doubt("incomplete", finding, INCOMPLETE)]
            equation = self._incomplete_equation(fits.equation)
        else:
            found, last = fits.reasons, []
            equation = fits.equation and replace(fits.equation, residual_over_noise=self.residual_ratio)
        unsure = [Doubt("several-names", self._names_text(name), SEVERAL_NAMES) for name in self._unsure()]
        if "imprecise" not in (doubt.kind for doubt in found):
            unsure += imprecise(accuracy, complete=equation is None or equation.complete)
        word: VerdictWord = "doubtful" if unsure and fits.good else fits.word
        return Verdict(word, (*found, *unsure, *last), equation, accuracy)

    @property
    def _telling(self) -> list[FitResult]:
        """The fits with the effects, without those of clips in which an effect that others tell does not act."""
        of_effects = {parameter.name for effect in self.added for parameter in effect.parameters}
        known = (item for final in self.finals for item in final.estimates.items())
        told = {name for name, estimate in known if math.isfinite(estimate.stderr)}
        return [
            final for final in self.finals if not (unknown := _left_open(final)) or not unknown <= of_effects & told
        ]

    @property
    def _left(self) -> tuple[Component, ...]:
        """The parts of the residual that the effects leave."""
        left = self.remaining if self.added else self.components
        return () if left is None else left.parts

    @property
    def _lacking(self) -> Component | None:
        """The largest part of the residual that remains and acts in the equation; None where there is none."""
        in_equation = (part for part in self._left if part.side in ("force", "input"))
        return next((part for part in in_equation if part.probability >= NAMED), None)

    def _incomplete_equation(self, fitted: Completeness | None) -> Completeness | None:
        """What the equation with the effects explains, and the largest part of what it does not."""
        if fitted is None:
            return None
        largest = next(iter(self._left), None)
        rest = f"{100 * largest.share:.0f} % of it {KINDS_IN_WORDS[largest.kind]}" if largest is not None else ""
        return Completeness(fitted.explained, False, self.residual_ratio, rest)

    def _unsure(self) -> list[str]:
        """The added effects that another one may replace."""
        return [
            effect.name
            for effect in self.added
            if self.indistinguishable.get(effect.name)
            and self.probabilities.get(effect.name, {}).get(effect.name, 0.0) < NAMED
        ]

    def _names_text(self, name: str) -> str:
        return f"{name} is indistinguishable from {', '.join(self.indistinguishable[name])}"

    def __repr__(self) -> str:
        added = ", ".join(effect.name for effect in self.added) or "no effect"
        return text_of(
            f"Diagnosis of {self.base.model.name}, {len(self.bases)} clip{'s' * (len(self.bases) > 1)}: "
            f"{self.verdict.text}",
            f"added {added}" + (f": {values_of(self.sizes)}" if self.sizes else ""),
            f"residual {self.before.fitted:.3g} before, {self.after.fitted:.3g} after, noise {self.noise_floor:.3g} "
            f"{self.unit}",
        )
