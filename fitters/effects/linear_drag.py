"""Drag in proportion to the speed: a slow or small body, or a lossy bearing."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from fitters.effects._domain import has_speed
from fitters.effects._powers import MIN_BASE, SCALE, at_usual_speed, power
from iris_sysid.types import Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Where the model moves and has no such term of its own."""
    return has_speed(model) and not model.with_role("damping")


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """-b v (|v| / v_1)^(p - 1)."""
    drag, exponent, usual = params
    return -drag * velocity * ((speed + MIN_BASE) / usual) ** (exponent - 1.0)


EFFECT = Effect(
    name="linear-drag",
    summary="drag that grows with the speed",
    equation=r"-b\,\dot x",
    source="Stokes (1851), Trans. Camb. Phil. Soc. 9, 8",
    parameters=(
        Parameter("linear_drag", "1/s", "b", lower=0.0, default=0.0),
        power("linear_drag", 1.0, (0.5, 1.8), "viscous drag"),
        replace(SCALE, name="linear_drag_speed"),
    ),
    component="force-of-velocity",
    applies=applies,
    acceleration=acceleration,
    trials=partial(at_usual_speed, 1.0),
    alike="quadratic drag, when the speed barely varies",
    scaling={"mass": -1.0, "radius": 1.0, "spring": 0.0},
    typical="an amplitude that halves in a minute: 0.023 1/s; in ten seconds: 0.14 1/s",
    example=EffectExample("projectile", size=0.05),
)
