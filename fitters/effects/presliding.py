"""Stiction with presliding: a joint gives way elastically before it slips, and dry friction builds up on the way."""

from __future__ import annotations

from collections.abc import Sequence

from fitters.effects._hidden import against_the_state, is_driven_on_a_line, reach_parameter, ways_of
from iris_sysid.types import Array, Effect, EffectExample, Parameter, Quantity

SHARES = (0.01, 0.03, 0.1, 0.3)  # of the motion's reach, tried as the distance
MAX_SHARE = 0.5  # beyond it the joint never slips: a spring


def memory(
    t: float, position: float, velocity: float, base: float, params: tuple[float, ...], hidden: tuple[float]
) -> tuple[float]:
    """The rate: z' = (v - |v| z) / d, of the joint's deflection over that at which it slips, after a way of about d."""
    return ((velocity - abs(velocity) * hidden[0]) / params[1],)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Distances that are longer than the way in a sample. ``t_s`` (n,), s; ``observed`` (n, d), in its unit."""
    return ways_of(observed, SHARES)


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether the joint slips in the record. ``t_s`` (n,), s, is not used."""
    return params[1] < MAX_SHARE * params[2]


EFFECT = Effect(
    name="presliding",
    summary="dry friction that builds up over a short way after each reversal",
    equation=r"-c\,z,\quad d\,\dot z = \dot x - |\dot x|\,z",
    source="Dahl (1968), Aerospace Report TOR-0158; Astrom and Canudas de Wit (2008), IEEE Control Syst. Mag. 28, 101",
    parameters=(
        Parameter("presliding", "{x}/s^2", "c", lower=0.0, default=0.0),
        Parameter("presliding_distance", "{x}", "d", lower=1e-12, default=0.01, source="shares of the motion's reach"),
        reach_parameter("presliding_reach"),
    ),
    hidden=(Quantity("presliding_state", "1", "z"),),
    memory=memory,
    component="force-of-velocity",
    applies=is_driven_on_a_line,
    plausibility=0.3,
    acceleration=against_the_state,
    alike="coulomb-friction, where the motion is long against d; hysteresis",
    trials=trials,
    sensible=sensible,
    typical="ball bearings and guides: 1 to 100 um, rubber seals and belts 0.1 to 1 mm, before they slip",
    example=EffectExample("driven-oscillator", size=0.2),
)
