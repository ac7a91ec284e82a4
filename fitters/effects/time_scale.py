"""The clock is wrong: a frame rate that is not what the file says."""

from __future__ import annotations

from fitters.effects._domain import any_model
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def warp(t_s: Array, params: Array) -> Array:
    """(1 + e) times the time since the first sample. ``t_s`` (n,), s; ``params`` (k,)."""
    return t_s[0] + (1.0 + params[0]) * (t_s - t_s[0])


EFFECT = Effect(
    name="time-scale",
    summary="a clock that runs fast or slow",
    equation=r"t_\mathrm{true} = (1 + e)\,t",
    source="a frame rate of 30 instead of 29.97 is e = -0.1 %",
    parameters=(Parameter("time_scale", "1", "e", lower=-0.9, upper=9.0, default=0.0),),
    component="clock",
    absorbs=True,
    applies=any_model,
    plausibility=0.1,
    cause="clock",
    warp=warp,
    alike="length, gravity, damping and all rates, unless one of them is known",
    typical=(
        "29.97 frames a second read as 30: 0.001; a slow motion of 240 read as 30: -0.875; a quartz: 0.0001 or less"
    ),
    example=EffectExample("pendulum", size=0.05),
)
