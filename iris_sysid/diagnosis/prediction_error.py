"""The error of a model with effects over the samples that it was fitted to, and over samples that were held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitters.ode import FitRequest
from fitters.ode.simulation import predicted_by
from iris_sysid.diagnosis.refit import ModelWithEffects, estimate_values, fit_from, pooled, sizes_of
from iris_sysid.types import Array, Errors, FitResult

SAMPLES_A_VALUE = 2  # samples per free value that a fit needs after others are held out


def errors_of(clips: Sequence[FitRequest], model: ModelWithEffects, holdout: float, parts: int = 1) -> Errors:
    """The error over the fitted samples, and over the held-out samples; NaN where a clip is too short to hold out any.

    Parameters
    ----------
    clips
        The fit requests, one a clip, with their fixed and free values.
    model
        The fits to them; for each clip, the sizes of the effects come from the other clips where there are any.
    holdout
        Fraction of each part of a clip, at its end, that is held out.
    parts
        Number of parts that a clip is cut into; 1 holds out only its end.
    """
    fits, heldout, weighed = model.fits, [], []
    for k, (clip, fitted, unit) in enumerate(zip(clips, fits, model.units, strict=True)):
        others = [other for j, other in enumerate(fits) if j != k]
        shared = (
            [effect.parameters[0].name for effect in model.effects] if others else []
        )  # moments are each clip's own
        given = {name: pooled(sizes_of(others, name)).value for name in shared}
        samples, error = _heldout_error(clip.with_(fixed={**clip.fixed, **given}), fitted, holdout, parts)
        heldout.append(error.ravel())
        weighed.append((error / unit[samples]).ravel())
    inside = np.concatenate([fitted.residual[fitted.used].ravel() for fitted in fits])
    return Errors(_rms(inside), _rms(np.concatenate(heldout)), _rms(np.concatenate(weighed)))


def _rms(values: Array) -> float:
    with np.errstate(over="ignore"):  # a prediction that diverges is infinitely wrong
        return float(np.sqrt(np.mean(values**2)))


def _heldout_error(clip: FitRequest, fitted: FitResult, holdout: float, parts: int) -> tuple[NDArray[np.intp], Array]:
    """Indices (m,) of the last samples of each part, and the residual (m, d) there after a fit to the other samples.

    One sample and NaN where none can be held out.
    """
    unknown = np.zeros(1, dtype=np.intp), np.full((1, fitted.residual.shape[1]), np.nan)
    used = np.flatnonzero(fitted.used)
    later = used[(np.arange(len(used)) * parts / len(used)) % 1.0 >= 1.0 - holdout]
    if len(used) - len(later) < SAMPLES_A_VALUE * len(fitted.free) or len(later) == 0:
        return unknown
    trajectory = clip.trajectory
    kept = trajectory.valid.copy()
    kept[later] = False
    start = {name: fitted.estimates[name].value for name in fitted.free if name not in clip.fixed}
    part = fit_from(clip.with_(trajectory=trajectory.with_(valid=kept)), fitted.model, start)
    if not part.usable:
        return unknown
    later = later[later >= int(np.searchsorted(trajectory.t_s, part.t0_s))]
    columns = [trajectory.column(quantity.name) for quantity in fitted.model.observed]
    predicted = predicted_by(part, trajectory, estimate_values(part), used[-1] + 1)
    return later, np.asarray(trajectory.position[later][:, columns] - predicted[later])
