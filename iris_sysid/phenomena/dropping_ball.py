"""A ball that falls from rest: its height from the release to the first bounce."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from iris_sysid.phenomena._motion import in_motion, only_body, stated
from iris_sysid.types import BenchmarkClass, Estimate, Mask, Phenomenon, Quantity, Segment, Trajectory

MIN_SAMPLES = 8  # samples of a fall from which the last one can be dropped


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep the height z of the ball, upwards, with its standard error, from a segmented trajectory in m or px.

    The motion is the segment from the release to the first contact, without its last sample: there the floor is behind
    the ball, which shifts the measured centre by half a pixel. ``ball_radius`` of the ``settings`` is passed on.
    Raises DataError when the motion has fewer than three samples.
    """
    body = only_body(world, "dropping-ball")
    in_motion(body, 3)
    segments, valid = _clear_of_the_floor(body)
    return body.with_(
        quantities=(Quantity("z", body.quantities[1].unit, "z"),),
        position=body.position[:, 1:2],
        sigma=body.sigma[:, 1:2],
        geometry={**body.geometry, **stated(settings, "ball_radius")},
        segments=segments,
        valid=valid,
        smoothed=None,
    )


def _clear_of_the_floor(body: Trajectory) -> tuple[tuple[Segment, ...], Mask]:
    """The segments and the mask (n,) of valid samples, both without the last sample before contact with the floor."""
    segments, valid = list(body.segments), body.valid.copy()
    followed = {segment.start for segment in segments if segment.label == "contact"}
    for k, segment in enumerate(segments):
        seen = np.flatnonzero(valid[segment.start : segment.stop])
        if segment.label == "motion" and segment.stop in followed and seen.size >= MIN_SAMPLES:
            valid[segment.start + seen[-1]] = False
            segments[k] = replace(
                segment, reason=f"{segment.reason}; without its last sample, which has the floor behind it"
            )
    return tuple(segments), valid


PHENOMENON = Phenomenon(
    name="dropping-ball",
    summary="a ball falls from rest; its height until the first bounce",
    tracker="auto",
    model="free-fall",
    observe=observe,
    motion="flight",
    settings=("ball_radius",),
    classes=(
        BenchmarkClass("Dropping_ball", ("drop_50", "drop_100", "drop_150"), 10, {"gravity": "g"}, dataset="iris"),
        BenchmarkClass("dropped_ball", ("small", "medium", "large"), 5, {"gravity": "g"}, dataset="delfys75"),
    ),
)
