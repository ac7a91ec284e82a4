"""What a reader of a diagnosis must know beside its sentence: why something could not be asked, or answered."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.diagnosis.measurement_errors import FEWEST, STANDS_OUT
from iris_sysid.diagnosis.score_test import Score
from iris_sysid.types import FitResult

MOST_NAMED = 3  # clips, or effects, with the same reservation; more are counted
WRONG_SIGN = "but below zero that would be a gain of energy (or of water), so it is not named"
TOO_FAINT = f"but that moves fewer than {FEWEST} samples by {STANDS_OUT:g} of their stated errors, so it is not named"


def reservations(bases: Sequence[FitResult], screened: Sequence[Score], failed: Sequence[str]) -> tuple[str, ...]:
    """Say where the base fits are doubtful, the noise hides the motion, no effect can be told, or a refit failed.

    Parameters
    ----------
    bases
        Fits of the model as it was given, one a clip.
    screened
        The last round of the screen; empty when no effect applies.
    failed
        A text for each effect that could not be refitted.
    """
    doubtful = [
        f"{_clip(k, bases)}the base fit is {one.status}: {reason(one)}"
        for k, one in enumerate(bases)
        if one.status in ("at-bound", "singular")
    ]
    hidden = [f"{_clip(k, bases)}{text}" for k, one in enumerate(bases) if (text := _hidden_in_noise(one))]
    return (*_few(doubtful), *_few(hidden), *_unseen(screened), *failed)


def would_take(scores: Sequence[Score], but: str) -> list[str]:
    """Say what would explain what is left, and why it is not named; nothing for none.

    Parameters
    ----------
    scores
        Of the effects that would, best first.
    but
        Why, in words.
    """
    if not scores:
        return []
    best, others = scores[0], [one.effect for one in scores[1:]]
    more = f" and {len(others) - MOST_NAMED} more" if len(others) > MOST_NAMED else ""
    like = f" (or the like of {', '.join(others[:MOST_NAMED])}{more})" if others else ""
    return [f"what is left would take {best.effect} of {best.size:.2g} {best.unit}{like}, {but}"]


def gains(finals: Sequence[FitResult]) -> tuple[str, ...]:
    """Say where a damping is below zero: the fit then makes up for what is lacking by a gain of energy.

    Parameters
    ----------
    finals
        Fits with what was added, one a clip.
    """
    texts = [
        f"{_clip(k, finals)}{name} is {value.value:.2g} ± {value.stderr:.1g} {value.unit}, a gain of energy: the loss "
        "has another form than the equation gives it"
        for k, one in enumerate(finals)
        for name, value in one.estimates.items()
        if name.startswith("damping") and value.interval[1] < 0.0
    ]
    return tuple(_few(texts))


def reason(fit: FitResult) -> str:
    """Why a fit is doubtful or failed, without its values and remedies, which its own message has."""
    return fit.message.partition(". ")[0].partition(" (")[0]


def why(fit: FitResult) -> str:
    """The same after a colon; nothing where the status itself says it."""
    words = reason(fit)
    return "" if words == fit.status.replace("-", " ") else f": {words}"


def _clip(k: int, bases: Sequence[FitResult]) -> str:
    return f"clip {k + 1}: " if len(bases) > 1 else ""


def _few(texts: Sequence[str]) -> list[str]:
    more = len(texts) - MOST_NAMED
    return [*texts[:MOST_NAMED], f"{more} more clips with the like"] if more > 0 else list(texts)


def _hidden_in_noise(fit: FitResult) -> str:
    """Why nothing can be said of a motion that is smaller than the noise; empty where it is larger."""
    motion = np.std(fit.predicted[fit.used], axis=0)
    for quantity, noise, size in zip(fit.model.observed, fit.noise, motion, strict=True):
        if noise > size:
            return (
                f"the noise of {quantity.name} ({noise:.2g} {quantity.unit}) is larger than its motion "
                f"({size:.2g} {quantity.unit}), which hides any effect"
            )
    return ""


def _unseen(screened: Sequence[Score]) -> list[str]:
    """Why the screen has nothing to say; empty when it has."""
    if not screened:
        return ["no effect of the library applies to this model"]
    if any(np.isfinite(one.size) for one in screened):
        return []
    names = ", ".join(one.effect for one in screened)
    return [f"no effect can be told from the fitted parameters in these data ({names}): hold one that is known"]
