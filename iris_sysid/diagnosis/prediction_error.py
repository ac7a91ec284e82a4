"""The error of a model with effects over the samples that it was fitted to, and over samples that it never saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fitters.ode import FitRequest
from fitters.ode.simulation import predicted_by
from iris_sysid.diagnosis.measurement_errors import observed_columns
from iris_sysid.diagnosis.refit import (
    ACCURATE,
    ModelWithEffects,
    estimate_values,
    fit_from,
    free_values,
    pooled,
)
from iris_sysid.types import Array, FitResult

SAMPLES_A_VALUE = 2  # samples per free value that a fit needs after others are held out
Indices = NDArray[np.intp]


def held_out(fitted: FitResult, share: float, parts: int = 1) -> Indices | None:
    """Indices (m,) of the last samples of each part of a clip; None where too few samples would be left.

    Parameters
    ----------
    fitted
        A fit of the clip: of its samples those that it used.
    share
        Fraction of each part, at its end, that is held out.
    parts
        Number of parts that the clip is cut into.
    """
    used = np.flatnonzero(fitted.used)
    later = used[(np.arange(len(used)) * parts / len(used)) % 1.0 >= 1.0 - share]
    enough = len(later) > 0 and len(used) - len(later) >= SAMPLES_A_VALUE * len(fitted.free)
    return later if enough else None


def without_samples(clip: FitRequest, left_out: Indices) -> FitRequest:
    """The request for a fit that does not see these samples."""
    kept = clip.trajectory.valid.copy()
    kept[left_out] = False
    return clip.with_(trajectory=clip.trajectory.with_(valid=kept))


def fitted_error(fits: Sequence[FitResult], others: Sequence[FitResult]) -> float:
    """Root mean square of the residuals of some fits, over the samples that other fits to the same clips use too."""
    both = [fitted.residual[fitted.used & other.used].ravel() for fitted, other in zip(fits, others, strict=True)]
    return _rms(np.concatenate(both))


def block_errors(
    clips: Sequence[FitRequest], trained: ModelWithEffects, left_out: Sequence[Indices]
) -> list[tuple[float, float]]:
    """Mean squared errors over samples that a fit did not see, one pair a clip: in units of the noise, and plain.

    Infinite where one of the fits that predict fails.

    Parameters
    ----------
    clips
        The fit requests with all samples.
    trained
        Fits that did not see those left out. With several clips, the sizes of the effects come from the other clips.
    left_out
        Indices (m,) of these samples, one a clip.
    """
    errors = []
    for k, (clip, unit, later) in enumerate(zip(clips, trained.units, left_out, strict=True)):
        error = _error(k, clip, trained, later)
        if error is None:
            errors.append((float("inf"), float("inf")))
            continue
        with np.errstate(over="ignore"):  # a prediction that diverges is infinitely wrong
            weighed = np.mean((error / unit[later[later.size - len(error) :]]) ** 2)
            errors.append((float(weighed), float(np.mean(error**2))))
    return errors


def prediction_error(
    clips: Sequence[FitRequest], trained: ModelWithEffects, left_out: Sequence[Indices]
) -> tuple[float, float]:
    """Error over samples that a fit did not see: root mean square, and in units of each sample's noise.

    NaN where one of the fits that predict fails.

    Parameters
    ----------
    clips, trained, left_out
        As for :func:`block_errors`.
    """
    errors, weighed = [], []
    for k, (clip, unit, later) in enumerate(zip(clips, trained.units, left_out, strict=True)):
        error = _error(k, clip, trained, later)
        if error is None:
            return float("nan"), float("nan")
        errors.append(error.ravel())
        weighed.append((error / unit[later[later.size - len(error) :]]).ravel())
    return _rms(np.concatenate(errors)), _rms(np.concatenate(weighed))


def _error(k: int, clip: FitRequest, trained: ModelWithEffects, later: Indices) -> Array | None:
    """Observed less predicted (m, d) of the k-th clip, at the samples left out that its motion reaches."""
    several = len(trained.fits) > 1 and trained.effects
    trial = _with_sizes_of_others(k, trained, without_samples(clip, later)) if several else trained.fits[k]
    if not trial.usable:
        return None
    seen = later[later >= int(np.searchsorted(clip.trajectory.t_s, trial.t0_s))]
    predicted = predicted_by(trial, clip.trajectory, estimate_values(trial), int(later[-1]) + 1, tolerance=ACCURATE)
    observed = clip.trajectory.position[:, observed_columns(trial, clip.trajectory)]
    return np.asarray(observed[seen] - predicted[seen])


def validation_error(clips: Sequence[FitRequest], model: ModelWithEffects, share: float, parts: int) -> float:
    """:func:`prediction_error` in units of the noise, of a model refitted without the ends of short parts.

    NaN where a clip is too short to leave out any.

    Parameters
    ----------
    clips
        The fit requests.
    model
        The fits to them.
    share
        Fraction of each part that is left out.
    parts
        Number of parts of a clip.
    """
    left_out = [held_out(fitted, share, parts) for fitted in model.fits]
    known = [samples for samples in left_out if samples is not None]
    if len(known) < len(left_out):
        return float("nan")
    fits = []
    for clip, fitted, samples in zip(clips, model.fits, known, strict=True):
        fits.append(fit_from(without_samples(clip, samples), fitted.model, free_values(fitted)))
    return prediction_error(clips, replace(model, fits=tuple(fits)), known)[1]


def _with_sizes_of_others(k: int, trained: ModelWithEffects, clip: FitRequest) -> FitResult:
    """A fit of the k-th clip with the sizes of the effects in the other clips; moments are each clip's own."""
    fitted, given = trained.fits[k], {}
    for effect in trained.effects:
        name, sizes = effect.parameters[0].name, trained.sizes_of(effect.parameters[0].name)
        given[name] = trained.factors(effect)[k] * pooled([*sizes[:k], *sizes[k + 1 :]]).value
    start = {name: value for name, value in free_values(fitted).items() if name not in given}
    return fit_from(clip.with_(fixed={**clip.fixed, **given}), fitted.model, start)


def _rms(values: Array) -> float:
    with np.errstate(over="ignore"):  # a prediction that diverges is infinitely wrong
        return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
