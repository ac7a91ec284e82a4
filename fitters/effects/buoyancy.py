"""The fluid around a body carries a part of its weight, and has to be set in motion with it."""

from __future__ import annotations

from collections.abc import Sequence

from fitters.effects._domain import falls, moves
from iris_sysid.types import Array, Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Where gravity alone moves the body, or bodies: falls, throws and pendulums, but not where a cord may be slack."""
    swing = moves(model) and model.states[0].unit == "rad" and bool(model.with_role("gravity"))
    return (swing or falls(model)) and not model.with_role("pivot")


def acceleration(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """Minus a share of the base acceleration."""
    (share,) = params
    return -share * base


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether the fluid carries and does not pull. ``t_s`` (n,), s, is not used."""
    return params[0] > 0


EFFECT = Effect(
    name="buoyancy",
    summary="buoyancy and added mass of the fluid around a body, whose density is b times the body's",
    equation=r"-r\,\ddot x_0,\quad r = 1 - \frac{1 - b}{1 + b / 2} \mathrm{\ for\ a\ sphere}",
    source="Batchelor (1967), An Introduction to Fluid Dynamics, section 6.8: a sphere has half the fluid it displaces",
    parameters=(Parameter("buoyancy", "1", "r", lower=-0.5, upper=2.0, default=0.0),),
    component="force-of-position",
    applies=applies,
    plausibility=0.1,
    acceleration=acceleration,
    largest=0.8,  # beyond, the body barely sinks
    alike="gravity, the length and a wrong scale, unless they are known; finite-bob; time-scale",
    sensible=sensible,
    scaling={"mass": -1.0, "radius": 3.0, "length": 0.0},
    typical=(
        "from the densities: table-tennis ball in air 0.022, tennis ball 0.005, steel ball 0.0002; glass in water 0.5"
    ),
    example=EffectExample("free-fall", size=0.05),
)
