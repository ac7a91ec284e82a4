"""The damped linear oscillator along a line."""

from __future__ import annotations

from dataclasses import replace

from fitters.models._oscillator import linear_oscillator
from iris_sysid.types import ModelExample, Quantity

MODEL = replace(
    linear_oscillator(
        "linear-oscillator",
        "a body on a linear spring, damped in proportion to its speed; small oscillations of anything",
        Quantity("z", "m", "z"),
        Quantity("vz", "m/s", "v_z"),
    ),
    typical="0.2 kg on a spring of 10 N/m: 50 1/s^2, a period of 0.89 s",
    example=ModelExample({"stiffness": 20.0, "damping": 0.3, "z_0": 0.2, "vz_0": -0.5}, samples=600, rate_hz=60.0),
)
