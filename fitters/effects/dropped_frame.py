"""Frames were lost, and the times run on as if they had not been."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import any_model
from fitters.effects._times import frame_interval, moments
from iris_sysid.types import Array, Effect, EffectExample, Parameter

FARTHEST = 8  # powers of two of frames by which a moment is moved


def warp(t_s: Array, params: Array) -> Array:
    """A delay from some time on, that grows over one frame interval: the sample before has none, that after has all.

    ``t_s`` (n,), s; ``params`` (k,).
    """
    delay, when, width = params
    return np.asarray(t_s + delay * np.clip((t_s - when) / width + 0.5, 0.0, 1.0))


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Middles (s) of frame intervals spread evenly over the clip, and the length (s) of one.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    before = np.unique(np.searchsorted(t_s, [when for when, _ in moments(t_s, observed)])) - 1
    return _shapes(t_s, t_s[before] + frame_interval(t_s) / 2)


def nearby(t_s: Array, shape: tuple[float, ...]) -> list[tuple[float, ...]]:
    """The middles of frame intervals before and after one, near and far. ``t_s`` (n,), s."""
    steps = 2 ** np.arange(FARTHEST)
    return _shapes(t_s, shape[0] + frame_interval(t_s) * np.concatenate([-steps[::-1], steps]))


def _shapes(t_s: Array, when: Array) -> list[tuple[float, ...]]:
    inside = when[(when > t_s[0]) & (when < t_s[-1])]
    return [(float(time_s), frame_interval(t_s)) for time_s in inside]


EFFECT = Effect(
    name="dropped-frame",
    summary="frames lost at one moment",
    equation=r"t_\mathrm{true} = t + \delta\,\Theta(t - t_d)",
    source="one lost frame is a delay of one over the frame rate",
    parameters=(
        Parameter("dropped_frame", "s", r"\delta", default=0.0),
        Parameter(
            "drop_time",
            "s",
            "t_d",
            default=0.0,
            constant=True,
            source="the frame interval that fits best",
            role="location",
        ),
        Parameter("drop_width", "s", "w_d", lower=1e-9, default=1.0, constant=True, source="frame interval"),
    ),
    component="clock",
    absorbs=True,
    applies=any_model,
    cause="clock",
    plausibility=0.1,
    warp=warp,
    alike="impact",
    trials=trials,
    nearby=nearby,
    recurrence="once",
    typical="one frame: 0.033 s at 30 frames a second, 0.0042 s at 240",
    example=EffectExample("pendulum", size=0.05),
)
