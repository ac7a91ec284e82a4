"""A vessel that drains through a hole: the height of its surface; its curve over time gives the height of the hole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.phenomena._motion import in_motion, only_measured
from iris_sysid.phenomena._still import without_still_start
from iris_sysid.types import BenchmarkClass, Estimate, Phenomenon, Quantity, Trajectory


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Measure the level from the lowest level seen, in a segmented trajectory of z in m or px.

    The height of the hole above it is the model's ``hole``: nothing drains below the hole, and z(t) is a parabola with
    its lowest point there. No setting is used. Gives ``h``; ``geometry["lowest"]`` is its zero on the z axis. Raises
    DataError when the motion has fewer than five samples.
    """
    body = without_still_start(only_measured(world, "torricelli", "z"))
    used = in_motion(body, 5)
    unit = body.quantities[0].unit
    index = int(np.flatnonzero(used)[np.argmin(body.position[used, 0])])
    lowest = float(body.position[index, 0])
    zero = Estimate(lowest, float(body.sigma[index, 0]), unit, "direct", "lowest level seen, where h is 0")
    return body.with_(
        quantities=(Quantity("h", unit, "h"),),
        position=body.position - lowest,
        geometry={**body.geometry, "lowest": zero},
        smoothed=None,
    )


PHENOMENON = Phenomenon(
    name="torricelli",
    summary="a vessel drains through a hole; the height of its surface",
    tracker="level",
    model="torricelli",
    observe=observe,
    free=("hole",),
    measures="height",
    classes=(BenchmarkClass("torricelli", ("small", "medium", "large"), 5, {"outflow": "k"}, dataset="delfys75"),),
)
