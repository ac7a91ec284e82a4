"""A batch of independent jobs that write into one folder, done by any processes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.video.sandbox import limit_process

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


@dataclass(frozen=True, slots=True)
class Batch(Generic[Job, Outcome]):
    """What is to be done with each job, and the folder that all of them write into.

    ``work(folder, job)`` writes below ``folder`` only; a new process can import it, and an exception in it ends the
    run. ``lost(folder, job)`` gives the outcome of a job whose process died, e.g. because it ran out of memory.
    """

    folder: Path
    work: Callable[[Path, Job], Outcome]
    lost: Callable[[Path, Job], Outcome]


@on_one_thread
def limited(work: Callable[[Path, Job], Outcome], folder: Path, job: Job) -> Outcome:
    """Do a job within limits of memory and time for this process, which a file that is not trusted could exhaust."""
    limit_process()
    return work(folder, job)
