"""Measure the clips of a data set that ``diagnose`` is given, and read their trajectories."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.io.schemas.groundtruth import MeasuredDocument
from iris_sysid.pipeline.parallel import Workers
from iris_sysid.types import Progress, Trajectory


def clips_of_dataset(
    folder: Path,
    phenomenon: str,
    work: Path,
    *,
    board: MeasuredDocument,
    trials: int | None = None,
    workers: Workers = 0,
    tell: Callable[[str], None],
    progress: Progress | None = None,
) -> list[Trajectory]:
    """Measure the clips of one phenomenon that were not measured before, and read the fitted trajectory of each.

    Parameters
    ----------
    folder
        ``<Class>/<setting>/<clip>.mp4``.
    phenomenon
        Registered name.
    work
        Folder of the measurements; see :func:`iris_sysid.benchmark.groundtruth.measure.measure`.
    board
        The checkerboards, as measured by hand.
    trials
        At most this many clips of each setting; None for all.
    workers
        Number of parallel processes, 0 for this one, or the address or file of a dask scheduler.
    tell
        Called with one line per clip that is left out, with the reason.
    progress
        Called with (clips done, clips in all).

    Raises
    ------
    DataError
        When the data set has no clip of the phenomenon that could be fitted.
    """
    from iris_sysid.benchmark.groundtruth.measure import Conditions, measure  # loads trackers and calibration

    conditions = Conditions(trials=trials, phenomenon=phenomenon)
    measurements = measure(
        folder, work, measured=board, conditions=conditions, workers=workers, progress=progress, tell=tell
    )
    trajectories = [clip.trajectory() for clip in measurements.clips if clip.document.usable]
    usable = [trajectory for trajectory in trajectories if trajectory is not None]
    if not usable:
        raise DataError(
            f"{folder} has no clip of {phenomenon} that could be fitted; {len(measurements.clips)} were tried"
        )
    return usable
