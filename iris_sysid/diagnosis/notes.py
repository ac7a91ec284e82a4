"""Notes on a diagnosis: what was not tested, and which effects were rejected."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.ode import FitRequest
from fitters.ode.known_inputs import gaps_of_inputs
from fitters.ode.result import energy_gains
from iris_sysid.diagnosis.measurement_errors import RESOLVED_AT, RESOLVED_SAMPLES
from iris_sysid.types import DiagnosticNote, Estimate, FitResult, NoteKind, Score, with_unit

MAX_NAMED = 3  # clips or effects that a note names; further ones are counted
REJECTED = {
    "rejected-sign": "because a negative value adds energy (in a tank: water), or acts before its cause",
    "rejected-size": f"because it moves fewer than {RESOLVED_SAMPLES} samples by {RESOLVED_AT:g} stated errors",
}


def diagnostic_notes(
    bases: Sequence[FitResult], scores: Sequence[Score], failed: Sequence[tuple[str, FitResult]]
) -> tuple[DiagnosticNote, ...]:
    """Say where the base fits are doubtful, the noise hides the motion, no effect can be tested, or a refit failed.

    Parameters
    ----------
    bases
        Fits of the model as it was given, one a clip.
    scores
        The first round of score tests; empty when no effect applies.
    failed
        Each effect that could not be fitted, with the fit that failed.
    """
    doubtful = [
        f"{_clip(k, bases)}the fit without effects is {fit.status}: {fit.finding}"
        for k, fit in enumerate(bases)
        if fit.status in ("at-bound", "singular")
    ]
    hidden = [f"{_clip(k, bases)}{text}" for k, fit in enumerate(bases) for text in _noise_above_motion(fit)]
    return (
        *_notes("base-fit", doubtful),
        *_notes("noise", hidden),
        *(DiagnosticNote("no-effect", text) for text in _nothing_tested(scores)),
        *(DiagnosticNote("refit-failed", _failure(name, fit)) for name, fit in failed),
    )


def rejected_effect_note(scores: Sequence[Score], kind: NoteKind) -> tuple[DiagnosticNote, ...]:
    """Name the effects that explain the residual but were rejected, and say why; no note without such effects.

    Parameters
    ----------
    scores
        Scores of these effects, best first.
    kind
        A key of REJECTED.
    """
    if not scores:
        return ()
    best, similar = scores[0], [score.effect for score in scores[1:]]
    more = f" and {len(similar) - MAX_NAMED} more" if len(similar) > MAX_NAMED else ""
    others = f" (similar: {', '.join(similar[:MAX_NAMED])}{more})" if similar else ""
    size = f"{best.effect} = {with_unit(f'{best.size:.2g}', best.unit)}"
    return (DiagnosticNote(kind, f"the residual fits best with {size}{others}; rejected, {REJECTED[kind]}"),)


def weak_notes(sizes: Sequence[tuple[str, Estimate]]) -> tuple[DiagnosticNote, ...]:
    """Name the effects that were significant, but whose size has an interval that holds zero.

    Parameters
    ----------
    sizes
        Name and size of each.
    """
    texts = [
        f"{name} = {with_unit(f'{size.value:.2g}', size.unit)} is not named: "
        + (f"its 95 % interval, {low:.2g} to {high:.2g}, holds zero" if low < high else "its error is not known")
        for name, size in sizes
        for low, high in [size.interval]
    ]
    return _notes("weak", texts)


def input_gap_notes(clips: Sequence[FitRequest]) -> tuple[DiagnosticNote, ...]:
    """Say where the inputs of clips are not known, which leaves a residual that no effect explains.

    Parameters
    ----------
    clips
        What is fitted to each.
    """
    found = [gaps_of_inputs(clip.trajectory, clip.model, slice(None)) for clip in clips]
    texts = [f"{_clip(k, clips)}{text}" for k, text in enumerate(found) if text]
    return _notes("input-gap", texts)


def negative_damping_note(finals: Sequence[FitResult]) -> tuple[DiagnosticNote, ...]:
    """Say where a damping of the model is below zero: the fit then imitates a missing effect by a gain of energy.

    Parameters
    ----------
    finals
        Fits with what was added, one a clip.
    """
    texts = [
        f"{_clip(k, finals)}{text}" for k, fit in enumerate(finals) for text in energy_gains(fit.model, fit.estimates)
    ]
    return _notes("negative-damping", texts)


def _failure(name: str, fit: FitResult) -> str:
    return f"the refit with {name} failed ({fit.status}): {fit.finding}"


def _clip(k: int, fits: Sequence[object]) -> str:
    return f"clip {k + 1}: " if len(fits) > 1 else ""


def _notes(kind: NoteKind, texts: Sequence[str]) -> tuple[DiagnosticNote, ...]:
    more = len(texts) - MAX_NAMED
    shown = [*texts[:MAX_NAMED], *([f"{more} more clips with the same note"] if more > 0 else [])]
    return tuple(DiagnosticNote(kind, text) for text in shown)


def _noise_above_motion(fit: FitResult) -> list[str]:
    """The first quantity whose motion is smaller than its noise, in words; empty where there is none."""
    motion = np.std(fit.predicted[fit.used], axis=0)
    return [
        f"the noise of {quantity.name} ({noise:.2g} {quantity.unit}) exceeds its motion "
        f"({size:.2g} {quantity.unit}) and hides every effect"
        for quantity, noise, size in zip(fit.model.observed, fit.noise, motion, strict=True)
        if noise > size
    ][:1]


def _nothing_tested(scores: Sequence[Score]) -> list[str]:
    """Why no effect could be tested; empty when one could."""
    if not scores:
        return ["no effect of the library applies to this model"]
    if any(np.isfinite(score.size) for score in scores):
        return []
    names = ", ".join(score.effect for score in scores)
    return [f"the fitted parameters imitate every effect in these data ({names}); hold a known parameter fixed"]
