"""A ball that rolls towards a pyramid of cups: its way until it strikes the first.

The run-up gives the damping of the published equation, z'' + damping z' + coupling sum (z - z_j) = 0, where nothing is
coupled yet. The coupling itself is not measured: what follows are impacts, which it does not describe, among sixteen
bodies that hide one another.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.phenomena._geometry import fit_line
from iris_sysid.phenomena._motion import in_motion, only_body, stated
from iris_sysid.types import BenchmarkClass, Estimate, Phenomenon, Quantity, Trajectory


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Turn positions into the way along the principal direction of the run-up, increasing as the ball goes.

    Parameters
    ----------
    world
        One trajectory of x and z, segmented, in m or px.
    settings
        ``ball_radius`` is passed on.

    Returns
    -------
    Trajectory
        ``s``, zero at the first sample of the motion, which the first impact ends.

    Raises
    ------
    DataError
        When the motion has fewer than five samples.
    """
    body = only_body(world, "hitting-cones")
    used = np.flatnonzero(in_motion(body, 5))
    along = fit_line(body.position[used, :2]).direction
    start, end = body.position[used[0], :2], body.position[used[-1], :2]
    direction = along if (end - start) @ along >= 0 else -along
    return body.with_(
        quantities=(Quantity("s", body.quantities[0].unit, "s"),),
        position=((body.position[:, :2] - start) @ direction)[:, None],
        sigma=np.hypot(*(body.sigma[:, :2] * direction).T)[:, None],
        geometry={**body.geometry, **stated(settings, "ball_radius")},
        smoothed=None,
    )


PHENOMENON = Phenomenon(
    name="hitting-cones",
    summary="a ball rolls at a pyramid of cups; its way until it strikes the first",
    tracker="median-background",
    model="coasting-ball",
    observe=observe,
    motion="slide",
    settings=("ball_radius",),
    classes=(BenchmarkClass("Hitting_cones", ("slow", "mid", "fast"), 10, {"damping": "damping"}),),
)
