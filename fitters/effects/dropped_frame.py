"""Frames were lost, and the times run on as if they had not been."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import any_model
from fitters.effects._times import moments
from iris_sysid.types import Array, Effect, Parameter


def warp(t_s: Array, params: Array) -> Array:
    """A delay from some time on, over a frame or two, so that the time can be estimated."""
    delay, when, width = params
    return np.asarray(t_s + 0.5 * delay * (1.0 + np.tanh((t_s - when) / abs(width))))


EFFECT = Effect(
    name="dropped-frame",
    summary="frames lost at one moment",
    equation=r"t_\mathrm{true} = t + \delta\,\Theta(t - t_d)",
    source="one lost frame is a delay of one over the frame rate",
    parameters=(
        Parameter("dropped_frame", "s", r"\delta", default=0.0),
        Parameter("drop_time", "s", "t_d", default=0.0),
        Parameter("drop_width", "s", "w_d", lower=1e-9, default=1.0, constant=True, source="frame interval"),
    ),
    applies=any_model,
    warp=warp,
    alike="impact",
    trials=moments,
)
