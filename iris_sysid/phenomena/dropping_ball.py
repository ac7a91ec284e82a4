"""A ball that falls from rest: its height from the release to the first bounce."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from iris_sysid.phenomena._motion import in_motion, only_body, stated
from iris_sysid.types import BenchmarkClass, Estimate, Phenomenon, Quantity, Trajectory


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep the height z of the ball, upwards, with its standard error.

    Parameters
    ----------
    world
        One trajectory of x and z, segmented, in m or px.
    settings
        ``ball_radius`` is passed on.

    Returns
    -------
    Trajectory
        ``z``; the motion is the segment from the release to the first contact.

    Raises
    ------
    DataError
        When the motion has fewer than three samples.
    """
    body = only_body(world, "dropping-ball")
    in_motion(body, 3)
    return body.with_(
        quantities=(Quantity("z", body.quantities[1].unit, "z"),),
        position=body.position[:, 1:2],
        sigma=body.sigma[:, 1:2],
        geometry={**body.geometry, **stated(settings, "ball_radius")},
        smoothed=None,
    )


PHENOMENON = Phenomenon(
    name="dropping-ball",
    summary="a ball falls from rest; its height until the first bounce",
    tracker="median-background",
    model="free-fall",
    observe=observe,
    motion="flight",
    settings=("ball_radius",),
    classes=(
        BenchmarkClass("Dropping_ball", ("drop_50", "drop_100", "drop_150"), 10, {"gravity": "g"}),
        BenchmarkClass("dropped_ball", ("small", "medium", "large"), 5, {"gravity": "g"}),
    ),
)
