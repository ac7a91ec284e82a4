"""All checks of a run that need no statistics."""

from __future__ import annotations

from collections.abc import Sequence

from iris_sysid.trajectory.consistency.gravity_scale import gravity_doubts
from iris_sysid.trajectory.consistency.path_shape import phenomenon_doubt
from iris_sysid.types import Calibration, Doubt, FitResult, Phenomenon, Track, Trajectory


def doubts_of_run(
    tracks: Sequence[Track],
    world: Sequence[Trajectory],
    calibration: Calibration,
    phenomenon: Phenomenon,
    fit: FitResult,
    trajectory: Trajectory,
) -> tuple[Doubt, ...]:
    """What common sense says against a result: another phenomenon, or a clock or a scale that gravity contradicts.

    Parameters
    ----------
    tracks
        One per body, in px.
    world
        Its positions, x and z, in m or px, segmented.
    calibration
        Pixels to metres.
    phenomenon
        What it was taken for.
    fit
        The model fitted.
    trajectory
        What was fitted.
    """
    another = phenomenon_doubt(world[0], phenomenon)
    if another is not None:
        return (another,)
    return gravity_doubts(tracks, world, calibration, phenomenon, fit, trajectory)
