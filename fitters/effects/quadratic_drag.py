"""Drag in proportion to the square of the speed: a bluff body in air."""

from __future__ import annotations

from fitters.effects._domain import moves
from fitters.effects._speeds import SLOWEST, second_power
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """-c |v| v (|v| / v_1)^(p - 2)."""
    drag, power, usual = params
    return -drag * speed * velocity * ((speed + SLOWEST) / usual) ** (power - 2.0)


EFFECT = Effect(
    name="quadratic-drag",
    summary="drag that grows with the square of the speed",
    equation=r"-c\,|\dot x|\,\dot x",
    source="Batchelor (1967), An Introduction to Fluid Dynamics, section 5.11: form drag at Re of 10^3 to 10^5",
    parameters=(
        Parameter("quadratic_drag", "1/{x}", "c", lower=0.0, default=0.0),
        Parameter(
            "quadratic_drag_power",
            "1",
            "p",
            lower=1.2,
            upper=4.0,
            default=2.0,
            constant=True,
            source="form drag",
            role="form",
        ),
        Parameter(
            "quadratic_drag_speed",
            "{x}/s",
            "v_1",
            lower=1e-300,
            default=1.0,
            constant=True,
            source="the usual speed; another power gives the same force there",
            role="shape",
        ),
    ),
    applies=moves,
    acceleration=acceleration,
    trials=second_power,
    alike="linear drag, when the speed hardly varies",
    example=EffectExample("pendulum", size=0.05),
)
