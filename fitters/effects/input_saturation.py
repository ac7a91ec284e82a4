"""A large input is cut: an amplifier at its supply, a valve that is open, a motor at its largest current."""

from __future__ import annotations

import numpy as np

from fitters.effects._drives import is_driven, on_one_input, which_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter

SHARES = (0.95, 0.85, 0.7, 0.5, 0.3)  # of the largest input, tried as the level at which it is cut


def cut(t_s: Array, given: Array, share: float, level: float) -> Array:
    """What is above the level counts less: u - c (u - clip(u)); at c = 1 it is cut.

    ``t_s`` (n,), s; ``given`` (n,) and ``level``, in its unit.
    """
    return np.asarray(given - share * (given - np.clip(given, -abs(level), abs(level))))


def trials(t_s: Array, inputs: Array) -> list[tuple[float, ...]]:
    """Levels of each input. ``t_s`` (n,), s; ``inputs`` (n, m), in their units."""
    largest = np.nanmax(np.abs(inputs), axis=0)
    return [(share * float(size), float(k)) for k, size in enumerate(largest) for share in SHARES]


EFFECT = Effect(
    name="input-saturation",
    summary="an input that counts less above a level",
    equation=r"u \to u - c\,(u - \mathrm{clip}(u, -u_s, u_s))",
    source="Tao and Kokotovic (1996), Adaptive Control of Systems with Actuator and Sensor Nonlinearities, chapter 2",
    parameters=(
        Parameter("input_saturation", "1", "c", lower=0.0, upper=1.5, default=0.0),
        Parameter("saturation_level", "1", "u_s", lower=0.0, default=1.0, role="location"),
        which_parameter("saturated_input"),
    ),
    component="input",
    applies=is_driven,
    plausibility=0.3,
    drive=on_one_input(cut),
    alike="quadratic-drag, where the speed follows the input",
    trials=trials,
    typical="an amplifier at its supply: 10 V or 24 V, cut whole",
    example=EffectExample("driven-oscillator", size=0.5),
)
