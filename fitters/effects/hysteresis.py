"""Hysteresis of a spring that yields: a bolted joint, a wire rope, an elastomer, a piezo (Bouc-Wen)."""

from __future__ import annotations

from collections.abc import Sequence

from fitters.effects._hidden import against_the_state, is_driven_on_a_line, reach_parameter, ways_of
from iris_sysid.types import Array, Effect, EffectExample, Parameter, Quantity

SHARES = (0.03, 0.1, 0.3)  # of the motion's reach, tried as the way over which it yields
MAX_SHARE = 1.0  # beyond it nothing yields: a spring
UNLOADING = 0.5  # of the yield that goes with the work done, the rest with the side: it unloads as a spring


def memory(
    t: float, position: float, velocity: float, base: float, params: tuple[float, ...], hidden: tuple[float]
) -> tuple[float]:
    """The rate: z' = v - (g |v| z + (1 - g) v |z|) / d, of the part of the way that is still elastic: up to d."""
    _, way, share, _ = params
    (elastic,) = hidden
    return (velocity - (share * abs(velocity) * elastic + (1.0 - share) * velocity * abs(elastic)) / way,)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Ways that are longer than that in a sample. ``t_s`` (n,), s; ``observed`` (n, d), in its unit."""
    return [(way, UNLOADING, span) for way, span in ways_of(observed, SHARES)]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether it yields in the record. ``t_s`` (n,), s, is not used."""
    return params[1] < MAX_SHARE * params[3]


EFFECT = Effect(
    name="hysteresis",
    summary="a spring that yields, and keeps what it has yielded",
    equation=r"-a\,z,\quad \dot z = \dot x - (g\,|\dot x|\,z + (1 - g)\,\dot x\,|z|) / d",
    source="Bouc (1967); Wen (1976), J. Eng. Mech. Div. 102, 249; Noel and Schoukens (2016), the Bouc-Wen benchmark",
    parameters=(
        Parameter("hysteresis", "1/s^2", "a", lower=0.0, default=0.0),
        Parameter("yield_way", "{x}", "d", lower=1e-12, default=0.05, source="shares of the motion's reach"),
        Parameter(
            "yield_share",
            "1",
            "g",
            default=UNLOADING,
            constant=True,
            role="form",
            source="it unloads as a spring; 1 is presliding",
        ),
        reach_parameter("yield_reach"),
    ),
    hidden=(Quantity("elastic_way", "{x}", "z"),),
    memory=memory,
    component="force-of-position",
    applies=is_driven_on_a_line,
    plausibility=0.2,
    acceleration=against_the_state,
    alike="presliding, where it yields over a short way; a stiffness, where it yields rarely",
    trials=trials,
    sensible=sensible,
    typical="wire ropes and bolted joints lose 10 to 30 % of the stored energy in a cycle, at any frequency",
    example=EffectExample("driven-oscillator", size=20.0),
)
