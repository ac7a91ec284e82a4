"""Find the clips to diagnose: tables, folders of tables, folders of ``run``, or a whole data set."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from iris_sysid.benchmark.dataset import benchmark_classes
from iris_sysid.errors import DataError
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.io.schemas.groundtruth import MeasuredDocument
from iris_sysid.types import Progress, Trajectory

TRAJECTORY = "trajectory.csv"  # in a folder of ``run``
TRACK = "track.csv"  # beside it, and no trajectory


def is_dataset(path: Path) -> bool:
    """Whether a folder holds the folder of a class that some phenomenon shows."""
    return path.is_dir() and any((path / name).is_dir() for name in benchmark_classes())


def tables_in(path: Path) -> list[Path]:
    """The trajectories of a path, in the order of their names: itself, or those in it and in its folders.

    Raises
    ------
    DataError
        When a folder holds none.
    """
    if not path.is_dir():
        return [path]
    own = [path / TRAJECTORY] if (path / TRAJECTORY).is_file() else sorted(_tables(path))
    tables = own or sorted(folder / TRAJECTORY for folder in path.iterdir() if (folder / TRAJECTORY).is_file())
    if not tables:
        raise DataError(
            f"{path} holds no clip: it has no trajectory (*.csv), no folder of iris-sysid run (*/{TRAJECTORY}), and "
            f"no class of a data set ({', '.join(sorted(benchmark_classes()))})"
        )
    return tables


def _tables(path: Path) -> Iterator[Path]:
    return (table for table in path.glob("*.csv") if table.is_file() and table.name != TRACK)


def clips_of(paths: Sequence[Path]) -> list[Trajectory]:
    """Read every trajectory of the given tables and folders."""
    return [read_trajectory(table) for path in paths for table in tables_in(path)]


def clips_of_dataset(
    folder: Path,
    phenomenon: str,
    work: Path,
    *,
    board: MeasuredDocument,
    trials: int | None = None,
    tell: Callable[[str], None],
    progress: Progress | None = None,
) -> list[Trajectory]:
    """Measure the clips of one phenomenon, those not measured before, and read what was fitted of each.

    Parameters
    ----------
    folder
        ``<Class>/<setting>/<clip>.mp4``.
    phenomenon
        Registered name.
    work
        Where what each clip gave is kept; see :func:`iris_sysid.benchmark.groundtruth.measure.measure`.
    board
        What is known of the checkerboards.
    trials
        Only so many clips of each setting; None for all.
    tell
        Called with a line about each clip that is left out, and why.
    progress
        Called with (clips done, clips in all).

    Raises
    ------
    DataError
        When the data set has no clip of the phenomenon that could be fitted.
    """
    from iris_sysid.benchmark.groundtruth.measure import Conditions, measure  # loads trackers and calibration

    conditions = Conditions(trials=trials, phenomenon=phenomenon)
    measurements = measure(folder, work, measured=board, conditions=conditions, progress=progress, tell=tell)
    trajectories = [clip.trajectory() for clip in measurements.clips if clip.document.usable]
    usable = [trajectory for trajectory in trajectories if trajectory is not None]
    if not usable:
        raise DataError(
            f"{folder} has no clip of {phenomenon} that could be fitted; {len(measurements.clips)} were tried"
        )
    return usable
