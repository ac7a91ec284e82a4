"""Something shakes: a table, a motor, a passing train."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.effects._domain import moves_on_a_line
from fitters.effects._times import start_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter

MIN_CYCLES = 0.8  # in the clip
MAX_CYCLES = 100.0  # in the clip
SAMPLES_A_CYCLE = 4  # at least
STEP_CYCLES = 0.5  # between two frequencies; what a clip resolves
PHASES = (0.0, 0.25 * np.pi, 0.5 * np.pi, 0.75 * np.pi)  # the nearest one explains 85 % of the force, or more


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float, float]
) -> float:
    """A sine of the time since the start."""
    size, rate, phase, start = params
    return size * np.sin(rate * (t - start) + phase)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Angular frequencies that the clip can tell apart, each at four phases at the first sample.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    span = float(t_s[-1] - t_s[0])
    cycles = np.arange(1.0, max(min(MAX_CYCLES, t_s.size / SAMPLES_A_CYCLE), 1.5), STEP_CYCLES)
    start = float(t_s[0])
    return [(float(2 * np.pi * count / span), phase, start) for count in cycles for phase in PHASES]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether the force returns within the clip: a part of a cycle is any slow force. ``t_s`` (n,), s."""
    return abs(params[1]) * float(t_s[-1] - t_s[0]) > 2 * np.pi * MIN_CYCLES


EFFECT = Effect(
    name="periodic-forcing",
    summary="a periodic force from outside",
    equation=r"+f\,\sin(\omega\,(t - t_0) + \varphi)",
    source="Rayleigh (1894), The Theory of Sound, section 46",
    parameters=(
        Parameter("periodic_forcing", "{x}/s^2", "f", default=0.0),
        Parameter("forcing_rate", "1/s", r"\omega", lower=0.0, default=1.0),
        Parameter("forcing_phase", "rad", r"\varphi", default=0.0),
        start_parameter("forcing_start"),
    ),
    component="periodic-force",
    absorbs=True,
    applies=moves_on_a_line,
    plausibility=0.3,
    acceleration=acceleration,
    alike="the motion itself, near its own frequency",
    trials=trials,
    sensible=sensible,
    recurrence="anew",
    typical="a support that moves by 1 mm at 2 Hz: 0.16 m/s^2",
    example=EffectExample("pendulum", size=0.05),
)
