"""A lamp that fades: its light, above a background that is fitted.

The intensity is kept as the tracker ``intensity`` gives it: light, if it undid the camera's curve. In grey levels a
decay would be about 2.2 times too slow.
"""

from __future__ import annotations

from functools import partial

from iris_sysid.phenomena._motion import as_tracked
from iris_sysid.types import BenchmarkClass, Phenomenon

PHENOMENON = Phenomenon(
    name="led",
    summary="a lamp fades after it is switched off; its brightness above what stays",
    tracker="intensity",
    model="exponential-decay",
    observe=partial(as_tracked, "led", "intensity"),
    measures="intensity",
    classes=(BenchmarkClass("led", ("led_2s", "led_5s", "led_10s"), 5, {"decay_rate": "decay"}, dataset="delfys75"),),
)
