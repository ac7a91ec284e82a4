"""Run jobs in several processes; a process that dies does not stop the others."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from typing import TypeVar

from iris_sysid.errors import DataError

MOST_WORKERS = 256

Job = TypeVar("Job")
Outcome = TypeVar("Outcome")


def check_workers(workers: int) -> None:
    """Raise DataError unless ``workers`` is a valid number of processes."""
    if not isinstance(workers, int) or not 1 <= workers <= MOST_WORKERS:
        raise DataError(f"workers must be a whole number from 1 to {MOST_WORKERS}, not {workers!r}")


def side_by_side(
    work: Callable[[Job], Outcome], jobs: Sequence[Job], workers: int, lost: Callable[[Job], Outcome]
) -> Iterator[tuple[Job, Outcome]]:
    """Run all jobs, and yield each with its outcome in the order in which they finish.

    Parameters
    ----------
    work
        A function that a new process can import; an exception in it ends the run.
    jobs
        Its arguments, one job each.
    workers
        Number of parallel processes; 1 runs all jobs in this process.
    lost
        Called instead of ``work`` for a job whose process died, e.g. because it ran out of memory.
    """
    if workers == 1 or len(jobs) < 2:
        for job in jobs:
            yield job, work(job)
        return
    waiting = dict(enumerate(jobs))
    with suppress(BrokenProcessPool):
        for number, outcome in _pooled(work, waiting, workers):
            yield waiting.pop(number), outcome
    for (
        number,
        job,
    ) in waiting.items():  # one of these jobs killed its process: each runs alone now
        try:
            yield job, next(outcome for _, outcome in _pooled(work, {number: job}, 1))
        except BrokenProcessPool:
            yield job, lost(job)


def _pooled(work: Callable[[Job], Outcome], jobs: dict[int, Job], workers: int) -> Iterator[tuple[int, Outcome]]:
    # spawn: a fork would copy locks that threads of the decoder and encoder hold
    with ProcessPoolExecutor(min(workers, len(jobs)), multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(work, job): number for number, job in jobs.items()}
        try:
            for future in as_completed(waiting):
                yield waiting[future], future.result()
        finally:
            pool.shutdown(cancel_futures=True)
