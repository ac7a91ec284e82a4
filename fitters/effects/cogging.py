"""A force that is periodic in the position: the poles of a motor, the teeth of a gear, a wheel out of balance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.effects._domain import moves_on_a_line
from iris_sysid.types import Array, Effect, EffectExample, OdeModel, Parameter

MAX_WAVES = 40.0  # in the range of the motion
STEP_WAVES = 0.5  # between two numbers of waves; what the range resolves
MIN_WAVES = 1.5  # fewer are any smooth force of the position
SAMPLES_A_WAVE = 6  # at least
PHASES = (0.0, 0.25 * np.pi, 0.5 * np.pi, 0.75 * np.pi)  # the nearest one explains 85 % of the force, or more


def applies(model: OdeModel) -> bool:
    """Whether something moves along one coordinate that a known input drives: a motor has poles, a bob has none."""
    return moves_on_a_line(model) and bool(model.inputs)


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """A sine of the position."""
    size, waves, phase = params
    return size * np.sin(waves * position + phase)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Wave numbers that the range of the motion can tell apart, each at four phases at the position zero.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    known = observed[np.isfinite(observed).all(axis=1), 0]
    span, way = float(np.ptp(known)), float(np.sum(np.abs(np.diff(known))))
    if not span > 0:
        return []
    most = min(MAX_WAVES, known.size / SAMPLES_A_WAVE * span / way)
    return [
        (float(2 * np.pi * count / span), phase)
        for count in np.arange(MIN_WAVES, max(most, MIN_WAVES + STEP_WAVES), STEP_WAVES)
        for phase in PHASES
    ]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether there are waves at all. ``t_s`` (n,), s."""
    return abs(params[1]) > 0.0


EFFECT = Effect(
    name="cogging",
    summary="a force that is periodic in the position",
    equation=r"+f\,\sin(k x + \varphi)",
    source="Jahns and Soong (1996), IEEE Trans. Industrial Electronics 43, 321",
    parameters=(
        Parameter("cogging", "{x}/s^2", "f", default=0.0),
        Parameter("cogging_waves", "1/{x}", "k", lower=0.0, default=1.0),
        Parameter("cogging_phase", "rad", r"\varphi", default=0.0),
    ),
    component="force-of-position",
    absorbs=True,
    applies=applies,
    plausibility=0.2,
    acceleration=acceleration,
    alike="clearance and cubic-stiffness, where there are few waves; gravity, in an angle",
    trials=trials,
    sensible=sensible,
    typical="a motor with magnets: 1 to 5 % of its torque, as often as poles and slots coincide",
    example=EffectExample("driven-cart", size=0.3),
)
