"""How the inputs of a record vary between samples, told by the data: held at the last value, or on a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np

from fitters.ode import FitOptions, FitRequest, solve
from iris_sysid.types import Array, Estimate, FitResult, Hold, OdeModel, Trajectory

QUICK = FitOptions(discrepancy=False)
MIN_JUMPS = 3  # of an input
ALONE = 0.9  # of its changes, which no other change follows at the next sample: then nothing ramps from one to another


def jumps(clips: Sequence[Trajectory]) -> bool:
    """Whether the inputs of all clips keep their values between jumps that lie apart, as those that are held do.

    A model that lacks an effect cannot tell the hold then: half a sample's delay may make up for a part of the effect.
    """
    columns = [column for clip in clips if clip.inputs is not None for column in clip.inputs[clip.valid].T]
    return bool(columns) and all(_jumps(column[np.isfinite(column)]) for column in columns)


def _jumps(values: Array) -> bool:
    changes = np.diff(values) != 0
    followed = np.count_nonzero(changes[:-1] & changes[1:])
    return int(changes.sum()) >= MIN_JUMPS and followed <= (1.0 - ALONE) * changes.sum()


def holds_compared(
    clips: Sequence[Trajectory],
    model: OdeModel,
    *,
    fixed: Mapping[str, float | Estimate] | None = None,
    free: Sequence[str] = (),
    start: Mapping[str, float] | None = None,
) -> dict[Hold, float]:
    """Residual of a fit with each hold of the inputs, the smallest first: that is how they vary.

    Parameters
    ----------
    clips
        Records with inputs; the same hold is tried on all.
    model
        The equation that is fitted to each.
    fixed, free, start
        As for :func:`fitters.ode.fit`.

    Returns
    -------
    dict
        Root mean square of the residuals in units of the noise, by hold; empty where no fit is usable, or no model
        is driven. Where both are the same, ``linear`` comes first.
    """
    if not model.inputs:
        return {}
    found: dict[Hold, list[FitResult]] = {}
    for clip in clips:
        known = dict(start or {})
        for hold in get_args(Hold):
            stated = FitRequest.stated(clip.with_(hold=hold), model, dict(fixed or {}), free)
            request = stated.with_(start=known, options=QUICK)
            fitted = solve(request if hold == "linear" else request.from_near(known))
            if fitted.usable:
                known = {name: fitted.estimates[name].value for name in fitted.free}
                found.setdefault(hold, []).append(fitted)
    whole = {hold: residual_over_noise(fits) for hold, fits in found.items() if len(fits) == len(clips)}
    return dict(sorted(whole.items(), key=lambda item: item[1]))


def residual_over_noise(fits: Sequence[FitResult]) -> float:
    """Root mean square of the residuals of fits to several clips, in units of the noise; 1 is the noise alone."""
    ratios = [fitted.rms / np.where(fitted.noise > 0, fitted.noise, 1.0) for fitted in fits]
    return float(np.sqrt(np.mean([np.mean(ratio**2) for ratio in ratios])))
