"""A thrown ball: its position in the plane from the hand, or the first frame with it, to the first bounce."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from iris_sysid.phenomena._motion import in_motion, only_body, stated
from iris_sysid.types import Estimate, Phenomenon, Quantity, Trajectory


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep x to the right and z upwards of a segmented trajectory in m or px; the motion is the flight.

    ``ball_radius`` of the ``settings`` is passed on. Raises DataError when the motion has fewer than three samples.
    """
    body = only_body(world, "projectile")
    in_motion(body, 3)
    unit = body.quantities[0].unit
    return body.with_(
        quantities=(Quantity("x", unit, "x"), Quantity("z", unit, "z")),
        position=body.position[:, :2],
        sigma=body.sigma[:, :2],
        geometry={**body.geometry, **stated(settings, "ball_radius")},
        smoothed=None,
    )


PHENOMENON = Phenomenon(
    name="projectile",
    summary="a ball is thrown; its flight in the plane until the first bounce",
    tracker="auto",
    model="projectile",
    observe=observe,
    motion="flight",
    settings=("ball_radius",),
)
