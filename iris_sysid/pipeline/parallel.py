"""Run independent jobs in several processes, here or on a cluster; a process that dies costs its job alone."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from iris_sysid.errors import DataError
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.pipeline.batch import Batch, Job, Outcome, limited

MAX_WORKERS = 256
JOBS_A_PROCESS = 8  # what libraries keep of each job, up to 60 MB, goes with the process; a new one takes 2 s

Workers = int | str  # a number of processes beside this one, or the address or file of a dask scheduler


def check_workers(workers: Workers) -> None:
    """Raise DataError unless ``workers`` is a valid number of processes, or text that may name a scheduler."""
    if isinstance(workers, str) and workers.strip():
        return
    if not isinstance(workers, int) or not 0 <= workers <= MAX_WORKERS:
        raise DataError(f"workers must be a whole number from 0 to {MAX_WORKERS}, not {workers!r}")


def run_parallel(batch: Batch[Job, Outcome], jobs: Sequence[Job], workers: Workers) -> Iterator[tuple[Job, Outcome]]:
    """Run all jobs, and yield each with its outcome in the order in which they finish.

    ``workers`` processes take one job at a time; 0 runs all jobs in this one, which then ends with a job that crashes.
    Text is the address (``tcp://HOST:PORT``) or the file (``FILE.json``) of a dask scheduler; see
    :mod:`iris_sysid.pipeline.cluster`.
    """
    if isinstance(workers, str):
        from iris_sysid.pipeline.cluster import on_cluster  # dask is an extra

        yield from on_cluster(batch, jobs, workers)
    elif workers == 0:
        for job in jobs:
            yield job, on_one_thread(batch.work)(batch.folder, job)
    else:
        yield from _in_processes(batch, jobs, workers)


def _in_processes(batch: Batch[Job, Outcome], jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, Outcome]]:
    crashed: list[Job] = []
    yield from _in_lanes(batch, deque(jobs), workers, crashed)
    lost: list[Job] = []
    yield from _in_lanes(batch, deque(crashed), 1, lost)  # once more, alone: memory may have been too little for many
    for job in lost:
        yield job, batch.lost(batch.folder, job)


def _in_lanes(
    batch: Batch[Job, Outcome], waiting: deque[Job], workers: int, crashed: list[Job]
) -> Iterator[tuple[Job, Outcome]]:
    """Take jobs as lanes become free; those whose process died are left in ``crashed``."""
    idle = lanes = [_Lane() for _ in range(min(workers, len(waiting)))]
    running: dict[Future[Outcome], tuple[Job, _Lane]] = {}
    try:
        while waiting or running:
            while waiting and idle:
                job, lane = waiting.popleft(), idle[0]
                running[lane.submit(batch, job)], idle = (job, lane), idle[1:]
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                job, lane = running.pop(future)
                idle = [*idle, lane]
                try:
                    yield job, _outcome(batch, job, future)
                except BrokenProcessPool:
                    lane.close()
                    crashed.append(job)
    finally:
        for lane in lanes:
            lane.close()


class _Lane:
    """One process at a time, a new one after JOBS_A_PROCESS jobs: memory that libraries keep goes with the old one.

    It has its own pool, since ``max_tasks_per_child`` of a common one can wait for ever (Python 3.11).
    """

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None
        self._done = 0

    def submit(self, batch: Batch[Job, Outcome], job: Job) -> Future[Outcome]:
        """Begin a job in the process."""
        if self._pool is None or self._done == JOBS_A_PROCESS:
            self.close()
            # spawn: a fork would copy locks that threads of the decoder and encoder hold
            self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
        self._done += 1
        return self._pool.submit(limited, batch.work, batch.folder, job)

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=True)
        self._pool, self._done = None, 0


def _outcome(batch: Batch[Job, Outcome], job: Job, future: Future[Outcome]) -> Outcome:
    try:
        return future.result()
    except MemoryError:  # the limit of the process, which goes on
        return batch.lost(batch.folder, job)
