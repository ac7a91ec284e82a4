"""The zero of a reading goes to and fro slowly: a camera, a stand or a support that moves, a sensor that warms."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.effects._domain import on_a_line
from fitters.effects._times import own_rate, own_rate_parameter, start_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter

SLOW = 0.7  # of the motion's own frequency; what is faster can be a part of the motion
MIN_CYCLES = 0.4  # in the clip; less is a drift
STEP_CYCLES = 0.5  # between two frequencies; what a clip resolves
FREQUENCIES = 13
PHASES = (0.0, np.pi / 3, 2 * np.pi / 3)  # the nearest one explains 75 % of the wander, or more


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + size * cos(rate * (time - start) + phase).

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    size, rate, phase, start, _ = params
    return np.asarray(observed + size * np.cos(rate * (t_s - start) + phase)[:, None])


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Slow angular frequencies that the clip can tell apart, each at three phases at the first sample.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    span, start, own = float(t_s[-1] - t_s[0]), float(t_s[0]), own_rate(t_s, observed)
    rates = 2 * np.pi / span * STEP_CYCLES * np.arange(1, FREQUENCIES + 1)
    return [(float(rate), phase, start, own) for rate in rates[rates < SLOW * own] for phase in PHASES]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether it is slower than the motion, and more than a drift. ``t_s`` (n,), s."""
    _, rate, _, _, own = params
    return 2 * np.pi * MIN_CYCLES / float(t_s[-1] - t_s[0]) < abs(rate) < SLOW * own


EFFECT = Effect(
    name="zero-wander",
    summary="a zero of the reading that wanders slowly",
    equation=r"x_\mathrm{seen} = x + u\,\cos(\omega\,(t - t_0) + \varphi)",
    source="one Fourier component of a slow movement of camera, stand or support",
    parameters=(
        Parameter("zero_wander", "{x}", "u", default=0.0),
        Parameter("wander_rate", "1/s", r"\omega", lower=0.0, default=1.0),
        Parameter("wander_phase", "rad", r"\varphi", default=0.0),
        start_parameter("wander_start"),
        own_rate_parameter("wander_own_rate"),
    ),
    component="zero-wander",
    absorbs=True,
    applies=on_a_line,
    cause="measurement",
    plausibility=0.2,
    observe=observe,
    alike="camera-drift and zero-drift, which are even; periodic-forcing, of a low frequency; a slow constant-force",
    trials=trials,
    sensible=sensible,
    recurrence="anew",
    typical="a hand that holds the camera: 5 px where its motion is not taken out",
    example=EffectExample("pendulum", size=0.05),
)
