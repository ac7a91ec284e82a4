"""Drag in proportion to the square of the speed: a bluff body in air."""

from __future__ import annotations

from fitters.effects._domain import moves
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """-c |v| v."""
    (drag,) = params
    return -drag * speed * velocity


EFFECT = Effect(
    name="quadratic-drag",
    summary="drag that grows with the square of the speed",
    equation=r"-c\,|\dot x|\,\dot x",
    source="Batchelor (1967), An Introduction to Fluid Dynamics, section 5.11: form drag at Re of 10^3 to 10^5",
    parameters=(Parameter("quadratic_drag", "1/{x}", "c", lower=0.0, default=0.0),),
    applies=moves,
    acceleration=acceleration,
    alike="linear drag, when the speed hardly varies",
    example=EffectExample("pendulum", size=0.05),
)
