"""Run independent jobs in several processes, here or on a cluster; a process that dies costs its job alone."""

from __future__ import annotations

import multiprocessing
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool

from iris_sysid.benchmark.batch import Batch, Job, Outcome, limited
from iris_sysid.errors import DataError

MOST_WORKERS = 256

Workers = int | str  # a number of processes beside this one, or the address or file of a dask scheduler


def check_workers(workers: Workers) -> None:
    """Raise DataError unless ``workers`` is a valid number of processes, or text that may name a scheduler."""
    if isinstance(workers, str) and workers.strip():
        return
    if not isinstance(workers, int) or not 0 <= workers <= MOST_WORKERS:
        raise DataError(f"workers must be a whole number from 0 to {MOST_WORKERS}, not {workers!r}")


def side_by_side(batch: Batch[Job, Outcome], jobs: Sequence[Job], workers: Workers) -> Iterator[tuple[Job, Outcome]]:
    """Run all jobs, and yield each with its outcome in the order in which they finish.

    Parameters
    ----------
    batch
        What is to be done.
    jobs
        One at a time of each process.
    workers
        Number of parallel processes; 0 runs all jobs in this one, which then ends with a job that crashes.
        Text is the address (``tcp://HOST:PORT``) or the file (``FILE.json``) of a dask scheduler; see
        :mod:`iris_sysid.benchmark.cluster`.
    """
    if isinstance(workers, str):
        from iris_sysid.benchmark.cluster import on_cluster  # dask is an extra

        yield from on_cluster(batch, jobs, workers)
    elif workers == 0:
        for job in jobs:
            yield job, batch.work(batch.folder, job)
    else:
        yield from _in_processes(batch, jobs, workers)


def _in_processes(batch: Batch[Job, Outcome], jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, Outcome]]:
    waiting = deque(jobs)
    while waiting:
        suspects: list[Job] = []
        yield from _pooled(batch, waiting, workers, suspects)
        for suspect in suspects:  # one of these killed its process, and the pool with it: each runs alone now
            again: list[Job] = []
            yield from _pooled(batch, deque([suspect]), 1, again)
            for job in again:
                yield job, batch.lost(batch.folder, job)


def _pooled(
    batch: Batch[Job, Outcome], waiting: deque[Job], workers: int, suspects: list[Job]
) -> Iterator[tuple[Job, Outcome]]:
    """Take jobs as processes become free; when a process dies, leave those that were at work in ``suspects``."""
    # spawn: a fork would copy locks that threads of the decoder and encoder hold
    with ProcessPoolExecutor(min(workers, len(waiting)), multiprocessing.get_context("spawn")) as pool:
        running: dict[Future[Outcome], Job] = {}
        try:
            while waiting or running:
                while waiting and len(running) < workers:
                    running[pool.submit(limited, batch.work, batch.folder, waiting[0])] = waiting[0]
                    waiting.popleft()
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    outcome = _outcome(batch, running[future], future)
                    yield running.pop(future), outcome
        except BrokenProcessPool:
            suspects += running.values()
        finally:
            pool.shutdown(cancel_futures=True)


def _outcome(batch: Batch[Job, Outcome], job: Job, future: Future[Outcome]) -> Outcome:
    try:
        return future.result()
    except MemoryError:  # the limit of the process, which goes on
        return batch.lost(batch.folder, job)
