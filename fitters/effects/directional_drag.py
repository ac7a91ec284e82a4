"""Viscous friction that differs between the two directions: a screw under load, a worn guide, an uneven amplifier."""

from __future__ import annotations

from fitters.effects._domain import has_one_speed, rubs
from fitters.effects._drives import is_driven
from iris_sysid.types import Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Whether something that may rub is driven along a line or about an axis."""
    return has_one_speed(model) and rubs(model) and is_driven(model)


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """-b |v|: more drag one way, less the other."""
    (difference,) = params
    return -difference * speed


EFFECT = Effect(
    name="directional-drag",
    summary="viscous friction that differs between the two directions",
    equation=r"-b\,|\dot x|",
    source="Armstrong-Helouvry, Dupont and Canudas de Wit (1994), Automatica 30, 1083, section 2.1",
    parameters=(Parameter("directional_drag", "1/s", "b", default=0.0),),
    component="force-of-velocity",
    applies=applies,
    plausibility=0.3,
    acceleration=acceleration,
    alike="constant-force, where all speeds are alike; quadratic drag, of a motion that keeps its direction",
    typical="a linear drive: 10 to 20 % of its viscous friction, 0.4 1/s; no more than all of that",
    example=EffectExample("driven-oscillator", size=0.2),
)
