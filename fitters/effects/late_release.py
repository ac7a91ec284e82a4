"""The hand lets go late: until some time it holds back a part of the force."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import moves
from fitters.effects._times import sudden
from iris_sysid.types import Array, Effect, EffectExample, Parameter

SHARES = (0.03, 0.06, 0.1, 0.15, 0.2)  # of the clip, tried as the time at which the hand lets go


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """Minus a share of the base acceleration, until the hand lets go."""
    share, when, width = params
    return -0.5 * share * base * (1.0 - np.tanh((t - when) / width))


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Times of the release, and how sharp it is. ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit."""
    span = float(t_s[-1] - t_s[0])
    return [(float(t_s[0]) + share * span, sudden(t_s)) for share in SHARES]


EFFECT = Effect(
    name="late-release",
    summary="a hand that holds back in the first moments",
    equation=r"-s\,\ddot x_0\quad (t < t_r)",
    source="a force in proportion to what it holds back; the velocity at the start is a parameter of every model",
    parameters=(
        Parameter("late_release", "1", "s", default=0.0),
        Parameter("release_time", "s", "t_r", default=0.0, role="moment"),
        Parameter("release_width", "s", "w_r", lower=1e-9, default=1.0, constant=True, source="frame interval"),
    ),
    component="own-force-drift",
    absorbs=True,
    applies=moves,
    plausibility=0.3,
    acceleration=acceleration,
    alike="the initial velocity, in part",
    trials=trials,
    recurrence="anew",
    typical="fingers that still hold the whole weight: 1, for 0.01 to 0.1 s",
    example=EffectExample("pendulum", size=0.05),
)
