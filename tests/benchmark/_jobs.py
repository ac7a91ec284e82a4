"""Jobs that a process, here or on a cluster, can import."""

from __future__ import annotations

import os
import time
from pathlib import Path

import iris_sysid


def squared(folder: Path, number: int) -> int:
    """The square of a number; 3 ends the process as a lack of memory does."""
    if number == 3:
        os._exit(9)
    return number**2


def minus_one(folder: Path, number: int) -> int:
    """What stands for a job that was lost."""
    return -1


def places(folder: Path, name: str) -> tuple[str, str, str]:
    """Copy a file within the folder; returns where the code is, where the process runs, and the folder."""
    (folder / "copies").mkdir(exist_ok=True)
    (folder / "copies" / name).write_bytes((folder / name).read_bytes() * 2)
    return str(Path(iris_sysid.__file__).parent.parent), str(Path.cwd()), str(folder)


def slow(folder: Path, number: int) -> int:
    """The process that did it, after a while."""
    time.sleep(0.3)
    return os.getpid()
