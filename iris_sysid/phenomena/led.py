"""A lamp that fades: its light, above a background that is fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from iris_sysid.phenomena._motion import in_motion, only_measured
from iris_sysid.types import BenchmarkClass, Estimate, Phenomenon, Trajectory


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep the intensity as the tracker gives it: light, if the tracker undid the camera's curve.

    In grey levels a decay would be about 2.2 times too slow: see the tracker ``intensity``.

    Parameters
    ----------
    world
        One trajectory of intensity, segmented.
    settings
        Not used; ``background`` is a constant of the model.

    Returns
    -------
    Trajectory
        ``intensity``; the motion is the fading.

    Raises
    ------
    DataError
        When the fading has fewer than five samples.
    """
    body = only_measured(world, "led", "intensity")
    in_motion(body, 5)
    return body


PHENOMENON = Phenomenon(
    name="led",
    summary="a lamp fades after it is switched off; its brightness above what stays",
    tracker="intensity",
    model="exponential-decay",
    observe=observe,
    free=("background",),
    measures="intensity",
    classes=(BenchmarkClass("led", ("led_2s", "led_5s", "led_10s"), 5, {"decay_rate": "decay"}, dataset="delfys75"),),
)
