"""Find the clips to diagnose: tables, folders of tables, of ``run``, or of a setting that ``gt`` measured."""

from __future__ import annotations

from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import BenchmarkClass

TRAJECTORY = "trajectory.csv"  # in a folder of ``run``
TRACK = "track.csv"  # in the same folder, and the end of such names in a folder of gt; not a trajectory
CLIP_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".gif")  # of the files in a folder of clips


def benchmark_classes() -> dict[str, tuple[str, BenchmarkClass]]:
    """Phenomenon and description of every class by its folder's name."""
    return {
        class_name.folder: (name, class_name)
        for name, phenomenon in PHENOMENA.items()
        for class_name in phenomenon.classes
    }


def tables_in(path: Path) -> list[Path]:
    """The trajectory files of a path, sorted by name: the file itself, or those in the folder and its subfolders.

    DataError when the folder holds no trajectory, as a data set before it is measured.
    """
    if not path.is_dir():
        return [path]
    named = sorted(table for table in path.glob("*.csv") if table.is_file() and not table.name.endswith(TRACK))
    own = [path / TRAJECTORY] if (path / TRAJECTORY).is_file() else named
    tables = own or sorted(folder / TRAJECTORY for folder in path.iterdir() if (folder / TRAJECTORY).is_file())
    if any((path / name).is_dir() for name in benchmark_classes()):
        raise DataError(
            f"{path} is a data set: measure it first (iris-sysid gt {path} -o parameters.json), then give the folders "
            "of its settings, parameters.work/CLASS/SETTING"
        )
    if not tables:
        raise DataError(f"{path} holds no clip: neither a trajectory (*.csv) nor a folder of run (*/{TRAJECTORY})")
    return tables
