"""The damped linear oscillator along a line."""

from __future__ import annotations

from fitters.models._oscillator import linear_oscillator
from iris_sysid.types import Quantity

MODEL = linear_oscillator(
    "linear-oscillator",
    "a body on a linear spring, damped in proportion to its speed; small oscillations of anything",
    Quantity("z", "m", "z"),
    Quantity("vz", "m/s", "v_z"),
)
