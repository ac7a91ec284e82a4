"""The damped linear oscillator of an angle."""

from __future__ import annotations

from dataclasses import replace

from fitters.models._oscillator import linear_oscillator
from iris_sysid.types import ModelExample, Quantity

MODEL = replace(
    linear_oscillator(
        "angular-oscillator",
        "an arm that turns against a linear torque, damped in proportion to its speed: the rotating cone",
        Quantity("phi", "rad", r"\varphi"),
        Quantity("omega", "rad/s", r"\omega"),
    ),
    typical="stiffness: 12 1/s^2 at a period of 1.8 s, 0.4 1/s^2 at 10 s",
    example=ModelExample({"stiffness": 0.1, "damping": 0.05, "phi_0": 6.3, "omega_0": 0.0}, samples=900, rate_hz=60.0),
)
