"""Dry friction that falls off with speed (Stribeck)."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import rubs
from fitters.effects._friction import largest_speed, turnover, turnover_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter

SHARES = (0.05, 0.1, 0.2, 0.4)  # of the largest speed, tried as the speed at which friction falls off


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float, float]
) -> float:
    """-c exp(-|v| / v_s) v / |v|, smooth about v = 0."""
    friction, falloff, turnover = params
    return -friction * np.exp(-speed / abs(falloff)) * velocity / np.sqrt(speed * speed + turnover * turnover)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Speeds at which friction may fall off, and that of the turnover, per second.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    speed, smooth = largest_speed(t_s, observed), turnover(t_s, observed)
    return [(max(share * speed, smooth), smooth) for share in SHARES]


EFFECT = Effect(
    name="velocity-weakening-friction",
    summary="dry friction that falls off as the speed grows",
    equation=r"-c\,e^{-|\dot x|/v_s}\,\dot x / |\dot x|",
    source="Stribeck (1902), Z. VDI 46, 1341; form of Bo and Pavelescu (1982), Wear 82, 277",
    parameters=(
        Parameter("weakening_friction", "{x}/s^2", "c", lower=0.0, default=0.0),
        Parameter(
            "weakening_speed",
            "{x}/s",
            "v_s",
            lower=1e-12,
            default=0.5,
            role="form",
            source="a diagnosis begins at shares of the largest speed",
        ),
        turnover_parameter("weakening_turnover"),
    ),
    component="force-of-velocity",
    applies=rubs,
    plausibility=0.3,
    acceleration=acceleration,
    alike="coulomb-friction, at speeds below v_s",
    trials=trials,
    typical=(
        "static less kinetic friction, 0.05 to 0.2 of the weight: 0.5 to 2 m/s^2, below speeds of 1 mm/s to 0.1 m/s"
    ),
    example=EffectExample("pendulum", size=0.05),
)
