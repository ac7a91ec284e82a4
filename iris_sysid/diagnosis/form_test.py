"""Score test of the form of an effect, such as the power of a drag, that a fit holds: whether to fit it pays.

With d the derivative of the prediction by the form, d' the part of it that the free values cannot imitate, and r the
residual, (d'r)^2 / (d'd') over the residual's variance is the chi-square that the form would gain to first order (Rao
1948, Proc. Camb. Phil. Soc. 44, 50).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.ode import FitRequest
from fitters.ode.simulation import predicted_by
from iris_sysid.diagnosis.refit import ACCURATE, ModelWithEffects, estimate_values, forms
from iris_sysid.types import Array, Effect, FitResult

STEP = 1e-3  # by which a form is changed for a derivative, relative to it
WORTH_FITTING = 1.0  # chi-square from which the best form lies beyond a standard error from the one that is held


def is_form_open(clips: Sequence[FitRequest], model: ModelWithEffects, effect: Effect) -> bool:
    """Whether the form of an effect of a model may be another than the one that is held, by the residuals of all clips.

    Parameters
    ----------
    clips
        What was fitted.
    model
        The fits.
    effect
        One of its effects, whose form is held.
    """
    each_clip = list(zip(clips, model.fits, model.units, strict=True))
    return any(sum(_chi2(*clip, name) for clip in each_clip) >= WORTH_FITTING for name in forms(effect))


def _chi2(clip: FitRequest, fitted: FitResult, unit: Array, name: str) -> float:
    """The chi-square that a form would gain in one clip, whose residuals have ``unit`` (n, d); or infinity."""
    noise, values = unit[fitted.used], estimate_values(fitted)
    stop, step = int(np.flatnonzero(fitted.used)[-1]) + 1, STEP * values[name]
    ahead, behind = (
        predicted_by(fitted, clip.trajectory, {**values, name: values[name] + change}, stop, tolerance=ACCURATE * STEP)
        for change in (step, -step)
    )
    moved = ((ahead - behind)[fitted.used[:stop]] / noise).ravel()
    jacobian = fitted.informed_jacobian(noise)
    residual = np.concatenate([(fitted.residual[fitted.used] / noise).ravel(), fitted.prior_residual])
    if not (np.all(np.isfinite(moved)) and np.all(np.isfinite(jacobian)) and np.any(moved)):
        return float("inf")
    basis = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))[0]
    along = np.concatenate([moved, np.zeros(fitted.prior_residual.size)])
    own = along - basis @ (basis.T @ along)
    variance = float(residual @ residual) / max(residual.size - len(fitted.free), 1)
    return float((own @ residual) ** 2 / max(float(own @ own) * variance, 1e-300))
