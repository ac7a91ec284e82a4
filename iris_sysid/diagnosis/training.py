"""The sealed hold-out: a search that does not see some of the samples, and how well it predicts them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from fitters.ode import FitRequest
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.prediction_error import Indices, held_out, prediction_error, without_samples
from iris_sysid.diagnosis.refit import ModelWithEffects, fit_from, free_values
from iris_sysid.diagnosis.stepwise_search import StepwiseSearch
from iris_sysid.types import DiagnosticNote, Effect, NoteKind, OdeModel

PARTS = 3  # of a clip, each with its end held out: beyond its last third only errors of parameters would be measured


@dataclass(frozen=True, eq=False, slots=True)
class Training:
    """What a search in a part of the samples found, and its errors over the others, which it has not seen.

    ``base`` and ``final`` are fits to that part, without and with the effects found there; ``left_out`` are the
    indices (m,) of the other samples, one a clip. Errors are the root mean square over them, in the observed unit and
    in units of each sample's noise.
    """

    base: ModelWithEffects
    final: ModelWithEffects
    left_out: tuple[Indices, ...]
    errors_before: tuple[float, float]
    errors_after: tuple[float, float]

    @classmethod
    def of(
        cls,
        clips: Sequence[FitRequest],
        model: OdeModel,
        library: EffectLibrary,
        base: ModelWithEffects,
        share: float,
        say: Callable[[str], None],
    ) -> Training | None:
        """Search without the last ``share`` of each third of a clip; None where too few samples would be left.

        Parameters
        ----------
        clips, model, library, base
            As for :class:`FitCache`, with all samples.
        share
            Fraction of each part of a clip, at its end, that is held out.
        say
            Called with a line of text at each step.
        """
        ends = [held_out(fitted, share, PARTS) for fitted in base.fits]
        left_out = tuple(end for end in ends if end is not None)
        if len(left_out) < len(ends):
            return None
        parts = [without_samples(clip, later) for clip, later in zip(clips, left_out, strict=True)]
        fits = [fit_from(part, model, free_values(fitted)) for part, fitted in zip(parts, base.fits, strict=True)]
        if not all(fitted.usable for fitted in fits):
            return None
        start = ModelWithEffects.without_effects(parts, fits)
        final = StepwiseSearch(FitCache(parts, model, library, start, share, say)).run()[-1]
        errors = [prediction_error(clips, trained, left_out) for trained in (start, final)]
        return cls(start, final, left_out, errors[0], errors[1])

    def refitted(self, cache: FitCache) -> ModelWithEffects | None:
        """The effects found, fitted to all samples; None where there are none, or where they cannot be fitted."""
        if not self.final.effects:
            return None
        starts = tuple(
            {
                effect.name: (values[0], tuple(values[1:]))
                for effect in self.final.effects
                for values in [[fitted.estimates[parameter.name].value for parameter in effect.parameters]]
            }
            for fitted in self.final.fits
        )
        model = cache.with_effects(self.final.effects, starts)
        return model if model.usable and cache.library.allows_fit(model) else None

    def notes(self, final: ModelWithEffects) -> tuple[DiagnosticNote, ...]:
        """What the hold-out does not test, and where it contradicts.

        Parameters
        ----------
        final
            The effects named in the end, fitted to all samples.
        """
        found, names = ", ".join(self.final.names_in_order), self.final.names
        new = [effect for effect in final.effects if effect.name not in names]
        late = [effect.name for effect in new if self._acts_late(effect, final)]
        faint = [effect.name for effect in new if effect.name not in late]
        gone = sorted(names - final.names)
        worse = bool(names) and not self.errors_after[1] < self.errors_before[1]
        texts: list[tuple[NoteKind, str, bool]] = [
            ("late", f"{', '.join(late)} acts in held-out samples only, so no held-out error tests it", bool(late)),
            ("late", f"{', '.join(faint)}: found with all samples only; the held-out error is without it", bool(faint)),
            ("late", f"{', '.join(gone)}: found without the held-out samples, but not with all", bool(gone)),
            ("not-predictive", f"{found} predicts the held-out samples no better than the model alone", worse),
        ]
        return tuple(DiagnosticNote(kind, text) for kind, text, holds in texts if holds)

    def _acts_late(self, effect: Effect, final: ModelWithEffects) -> bool:
        """Whether an effect acts at a time from which on, in a clip, all samples were held out."""
        times = [each.name for each in effect.parameters if each.role == "location" and each.unit == "s"]
        return any(
            fitted.estimates[name].value >= fitted.t_s[_last_run(later)]
            for fitted, later in zip(final.fits, self.left_out, strict=True)
            for name in times
        )


def _last_run(indices: Indices) -> int:
    """The first of the consecutive indices with which a list of them ends."""
    breaks = np.flatnonzero(np.diff(indices) > 1)
    return int(indices[breaks[-1] + 1] if breaks.size else indices[0])
