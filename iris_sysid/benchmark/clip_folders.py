"""Find the clips to diagnose: tables, folders of tables, folders of ``run``, or a whole data set."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from iris_sysid.benchmark.dataset import benchmark_classes
from iris_sysid.benchmark.parallel import Workers
from iris_sysid.errors import DataError
from iris_sysid.io.schemas.groundtruth import MeasuredDocument
from iris_sysid.types import Progress, Trajectory

TRAJECTORY = "trajectory.csv"  # in a folder of ``run``
TRACK = "track.csv"  # in the same folder; not a trajectory


def is_dataset(path: Path) -> bool:
    """Whether a folder holds the folder of any registered benchmark class."""
    return path.is_dir() and any((path / name).is_dir() for name in benchmark_classes())


def tables_in(path: Path) -> list[Path]:
    """The trajectory files of a path, sorted by name: the file itself, or those in the folder and its subfolders.

    Raises
    ------
    DataError
        When the folder holds no trajectory.
    """
    if not path.is_dir():
        return [path]
    named = sorted(table for table in path.glob("*.csv") if table.is_file() and table.name != TRACK)
    own = [path / TRAJECTORY] if (path / TRAJECTORY).is_file() else named
    tables = own or sorted(folder / TRAJECTORY for folder in path.iterdir() if (folder / TRAJECTORY).is_file())
    if not tables:
        raise DataError(
            f"{path} holds no clip: it has no trajectory (*.csv), no folder of iris-sysid run (*/{TRAJECTORY}), and "
            f"no class of a data set ({', '.join(sorted(benchmark_classes()))})"
        )
    return tables


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
