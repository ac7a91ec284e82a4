"""Run jobs on the workers of a dask scheduler, on any machines: they share the clips with this one, no other folder.

A worker gets a job with the files that it reads, works in a temporary folder, and sends back what it wrote; only this
process writes results. dask gives a job whose worker died to another one; where that happens to it more often than
``distributed.scheduler.allowed-failures``, it waits for the end and runs alone, and is lost when it fails again.
Scheduling: Rocklin (2015), *Proc. 14th Python in Science Conf.*, 126.
"""

from __future__ import annotations

import asyncio
import hashlib
import importlib
import json
import pickle
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import islice
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from iris_sysid.benchmark.batch import Batch, Job, Outcome, limited, one_thread
from iris_sysid.errors import DataError, IrisError, OutputError
from iris_sysid.io.files import origin_of, write_atomic

if TYPE_CHECKING:
    from distributed import Client, Future

CONNECT_S = 20.0  # a scheduler that runs answers within so long
FILE_TRIES, FILE_WAIT_S = 10, 0.05  # its file is written at once, but not in one step
AHEAD = 2  # jobs that are sent for each worker: one at work, one that waits for it
MIN_AHEAD = 8  # sent also while there are fewer workers, so that those who come find work
LARGE = "distributed.admin.large-graph-warning-threshold"  # jobs carry the tracks that they read
PACKAGES = ("iris_sysid", "trackers", "fitters")
SOURCE = "source code"
Done = tuple[Any, Mapping[str, bytes]]  # the outcome of a job, and the bytes of its files by their place


def on_cluster(batch: Batch[Job, Outcome], jobs: Sequence[Job], scheduler: str) -> Iterator[tuple[Job, Outcome]]:
    """Run all jobs on the workers of a scheduler, and yield each with its outcome in the order in which they finish.

    Jobs are sent as workers become free, so that neither the scheduler nor a late worker matters to the memory or the
    end of a long run. Workers that come later are used too.

    Parameters
    ----------
    batch
        What is to be done; paths in the jobs must be absolute, and lead to the same files on every worker.
    jobs
        Independent of one another.
    scheduler
        ``tcp://HOST:PORT``, or the file that ``dask scheduler --scheduler-file`` wrote.

    Raises
    ------
    DataError
        When no scheduler answers, or a worker has other versions, no iris-sysid, or several threads.
    IrisError
        When the scheduler ends before the jobs.
    """
    with connected(scheduler) as client:
        yield from _all_done(client, batch, jobs)


def _all_done(client: Client, batch: Batch[Job, Outcome], jobs: Sequence[Job]) -> Iterator[tuple[Job, Outcome]]:
    from distributed import CancelledError
    from distributed.comm import CommClosedError

    suspects = []
    try:
        for job, result in _landing(client, batch, iter(jobs)):
            if result is None:
                suspects.append(job)
            else:
                yield job, _written(batch, job, result)
        for suspect in suspects:  # with one of these its worker died, but several were with it: each runs alone now
            ((_, result),) = _landing(client, batch, iter([suspect]))
            yield suspect, batch.lost(batch.folder, suspect) if result is None else _written(batch, suspect, result)
    except (CancelledError, CommClosedError) as error:
        raise IrisError("the dask scheduler ended before the work; run again: what is finished is kept") from error


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


def _landing(client: Client, batch: Batch[Job, Outcome], waiting: Iterator[Job]) -> Iterator[tuple[Job, Done | None]]:
    """Send the jobs as workers become free, and yield each with its result as it lands, None for one that was lost."""
    from distributed import as_completed

    environment = environment_of_this_process()
    sent: dict[str, Job] = {}
    landed = as_completed(loop=client.loop)

    def send() -> None:
        room = max(MIN_AHEAD, AHEAD * len(client.nthreads())) - len(sent)
        for job in islice(waiting, max(room, 0)):
            content = pickle.dumps((batch.work, job, _files(batch.folder, batch.reads(job))))
            future = client.submit(carry_out, environment, content, pure=False)
            sent[future.key] = job
            landed.add(future)

    send()
    for future in landed:
        yield sent.pop(future.key), _result(future)
        send()


def _result(future: Future) -> Done | None:
    """What came back, which the cluster then forgets; None for a job whose workers died."""
    from distributed import KilledWorker

    try:
        outcome, files = future.result()
    except (KilledWorker, MemoryError):
        return None
    except ImportError as error:
        raise DataError(f"a worker cannot import {error.name}: install the same iris-sysid there ({error})") from error
    finally:
        future.release()
    return outcome, files


def _written(batch: Batch[Job, Outcome], job: Job, result: Done) -> Outcome:
    """Write the files of a job that is done, and return its outcome."""
    outcome, files = result
    for place in files:
        if PurePath(place).is_absolute() or ".." in PurePath(place).parts:
            raise OutputError(f"a worker sent a file for {place}, which is not in {batch.folder}: is it yours?")
    last = set(batch.last(job)) & set(files)
    for place in last:
        (batch.folder / place).unlink(missing_ok=True)  # until the others are there, the job is not complete
    for place in sorted(files, key=lambda place: (place in last, place)):
        write_atomic(batch.folder / place, files[place], overwrite=True)
    return outcome


# --------------------------------------------------------------------------- on the worker


def carry_out(environment: Mapping[str, str], content: bytes) -> Done:
    """Do a job in a temporary folder of this worker; returns its outcome, and the new files by their place.

    Parameters
    ----------
    environment
        What this worker must have, by :func:`environment_of_this_process`.
    content
        The pickled work, job and files that the job reads.

    Raises
    ------
    DataError
        When the worker has another environment, or works on several jobs at a time.
    """
    from distributed import get_worker

    _check_worker(environment)
    work, job, given = pickle.loads(content)
    with TemporaryDirectory(prefix="iris-sysid-") as name:
        folder = Path(name).resolve()
        for place, bytes_ in given.items():
            write_atomic(folder / place, bytes_)
        # a nanny starts a worker again that its limits end
        outcome = limited(work, folder, job) if get_worker().nanny else one_thread(work, folder, job)
        places = [path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()]
        written = _files(folder, places)
    return outcome, {place: bytes_ for place, bytes_ in written.items() if given.get(place) != bytes_}


def _files(folder: Path, places: Sequence[str]) -> dict[str, bytes]:
    """The files among some places below a folder that exist."""
    return {place: (folder / place).read_bytes() for place in places if (folder / place).is_file()}


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
