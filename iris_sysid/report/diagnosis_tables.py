"""The tables of a diagnosis, as folded sections of its page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.report.diagnosis_text import changed_parameters, size_text
from iris_sysid.report.page import Section, fit_section, numbers, words
from iris_sysid.report.text import as_sentence, interval_text, probability_text, with_error
from iris_sysid.types import Diagnosis, EffectCause, FitResult, Score, Trajectory, with_unit

MIN_SHARE = 0.0005  # of the residual; a smaller part is "0.0 %"
WITHOUT, WITH = "without the added effects", "with the added effects"
UNDETERMINED = "not identifiable"


def diagnosis_sections(diagnosis: Diagnosis, clips: Sequence[Trajectory]) -> list[Section]:
    """Effects, errors, fits, clips, limits and score tests, none empty; ``clips`` as they were diagnosed."""
    changed = [(name, with_error(base), with_error(final)) for name, base, final in changed_parameters(diagnosis)]
    assuming = {WITH: f"Fit {WITH}, assuming no further missing effect", WITHOUT: f"Fit {WITHOUT}", "": "Fit"}
    sections = [
        _added_section(diagnosis),
        _error_section(diagnosis),
        Section("Parameters that change", (*words("parameter"), *numbers(WITHOUT, WITH)), changed),
        *(fit_section(assuming[which], fit) for fit, which in fits_of(diagnosis)),
        *([_clips_section(diagnosis, clips)] if len(clips) > 1 else []),
        _suggested_section(diagnosis),
        _limits_section(diagnosis),
        *(_score_section(number, scores) for number, scores in enumerate(diagnosis.rounds, start=1)),
        Section("Notes", lines=[as_sentence(note.text) for note in diagnosis.notes]),
    ]
    return [section for section in sections if section.rows or section.more or section.lines]


def _added_section(diagnosis: Diagnosis) -> Section:
    """Model-averaged sizes of the added effects over all clips, and the effects indistinguishable from them."""
    rows = [
        (
            effect.name,
            parameter.name,
            with_error(diagnosis.sizes[parameter.name]),
            interval_text(diagnosis.sizes[parameter.name]),
            _shares(diagnosis.probabilities.get(effect.name, {})),
            _shares(diagnosis.causes.get(effect.name, {})),
        )
        for effect in diagnosis.added
        for parameter in effect.parameters
        if diagnosis.sizes[parameter.name].stderr > 0
    ]
    sizes = numbers("value ± standard error", "95 % interval (model-averaged)")
    columns = (*words("effect", "parameter"), *sizes, *words("this or what explains the data as well", "cause"))
    return Section("Missing effects", columns, rows)


def _shares(probabilities: Mapping[str, float] | Mapping[EffectCause, float]) -> str:
    """Names with their probabilities in percent."""
    return ", ".join(f"{name} {probability_text(probability)}" for name, probability in probabilities.items())


def fits_of(diagnosis: Diagnosis) -> list[tuple[FitResult, str]]:
    """The first clip's fit with the effects and without; a single fit where no effect was added."""
    if not diagnosis.added:
        return [(diagnosis.base, "")]
    return [(diagnosis.final, WITH), (diagnosis.base, WITHOUT)]


def _clips_section(diagnosis: Diagnosis, clips: Sequence[Trajectory]) -> Section:
    """Residual and effects of each clip."""
    names = [effect.parameters[0].name for effect in diagnosis.added]
    rows = [
        (
            str(clip.origin.get("source", "trajectory")),
            *(_error_text(_rms(fit), diagnosis.unit) for fit in (base, final)),
            *(with_error(final.estimates[name]) for name in names),
        )
        for clip, base, final in zip(clips, diagnosis.bases, diagnosis.finals, strict=True)
    ]
    return Section("Clips", (*words("clip"), *numbers("residual before", "residual after", *names)), rows)


def _rms(fit: FitResult) -> float:
    return float(np.sqrt(np.nanmean(fit.residual[fit.used] ** 2)))


def _error_section(diagnosis: Diagnosis) -> Section:
    rows = [
        (
            when,
            *(_error_text(error, diagnosis.unit) for error in (errors.fitted, errors.heldout, diagnosis.noise_floor)),
        )
        for when, errors in (("before", diagnosis.before), ("after", diagnosis.after))
    ]
    columns = (*words("when"), *numbers("fitted samples", "held-out samples", "noise"))
    if diagnosis.added:
        return Section("Error before and after", columns, rows)
    return Section("Error", columns[1:], [row[1:] for row in rows[:1]])


def _error_text(error: float, unit: str) -> str:
    return size_text(error, unit) if np.isfinite(error) else "no samples to spare"


def _suggested_section(diagnosis: Diagnosis) -> Section:
    """Terms that the remaining residual suggests."""
    rows = [
        (f"{term.term} in {term.equation}", with_error(term.coefficient), f"{100 * term.inclusion:.0f} %")
        for term in diagnosis.proposed
    ]
    columns = (
        *words("term without a named effect"),
        *numbers("coefficient, to first order", "selected in resampled data"),
    )
    return Section("Suggested terms", columns, rows)


def _limits_section(diagnosis: Diagnosis) -> Section:
    known = [limit for limit in diagnosis.ruled_out if np.isfinite(limit.upper_95)]
    rows = [(limit.effect, with_unit(f"{limit.upper_95:.2g}", limit.unit)) for limit in known]
    more = [(limit.effect, UNDETERMINED) for limit in diagnosis.ruled_out if not np.isfinite(limit.upper_95)]
    columns = (*words("effect"), *numbers("largest size, at 95 %"))
    return Section("Upper limits on other effects", columns, rows, more=more)


def _score_section(number: int, scores: tuple[Score, ...]) -> Section:
    columns = (
        *words("effect"),
        *numbers("of the residual explained", "size, to first order", "size / standard error"),
    )
    shown = [_score_row(score) for score in scores if score.gain >= MIN_SHARE]
    more = [_score_row(score) for score in scores if not score.gain >= MIN_SHARE]
    return Section(f"Score tests, round {number}", columns, shown, more=more)


def _score_row(score: Score) -> tuple[str, ...]:
    size = with_unit(f"{score.size:.3g} ± {score.stderr:.2g}", score.unit) if np.isfinite(score.size) else UNDETERMINED
    z = f"{score.z:.1f}" if np.isfinite(score.z) else ""
    return score.effect, f"{100 * score.gain:.3g} %", size, z
