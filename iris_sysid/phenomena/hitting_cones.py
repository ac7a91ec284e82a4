"""A ball that rolls towards a pyramid of cups: the distance it rolls until it strikes the first cup.

The run-up gives the damping of the published equation, z'' + damping z' + coupling sum (z - z_j) = 0, because the ball
touches nothing yet. The coupling is not measured: after the run-up come impacts, which it does not describe, among
sixteen bodies that occlude one another. The run-up ends when a cup moves.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.phenomena._geometry import fit_line
from iris_sysid.phenomena._motion import only_body, stated
from iris_sysid.types import (
    N_REST_SAMPLES,
    Array,
    BenchmarkClass,
    Estimate,
    Phenomenon,
    Quantity,
    Segment,
    Trajectory,
    departure,
)

MIN_SAMPLES = 6  # samples of the run-up


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Turn positions of the ball into the distance along its run-up, which ends when the first cup moves.

    The ball is the body that moves first of the trajectories of x and z in ``world``, in any order, in m or px; their
    segments are not used. ``s`` is zero at the first sample of the motion and increases as the ball goes.
    ``ball_radius`` of the ``settings`` is passed on. Raises DataError when the ball rolls for fewer than six samples
    before a cup moves.
    """
    only_body(world, "hitting-cones")
    departures = sorted((_departs(body), k) for k, body in enumerate(world))
    start, ball = departures[0]
    body = world[ball]
    struck = departures[1][0] if len(departures) > 1 else body.n
    stop = struck - 1 if struck < body.n else body.n  # the exposure before may include the impact
    used = start + np.flatnonzero(body.valid[start : max(stop, start)])
    if used.size < MIN_SAMPLES:
        raise DataError(
            f"the ball rolls by itself for {used.size} samples, {MIN_SAMPLES} are needed; is it seen before it strikes?"
        )
    distance, sigma = _along(body, used)
    return body.with_(
        quantities=(Quantity("s", body.quantities[0].unit, "s"),),
        position=distance[:, None],
        sigma=sigma[:, None],
        segments=_segments(body, start, stop),
        geometry={**body.geometry, **stated(settings, "ball_radius")},
        smoothed=None,
    )


def _departs(body: Trajectory) -> int:
    """Index of the sample from which a body stays away from its first position; ``body.n`` for a body at rest."""
    index = np.flatnonzero(body.valid)
    first = index[:N_REST_SAMPLES]
    if index.size <= N_REST_SAMPLES:
        return body.n
    scatter = np.std(body.position[first, :2], axis=0)
    measured = np.median(np.nan_to_num(body.sigma[first, :2]), axis=0)
    first_away = departure(body.position[index, :2], float(np.hypot(*np.maximum(scatter, measured))))
    return int(index[first_away]) if first_away < index.size else body.n


def _along(body: Trajectory, used: NDArray[np.intp]) -> tuple[Array, Array]:
    """Distance (n,) along the line of the run-up, and its standard error."""
    line = fit_line(body.position[used, :2]).direction
    first, last = body.position[used[0], :2], body.position[used[-1], :2]
    direction = line if (last - first) @ line >= 0 else -line
    return (body.position[:, :2] - first) @ direction, np.hypot(*(body.sigma[:, :2] * direction).T)


def _segments(body: Trajectory, start: int, stop: int) -> tuple[Segment, ...]:
    motion = Segment("motion", start, stop, f"it rolls from {body.t_s[start]:.3g} s until the first cup moves")
    before = [Segment("rest", 0, start, "it has not left its place")] if start else []
    after = [Segment("contact", stop, body.n, "among the cups")] if stop < body.n else []
    return (*before, motion, *after)


PHENOMENON = Phenomenon(
    name="hitting-cones",
    summary="a ball rolls at a pyramid of cups; its distance until it strikes the first",
    tracker="auto",
    model="coasting-ball",
    observe=observe,
    bodies=16,
    settings=("ball_radius",),
    classes=(BenchmarkClass("Hitting_cones", ("slow", "mid", "fast"), 10, {"damping": "damping"}, dataset="iris"),),
)
