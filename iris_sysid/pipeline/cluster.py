"""Run jobs on the workers of a dask scheduler, on machines that share the folders of the clips and of the results.

dask gives a job whose worker died to another one, as often as ``distributed.scheduler.allowed-failures`` says; then it
waits for the end and runs alone, and is lost when it fails again. Scheduling: Rocklin (2015), *Proc. 14th Python in
Science Conf.*, 126.
"""

from __future__ import annotations

import asyncio
import hashlib
import importlib
import json
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from iris_sysid.errors import DataError, IrisError
from iris_sysid.io.files import origin_of
from iris_sysid.io.one_thread import on_one_thread
from iris_sysid.pipeline.batch import Batch, Job, Outcome, limited

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S = 20.0  # a scheduler that runs answers within so long
FILE_TRIES, FILE_WAIT_S = 10, 0.05  # its file is written at once, but not in one step
LARGE = "distributed.admin.large-graph-warning-threshold"  # jobs carry the tracks that they read
PACKAGES = ("iris_sysid", "trackers", "fitters")
SOURCE = "source code"


def on_cluster(batch: Batch[Job, Outcome], jobs: Sequence[Job], scheduler: str) -> Iterator[tuple[Job, Outcome]]:
    """Run all jobs on the workers of a scheduler, and yield each with its outcome in the order in which they finish.

    Workers that come later are used too.

    Parameters
    ----------
    batch
        What is to be done; its folder, and the paths in the jobs, lead to the same files on every worker.
    jobs
        Independent of one another.
    scheduler
        ``tcp://HOST:PORT``, or the file that ``dask scheduler --scheduler-file`` wrote.

    Raises
    ------
    DataError
        When no scheduler answers, or a worker has other versions, no iris-sysid, several threads, or not this folder.
    IrisError
        When the scheduler ends before the jobs.
    """
    from distributed import CancelledError
    from distributed.comm import CommClosedError

    suspects = []
    with connected(scheduler) as client:
        try:
            for job, outcomes in _landing(client, batch, jobs):
                if outcomes:
                    yield job, outcomes[0]
                else:
                    suspects.append(job)
            for suspect in suspects:  # with one of these its worker died, but others were with it: each runs alone now
                ((_, outcomes),) = _landing(client, batch, [suspect])
                yield suspect, outcomes[0] if outcomes else batch.lost(batch.folder, suspect)
        except (CancelledError, CommClosedError) as error:
            raise IrisError("the dask scheduler ended before the work; run again: what is finished is kept") from error


def _landing(
    client: Client, batch: Batch[Job, Outcome], jobs: Sequence[Job]
) -> Iterator[tuple[Job, tuple[Outcome, ...]]]:
    """Send the jobs, and yield each as it lands with its outcome; with none where its workers died."""
    from distributed import as_completed

    folder, environment = batch.folder.absolute(), environment_of_this_process()
    folder.mkdir(parents=True, exist_ok=True)
    futures = [client.submit(carry_out, environment, batch.work, folder, job, pure=False) for job in jobs]
    sent = {future.key: job for future, job in zip(futures, jobs, strict=True)}
    for future in as_completed(futures, loop=client.loop):
        yield sent[future.key], _outcomes(future)


def _outcomes(future: Future) -> tuple[Outcome, ...]:
    """What came back, which the cluster then forgets; nothing for a job whose workers died."""
    from distributed import KilledWorker

    try:
        return (future.result(),)
    except (KilledWorker, MemoryError):
        return ()
    except ImportError as error:
        raise DataError(f"a worker cannot import {error.name}: install the same iris-sysid there ({error})") from error
    finally:
        future.release()


def connected(scheduler: str) -> Client:
    """A client of the scheduler, to be closed; DataError when there is none, or dask is not installed."""
    try:
        from dask import config
        from distributed import Client
        from distributed.utils import LoopRunner
    except ImportError as error:
        raise DataError("a scheduler needs dask: pip install 'iris-sysid[cluster]'") from error
    address = _address_in(scheduler) if scheduler.endswith(".json") else scheduler
    config.set({LARGE: "1GB"})
    try:
        # A client that fails to connect closes itself when it is collected, under a lock that the next one may hold.
        LoopRunner().run_sync(_greet, address)
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        raise DataError(f"no dask scheduler answers at {scheduler}; is it running? ({error})") from error


def _address_in(file: str) -> str:
    """The address in the file of a scheduler, which may be at writing it."""
    if not Path(file).is_file():
        raise DataError(f"there is no file {file}; dask scheduler --scheduler-file {file} writes it")
    for _ in range(FILE_TRIES):
        with suppress(ValueError, KeyError, TypeError):
            return str(json.loads(Path(file).read_bytes())["address"])
        time.sleep(FILE_WAIT_S)
    raise DataError(f"{file} names no address; dask scheduler --scheduler-file {file} writes it")


async def _greet(address: str) -> None:
    """Exchange the first messages with a scheduler; OSError or ValueError when it does not answer as one."""
    from distributed.comm import connect
    from distributed.security import Security

    async with asyncio.timeout(CONNECT_S):
        comm = await connect(address, timeout=CONNECT_S, **Security().get_connection_args("client"))
    await comm.close()


# --------------------------------------------------------------------------- on the worker


def carry_out(environment: Mapping[str, str], work: Callable[[Path, Job], Outcome], folder: Path, job: Job) -> Outcome:
    """Do a job on this worker.

    Parameters
    ----------
    environment
        What this worker must have, by :func:`environment_of_this_process`.
    work, folder, job
        As in the batch.

    Raises
    ------
    DataError
        When the worker has another environment, works on several jobs at a time, or does not find the folder.
    """
    from distributed import get_worker

    _check_worker(environment)
    if not folder.is_dir():
        raise DataError(f"worker {get_worker().address} does not find {folder}; write to a folder that all share")
    # a nanny starts a worker again that its limits end
    return limited(work, folder, job) if get_worker().nanny else on_one_thread(work)(folder, job)


def _check_worker(environment: Mapping[str, str]) -> None:
    from distributed import get_worker

    worker, own = get_worker(), environment_of_this_process()
    threads = worker.state.nthreads
    if threads != 1:
        raise DataError(
            f"worker {worker.address} does {threads} jobs at a time in one process, which they are not made for; "
            f"start it with --nthreads 1, and --nworkers {threads} for as many processes"
        )
    names = sorted(environment.keys() | own.keys())
    different = [name for name in names if environment.get(name) != own.get(name)]
    if different:
        texts = [f"{name} {own.get(name, 'missing')} instead of {environment.get(name, 'none')}" for name in different]
        raise DataError(f"worker {worker.address} has {', '.join(texts)}; install the same versions there")


@cache
def environment_of_this_process() -> dict[str, str]:
    """What results depend on, by name: versions of Python and of the packages that compute, hash of our source."""
    origin = origin_of(None, {})
    return {**origin["versions"], "python": origin["python"], SOURCE: _source()}


def _source() -> str:
    """The first digits of the SHA-256 of every Python file of the three packages."""
    digest = hashlib.sha256()
    for package in PACKAGES:
        (folder,) = importlib.import_module(package).__path__
        for file in sorted(Path(folder).rglob("*.py")):
            digest.update(f"{package}/{file.relative_to(folder).as_posix()}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
