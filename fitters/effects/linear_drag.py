"""Drag in proportion to the speed: a slow or small body, or a lossy bearing."""

from __future__ import annotations

from fitters.effects._domain import moves
from fitters.effects._speeds import SLOWEST, first_power
from iris_sysid.types import Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Where the model moves and has no such term of its own."""
    return moves(model) and not model.with_role("damping")


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """-b v (|v| / v_1)^(p - 1)."""
    drag, power, usual = params
    return -drag * velocity * ((speed + SLOWEST) / usual) ** (power - 1.0)


EFFECT = Effect(
    name="linear-drag",
    summary="drag that grows with the speed",
    equation=r"-b\,\dot x",
    source="Stokes (1851), Trans. Camb. Phil. Soc. 9, 8",
    parameters=(
        Parameter("linear_drag", "1/s", "b", lower=0.0, default=0.0),
        Parameter(
            "linear_drag_power",
            "1",
            "p",
            lower=0.5,
            upper=1.8,
            default=1.0,
            constant=True,
            source="viscous drag",
            role="form",
        ),
        Parameter(
            "linear_drag_speed",
            "{x}/s",
            "v_1",
            lower=1e-300,
            default=1.0,
            constant=True,
            source="the usual speed; another power gives the same force there",
            role="shape",
        ),
    ),
    applies=applies,
    acceleration=acceleration,
    trials=first_power,
    alike="quadratic drag, when the speed hardly varies",
    example=EffectExample("projectile", size=0.05),
)
