"""How the inputs of a record vary between samples, told by the data: held at the last value, or on a line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np

from fitters.ode import FitOptions, FitRequest, solve
from iris_sysid.types import Estimate, FitResult, Hold, OdeModel, Trajectory

QUICK = FitOptions(discrepancy=False)


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
