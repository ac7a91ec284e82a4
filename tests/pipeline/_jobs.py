"""Jobs that a process, here or on a cluster, can import."""

from __future__ import annotations

import os
import resource
import time
from pathlib import Path


def squared(folder: Path, number: int) -> int:
    """The square of a number; 3 ends the process as a lack of memory does."""
    if number == 3:
        os._exit(9)
    return number**2


def minus_one(folder: Path, number: int) -> int:
    """What stands for a job that was lost."""
    return -1


def noted_square(folder: Path, number: int) -> int:
    """As :func:`squared`, after a while; the process is noted in a file."""
    (folder / str(number)).write_text(str(os.getpid()))
    time.sleep(0.1)
    return squared(folder, number)


def crowded(folder: Path, number: int) -> int:
    """The number, or no memory for 3; the process is noted in a file."""
    (folder / str(number)).write_text(str(os.getpid()))
    if number == 3:
        raise MemoryError
    return number


def most_memory(folder: Path, number: int) -> int:
    """The most bytes that this process may have; -1 without a limit."""
    return resource.getrlimit(resource.RLIMIT_DATA)[0]


def slow(folder: Path, number: int) -> int:
    """The process that did it, after a while."""
    time.sleep(0.3)
    return os.getpid()
