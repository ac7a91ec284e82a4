"""Find the clips to diagnose: tables, folders of tables, folders of ``run``, or a whole data set."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import BenchmarkClass

TRAJECTORY = "trajectory.csv"  # in a folder of ``run``
TRACK = "track.csv"  # in the same folder; not a trajectory
CLIP_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".gif")  # of the files in a folder of clips


def benchmark_classes() -> dict[str, tuple[str, BenchmarkClass]]:
    """Phenomenon and description of every class by its folder's name."""
    return {
        class_name.folder: (name, class_name)
        for name, phenomenon in PHENOMENA.items()
        for class_name in phenomenon.classes
    }


def is_dataset(path: Path) -> bool:
    """Whether a folder holds the folder of any registered benchmark class."""
    return path.is_dir() and any((path / name).is_dir() for name in benchmark_classes())


def tables_in(path: Path) -> list[Path]:
    """The trajectory files of a path, sorted by name: the file itself, or those in the folder and its subfolders.

    DataError when the folder holds no trajectory.
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
