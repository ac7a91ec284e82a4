"""A constant force along the motion: wind, a tilt, a wrong constant."""

from __future__ import annotations

from fitters.effects._domain import has_one_speed
from iris_sysid.types import Effect, EffectExample, Parameter


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """A constant."""
    (force,) = params
    return force


EFFECT = Effect(
    name="constant-force",
    summary="a constant force per mass",
    equation=r"+f",
    source="Newton's second law",
    parameters=(Parameter("constant_force", "{x}/s^2", "f", default=0.0),),
    component="force-of-position",
    applies=has_one_speed,
    plausibility=0.5,
    acceleration=acceleration,
    largest=0.5,  # half of gravity or of a spring is not a small push
    scaling={"spring": 0.0},
    alike="zero-offset, for small swings; the acceleration itself, on an incline or in free fall",
    typical="a table out of level by 1°: 0.17 m/s^2; on a pendulum of 0.5 m 0.34 rad/s^2",
    example=EffectExample("pendulum", size=0.05),
)
