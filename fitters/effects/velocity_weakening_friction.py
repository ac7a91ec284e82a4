"""Dry friction that falls off with speed (Stribeck)."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import moves
from iris_sysid.types import Effect, EffectExample, Parameter

TURNOVER = 3e-2  # unit/s, as for coulomb-friction


def acceleration(
    t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float, float]
) -> float:
    """-c exp(-|v| / v_s) v / |v|, smooth about v = 0."""
    friction, falloff = params
    return -friction * np.exp(-speed / abs(falloff)) * velocity / np.sqrt(speed * speed + TURNOVER * TURNOVER)


EFFECT = Effect(
    name="velocity-weakening-friction",
    summary="dry friction that falls off as the speed grows",
    equation=r"-c\,e^{-|\dot x|/v_s}\,\dot x / |\dot x|",
    source="Stribeck (1902), Z. VDI 46, 1341; form of Bo and Pavelescu (1982), Wear 82, 277",
    parameters=(
        Parameter("weakening_friction", "{x}/s^2", "c", lower=0.0, default=0.0),
        Parameter(
            "weakening_speed", "{x}/s", "v_s", lower=1e-3, upper=1e3, default=0.5, constant=True, source="assumed"
        ),
    ),
    applies=moves,
    plausibility=0.3,
    acceleration=acceleration,
    alike="coulomb-friction, at speeds below v_s",
    example=EffectExample("pendulum", size=0.05),
)
