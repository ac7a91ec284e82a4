"""Drag in proportion to the speed: a slow or small body, or a lossy bearing."""

from __future__ import annotations

from fitters.effects._domain import moves
from iris_sysid.types import Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Where the model moves and has no such term of its own."""
    return moves(model) and not model.with_role("damping")


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """-b v."""
    (drag,) = params
    return -drag * velocity


EFFECT = Effect(
    name="linear-drag",
    summary="drag that grows with the speed",
    equation=r"-b\,\dot x",
    source="Stokes (1851), Trans. Camb. Phil. Soc. 9, 8",
    parameters=(Parameter("linear_drag", "1/s", "b", lower=0.0, default=0.0),),
    applies=applies,
    acceleration=acceleration,
    alike="quadratic drag, when the speed hardly varies",
    example=EffectExample("projectile", size=0.05),
)
