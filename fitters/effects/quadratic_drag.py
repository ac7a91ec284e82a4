"""Drag in proportion to the square of the speed: a bluff body in air."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from fitters.effects._domain import has_speed
from fitters.effects._powers import MIN_BASE, SCALE, at_usual_speed, power
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """-c |v| v (|v| / v_1)^(p - 2)."""
    drag, exponent, usual = params
    return -drag * speed * velocity * ((speed + MIN_BASE) / usual) ** (exponent - 2.0)


EFFECT = Effect(
    name="quadratic-drag",
    summary="drag that grows with the square of the speed",
    equation=r"-c\,|\dot x|\,\dot x",
    source="Batchelor (1967), An Introduction to Fluid Dynamics, section 5.11: form drag at Re of 10^3 to 10^5",
    parameters=(
        Parameter("quadratic_drag", "1/{x}", "c", lower=0.0, default=0.0),
        power("quadratic_drag", 2.0, (1.2, 4.0), "form drag"),
        replace(SCALE, name="quadratic_drag_speed"),
    ),
    component="force-of-velocity",
    applies=has_speed,
    acceleration=acceleration,
    trials=partial(at_usual_speed, 2.0),
    alike="linear drag, when the speed barely varies",
    scaling={"mass": -1.0, "radius": 2.0, "length": 1.0, "spring": 0.0},
    typical=(
        "from ρ C_d A / 2m: table-tennis ball 0.13 1/m, tennis ball 0.02 1/m, steel ball of 20 mm 0.003 1/m; on a "
        "pendulum times its length"
    ),
    example=EffectExample("pendulum", size=0.05),
)
