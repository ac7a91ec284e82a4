"""A cup or block that slides down a straight board: the distance along it and its angle, both from the motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.phenomena._geometry import Line, fit_line
from iris_sysid.phenomena._motion import in_motion, only_body, stated
from iris_sysid.types import Array, BenchmarkClass, Estimate, Mask, Phenomenon, Quantity, Trajectory

# px: how far hand, blur and shading move the measured position of a body while it speeds up; on synthetic clips it is
# 0.3 to 0.5 px off the board at the top and right at the bottom
DRIFT_PX = 0.35
STRAIGHT = 0.02  # scatter across the line over its length: a lens bends a board by less, an arc of 25 degrees by more


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Turn positions into the distance along the principal direction of the motion, increasing downhill.

    ``world`` holds one segmented trajectory of x and z in m or px. ``angle`` of the board in rad among the
    ``settings``, as the user measured it, becomes ``geometry["angle"]``; the angle of the motion is then
    ``geometry["angle_of_motion"]``.

    Gives ``s``, zero at the first sample of the motion. ``geometry``: ``angle`` from the horizontal, rad, and
    ``across_scatter``, the standard deviation of the positions across the line. Raises DataError when the motion has
    fewer than five samples or does not follow a straight line.
    """
    body = only_body(world, "sliding-cone")
    used = in_motion(body, 5)
    line = fit_line(body.position[used, :2])
    unit = body.quantities[0].unit
    _check_straight(line, body.position[used, :2], unit)
    direction = _downhill(line)
    start = body.position[np.flatnonzero(used)[0], :2]
    return body.with_(
        quantities=(Quantity("s", unit, "s"),),
        position=((body.position[:, :2] - start) @ direction)[:, None],
        sigma=np.hypot(*(body.sigma[:, :2] * direction).T)[:, None],
        geometry={**body.geometry, **_geometry(body, used, line, direction, settings)},
        smoothed=None,
    )


def _downhill(line: Line) -> Array:
    """The line's direction, turned so that it points down; along the motion where the line is level."""
    level = abs(line.direction[1]) < 3 * line.angle_stderr
    return line.direction if level or line.direction[1] < 0 else -line.direction


def _geometry(
    body: Trajectory, used: Mask, line: Line, direction: Array, settings: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    angle, unit = float(np.arctan2(-direction[1], abs(direction[0]))), body.quantities[0].unit
    stderr = math.hypot(line.angle_stderr, _drift(body, used, line))
    measured = Estimate(angle, stderr, "rad", "fitted", "direction of the motion from the horizontal")
    scatter = line.scatter / math.sqrt(2 * int(used.sum()))
    given = stated(settings, "angle")
    return {
        "angle": given.get("angle", measured),
        **({"angle_of_motion": measured} if given else {}),
        "across_scatter": Estimate(line.scatter, scatter, unit, "fitted", "positions across the line"),
        **stated(settings, "ball_radius"),
    }


def _drift(body: Trajectory, used: Mask, line: Line) -> float:
    """Standard error, rad, of the line's angle from a drift of the measured position along the slide."""
    scale = body.geometry.get("scale")
    px = scale.value if scale is not None and body.quantities[0].unit == "m" else 1.0
    return DRIFT_PX / px / float(np.ptp(body.position[used, :2] @ line.direction))


def _check_straight(line: Line, position: Array, unit: str) -> None:
    length = float(np.ptp((position - line.point) @ line.direction))
    if line.scatter > STRAIGHT * length:
        raise DataError(
            f"the motion is not along a straight line: it scatters by {line.scatter:.3g} {unit} across a distance of "
            f"{length:.3g} {unit}; choose the slide with --start and --stop, or another phenomenon"
        )


PHENOMENON = Phenomenon(
    name="sliding-cone",
    summary="a cup or block slides down a board; the distance along it and the board's angle, from the motion",
    tracker="auto",
    model="incline",
    observe=observe,
    motion="slide",
    settings=("ball_radius",),
    classes=(
        BenchmarkClass(
            "Sliding_cone",
            ("cone_45", "cone_60", "cone_80"),
            10,
            {"angle": "angle", "friction": "friction"},
            dataset="iris",
        ),
        BenchmarkClass(
            "sliding_block", ("low", "mid", "high"), 5, {"angle": "angle", "friction": "friction"}, dataset="delfys75"
        ),
    ),
)
