"""A cup on an arm that turns against a torque: the arm's angle, over full turns, about its direction of rest.

The angle phi, anticlockwise from the right, is kept as it was tracked; the fit estimates the direction of rest.
"""

from __future__ import annotations

from functools import partial

from iris_sysid.phenomena._motion import as_tracked
from iris_sysid.types import BenchmarkClass, Phenomenon

PHENOMENON = Phenomenon(
    name="rotating-cone",
    summary="a cup on an arm that turns to and fro about its direction of rest; the angle of the arm",
    tracker="orientation",
    model="angular-oscillator",
    observe=partial(as_tracked, "rotating-cone", "phi"),
    motion="oscillation",
    free=("rest",),
    measures="angle",
    classes=(
        BenchmarkClass(
            "Rotation",
            ("slow", "mid", "fast"),
            10,
            {"stiffness": "angular_stiffness", "damping": "angular_damping"},
            dataset="iris",
        ),
    ),
)
