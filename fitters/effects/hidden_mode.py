"""A part that swings along unseen: a load on an elastic shaft or belt, a flexible arm, a frame that gives way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitters.effects._hidden import is_driven_on_a_line
from fitters.effects._times import frame_interval, own_rate, own_rate_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter, Quantity

FREQUENCIES = 12  # tried
FASTEST = 0.15  # cycles a sample, which the grid still follows
LOSSES = (0.2, 0.05)  # of critical damping, tried
MAX_LOSS = 1.0  # beyond it nothing swings


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, ...],
    hidden: tuple[float, float],
) -> float:  # fmt: skip
    """-r z'', where z is the way of the part relative to what is driven, and r its share of all inertia."""
    share, rate, loss, _ = params
    way, slip = hidden
    return share * (base + rate * rate * way + 2.0 * loss * rate * slip) / (1.0 - share)


def memory(
    t: float, position: float, velocity: float, base: float, params: tuple[float, ...], hidden: tuple[float, float]
) -> tuple[float, float]:
    """The way's rates: z'' = -(x''_0 + omega^2 z + 2 zeta omega z') / (1 - r)."""
    share, rate, loss, _ = params
    way, slip = hidden
    return slip, -(base + rate * rate * way + 2.0 * loss * rate * slip) / (1.0 - share)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Frequencies above the motion's own, each with two losses. ``t_s`` (n,), s; ``observed`` (n, d), in its unit."""
    own, fastest = own_rate(t_s, observed), 2 * np.pi * FASTEST / frame_interval(t_s)
    if not own < fastest:
        return []
    rates = np.geomspace(own, fastest, FREQUENCIES + 1)[1:].tolist()
    return [(rate, loss, own) for loss in LOSSES for rate in rates]


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether a part swings, and faster than the motion: a slow one is any slow force. ``t_s`` (n,), s, is not used."""
    _, rate, loss, own = params
    return own < rate and 0.0 < loss < MAX_LOSS


EFFECT = Effect(
    name="hidden-mode",
    summary="a part that swings along unseen on something elastic",
    equation=r"-r\,\ddot z,\quad \ddot z = -\ddot x - \omega^2 z - 2\zeta\omega\,\dot z",
    source="Isermann and Muenchhof (2011), Identification of Dynamic Systems, section 22.2: two masses on a shaft",
    parameters=(
        Parameter("hidden_share", "1", "r", lower=0.0, upper=0.95, default=0.0),
        Parameter("hidden_rate", "rad/s", r"\omega", lower=1e-9, default=20.0, source="several are tried"),
        Parameter("hidden_loss", "1", r"\zeta", lower=0.0, default=0.05, source="several are tried"),
        own_rate_parameter("hidden_own_rate"),
    ),
    hidden=(Quantity("hidden_way", "{x}", "z"), Quantity("hidden_slip", "{x}/s", r"\dot z")),
    memory=memory,
    component="periodic-force",
    applies=is_driven_on_a_line,
    plausibility=0.2,
    acceleration=acceleration,
    alike="input-delay, where it swings far faster than the motion; periodic-forcing, of the frequency of the input",
    trials=trials,
    sensible=sensible,
    typical="machine tools and robots: load over motor 1 to 5, first mode 10 to 80 Hz, losses 1 to 10 % of critical",
    example=EffectExample("driven-cart", size=0.3),
)
