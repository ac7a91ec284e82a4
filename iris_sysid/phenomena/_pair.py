"""Two colliding pendulums: the angle of each about the pivot from its own arc, over the whole motion."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.phenomena._geometry import Circle, angles_about, circle_of
from iris_sysid.types import Estimate, Mask, Quantity, Segment, Trajectory

TAUT = 3  # samples on their arcs in a row after which the cords count as taut
MIN_SAMPLES = 8  # samples of each body
# names in the benchmark's parameters.json; damping and restitution are not in it and keep ours
PAIR_PARAMETERS = {
    **{f"length_{body}": f"rope_length_{body}" for body in (1, 2)},
    **{name: name for name in ("damping_1", "damping_2", "restitution")},
}


def observe_pair(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Turn the positions of two bodies into angles from the downward vertical, positive to the right, left body first.

    The motion begins when both bodies are released and their cords are taut; impacts are part of it. ``world`` holds
    two trajectories of x and z at the same times, in m or px; ``arc_radius`` in that unit, of the ``settings``, fixes
    the radius of both arcs.

    Gives ``theta1`` and ``theta2`` in rad. ``geometry``: ``arc_radius_1``, ``arc_radius_2``, ``pivot_ratio``, the
    distance of the pivots over the first radius, and the error of each pivot over its radius. Samples off an arc by
    more than five scatters are not valid. Raises DataError when there are not two bodies at the same times, or an arc
    is too small for its noise to fix a pivot.
    """
    first, second = _two_bodies(world)
    free = _free(first) & _free(second)
    if free.sum() < MIN_SAMPLES:
        raise DataError(f"both bodies move free of a hand in {int(free.sum())} frames only, {MIN_SAMPLES} are needed")
    circles = _circles((first, second), free, settings)
    angles = [angles_about(circle, body) for body, circle in zip((first, second), circles, strict=True)]
    taut = free.copy()
    for circle in circles:
        taut[free] &= circle.belongs
    return first.with_(
        quantities=(Quantity("theta1", "rad", r"\theta_1"), Quantity("theta2", "rad", r"\theta_2")),
        position=np.column_stack([theta for theta, _ in angles]),
        sigma=np.column_stack([sigma for _, sigma in angles]),
        valid=taut,
        segments=_segments(first, free, taut),
        geometry={**first.geometry, **_geometry(circles, first.quantities[0].unit)},
        smoothed=None,
    )


def _two_bodies(world: Sequence[Trajectory]) -> tuple[Trajectory, Trajectory]:
    if len(world) < 2:
        raise DataError(f"two pendulums need the trajectories of two bodies, but there are {len(world)}; see --bodies")
    first, second = world[0], world[1]
    if not np.array_equal(first.t_s, second.t_s):
        raise DataError("the trajectories of the two bodies are not at the same times")
    middles = [np.median(body.position[body.valid, 0]) for body in (first, second)]
    return (first, second) if middles[0] <= middles[1] else (second, first)


def _free(body: Trajectory) -> Mask:
    """Valid samples after the last sample in a hand before the motion."""
    held = body.mask("hand") if body.segments else np.zeros(body.n, dtype=np.bool_)
    moving = np.flatnonzero(body.mask("motion"))
    before = np.flatnonzero(held[: int(moving[0])] if moving.size else held)
    free = body.valid & ~held
    free[: int(before[-1]) + 1 if before.size else 0] = False
    return np.asarray(free)


def _circles(
    bodies: tuple[Trajectory, Trajectory], free: Mask, settings: Mapping[str, Estimate]
) -> tuple[Circle, Circle]:
    """The arcs of both bodies; an arc that is too small for its noise takes the other's radius."""
    unit = bodies[0].quantities[0].unit
    given = settings.get("arc_radius")
    if given is not None and given.unit not in (unit, ""):
        raise DataError(f"arc_radius is given in {given.unit}, but positions are in {unit}: give the scale as well")
    outcomes: list[Circle | DataError] = []
    for body in bodies:
        try:
            outcomes.append(circle_of(body, free, given))
        except DataError as error:
            outcomes.append(error)
    good = [outcome for outcome in outcomes if isinstance(outcome, Circle)]
    if not good and isinstance(outcomes[0], DataError):
        raise outcomes[0]
    radius = Estimate(good[0].radius, float(good[0].stderr[2]), unit)
    first, second = (
        outcome if isinstance(outcome, Circle) else circle_of(body, free, radius)
        for outcome, body in zip(outcomes, bodies, strict=True)
    )
    return first, second


def _segments(body: Trajectory, free: Mask, taut: Mask) -> tuple[Segment, ...]:
    """Hand and slack cords first, then the motion from the first three consecutive samples with both cords taut."""
    seen = np.flatnonzero(free)
    runs = np.lib.stride_tricks.sliding_window_view(taut[seen], TAUT).all(axis=1)
    if not runs.any():
        raise DataError("the bodies are never on their arcs for three frames in a row; do they hang on cords?")
    start, stop = int(seen[int(np.argmax(runs))]), int(np.flatnonzero(taut)[-1]) + 1
    reason = f"both cords are taut from {body.t_s[start]:.3g} s on, until {body.t_s[stop - 1]:.3g} s; impacts included"
    motion = Segment("motion", start, stop, reason)
    before = []
    if seen[0] > 0:
        before.append(Segment("hand", 0, int(seen[0]), "one of the two is held, or not seen"))
    if seen[0] < start:
        before.append(Segment("release", int(seen[0]), start, "off the arc: a cord is not taut"))
    return (*before, motion)


def _geometry(circles: tuple[Circle, Circle], unit: str) -> dict[str, Estimate]:
    left, right = circles
    source = "circle through the arc of the motion"
    separation, stderr = right.x - left.x, math.hypot(float(left.stderr[0]), float(right.stderr[0]))
    return {
        "arc_radius_1": Estimate(left.radius, float(left.stderr[2]), unit, "fitted", source),
        "arc_radius_2": Estimate(right.radius, float(right.stderr[2]), unit, "fitted", source),
        "pivot_ratio": Estimate(
            separation / left.radius, stderr / left.radius, "1", "fitted", "centres of the right arcs"
        ),
        **_off_pivot("1", left),
        **_off_pivot("2", right),
    }


def _off_pivot(body: str, circle: Circle) -> dict[str, Estimate]:
    """Standard error of the pivot, sideways and upwards, over the arc's radius."""
    share = "pivot's error over the arc's radius"
    return {
        f"pivot_{direction}_{body}": Estimate(0.0, float(circle.stderr[k]) / circle.radius, "1", "assumed", share)
        for k, direction in enumerate(("across", "along"))
    }
