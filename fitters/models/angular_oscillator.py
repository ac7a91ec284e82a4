"""The damped linear oscillator of an angle."""

from __future__ import annotations

from fitters.models._oscillator import linear_oscillator
from iris_sysid.types import Quantity

MODEL = linear_oscillator(
    "angular-oscillator",
    "an arm that turns against a linear torque, damped in proportion to its speed: the rotating cone",
    Quantity("phi", "rad", r"\varphi"),
    Quantity("omega", "rad/s", r"\omega"),
)
