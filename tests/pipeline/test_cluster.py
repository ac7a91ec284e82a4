"""Batches on a real dask cluster of two workers, each in its own folder."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from iris_sysid.benchmark.groundtruth.measure import measure
from iris_sysid.errors import DataError, IrisError
from iris_sysid.pipeline import cluster
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.parallel import run_parallel
from tests._project import ROOT
from tests.cli.test_own_model import MINE, way
from tests.conftest import listing
from tests.pipeline._jobs import minus_one, slow, squared

START_S = 30.0
DASK = str(Path(sys.executable).parent / "dask")
ON_ONE_MACHINE = ("--host", "127.0.0.1", "--no-dashboard")


ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """The file of a scheduler with two workers."""
    folder = tmp_path_factory.mktemp("cluster")
    file = folder / "scheduler.json"
    with ExitStack() as processes:

        def start(name: str, *arguments: str) -> None:
            (folder / name).mkdir()
            log = processes.enter_context((folder / f"{name}.log").open("w"))
            command = [DASK, *arguments, "--scheduler-file", str(file), *ON_ONE_MACHINE]
            process = subprocess.Popen(command, cwd=folder / name, env=ENVIRONMENT, stderr=log, stdout=log)
            processes.enter_context(process)
            processes.callback(process.terminate)

        start("scheduler", "scheduler", "--port", "0")
        wait_until(file.is_file)
        start("first", "worker", "--nthreads", "1")
        start("second", "worker", "--nthreads", "1")
        with cluster.connected(str(file)) as client:
            client.wait_for_workers(2, timeout=START_S)
        yield str(file)


def wait_until(condition) -> None:
    end = time.monotonic() + START_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.slow
def test_job_that_kills_every_worker_is_lost_and_all_others_are_done(scheduler, tmp_path):
    done = dict(run_parallel(Batch(tmp_path, squared, minus_one), [3, *range(4, 12)], scheduler))
    assert done == {3: -1, **{number: number**2 for number in range(4, 12)}}


@pytest.mark.slow
def test_worker_that_is_killed_costs_nothing(scheduler, tmp_path):
    landing = run_parallel(Batch(tmp_path, slow, minus_one), range(8), scheduler)
    first, process = next(landing)
    os.kill(process, signal.SIGKILL)
    done = dict(landing)
    assert sorted([first, *done]) == list(range(8))
    assert -1 not in done.values()
    assert process not in done.values()


@pytest.mark.slow
def test_measured_clips_have_the_same_bytes_on_a_cluster_and_are_not_measured_twice(
    scheduler, tmp_path, pendulum_clip, monkeypatch
):
    setting = tmp_path / "data" / "Pendulum" / "pendulum_45"
    setting.mkdir(parents=True)
    shutil.copy(pendulum_clip, setting / "01.mp4")
    (setting / "02.mp4").write_bytes(b"no video")
    monkeypatch.chdir(tmp_path)
    assert measure("data", "there", workers=scheduler).now == 2
    assert measure(tmp_path / "data", tmp_path / "here").now == 2
    assert listing(tmp_path / "there") == listing(tmp_path / "here")
    assert measure("data", "there", workers=scheduler).now == 0


@pytest.mark.slow
def test_diagnoses_with_a_model_of_ones_own_have_the_same_bytes_on_a_cluster(scheduler, tmp_path, cli, monkeypatch):
    monkeypatch.chdir(tmp_path)
    calls_another = MINE.replace("return v, -params[0] * v", "return v, slowed(v, params)")
    Path("my_models.py").write_text(f"{calls_another}\n\ndef slowed(v, params):\n    return -params[0] * v\n")
    Path("tables").mkdir()
    way(1).to_csv("tables/way.csv", index=False)
    command = ["diagnose", "tables", "--each", "--model", "my_models.py:coasting"]
    for output, where in (("there", ["--scheduler", scheduler]), ("here", ["--workers", "1"])):
        outcome = cli(*command, "-o", output, *where)
        assert outcome.status == 0, outcome.err
    assert Path("there/way/report.html").is_file()
    assert listing(Path("there")) == listing(Path("here"))


@pytest.mark.slow
def test_worker_with_another_version_is_refused(scheduler, tmp_path, monkeypatch):
    ours = {**cluster.environment_of_this_process(), "numpy": "1.0", cluster.SOURCE: "abc"}
    monkeypatch.setattr(cluster, "environment_of_this_process", lambda: ours)
    with pytest.raises(
        DataError, match=r"worker tcp://.* has numpy [\d.]+ instead of 1\.0, source code \w+ instead of"
    ):
        dict(run_parallel(Batch(tmp_path, squared, minus_one), [1], scheduler))


@pytest.mark.slow
def test_end_of_the_scheduler_is_a_stated_error(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 5.0)
    file = tmp_path / "scheduler.json"
    command = [DASK, "scheduler", "--scheduler-file", str(file), *ON_ONE_MACHINE, "--port", "0"]
    with (
        (tmp_path / "log").open("w") as log,
        subprocess.Popen(command, stderr=log, stdout=log, env=ENVIRONMENT) as process,
    ):
        wait_until(file.is_file)
        client = cluster.connected(str(file))

        def then_killed(scheduler):
            threading.Timer(0.5, process.kill).start()
            return client

        monkeypatch.setattr(cluster, "connected", then_killed)
        waits = Batch(tmp_path, squared, minus_one)  # there is no worker
        with pytest.raises(IrisError, match="the dask scheduler ended before the work; run again"):
            list(run_parallel(waits, [1], str(file)))


@pytest.mark.slow
def test_worker_of_several_threads_is_refused(scheduler, tmp_path):
    many = [DASK, "worker", "--scheduler-file", scheduler, *ON_ONE_MACHINE, "--nthreads", "2", "--no-nanny"]
    with (
        (tmp_path / "log").open("w") as log,
        subprocess.Popen(many, cwd=tmp_path, stderr=log, stdout=log, env=ENVIRONMENT) as process,
        cluster.connected(scheduler) as client,
    ):
        try:
            client.wait_for_workers(3, timeout=START_S)
            with pytest.raises(DataError, match=r"does 2 jobs at a time in one process.*start it with --nthreads 1"):
                dict(run_parallel(Batch(tmp_path, slow, minus_one), range(9), scheduler))
        finally:
            process.terminate()


@pytest.mark.slow
def test_folder_that_a_worker_does_not_find_is_named(scheduler, tmp_path, monkeypatch):
    monkeypatch.setattr(Path, "absolute", lambda path: Path("/proc/self/nowhere"))
    monkeypatch.setattr(Path, "mkdir", lambda path, **options: None)
    with pytest.raises(DataError, match=r"worker tcp://.* does not find /proc/self/nowhere; write to a folder"):
        dict(run_parallel(Batch(tmp_path, squared, minus_one), [1], scheduler))


def test_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.2)
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{unused.getsockname()[1]}"
        with pytest.raises(DataError, match=f"no dask scheduler answers at {address}; is it running"):
            list(run_parallel(Batch(tmp_path, squared, minus_one), [1], address))


@pytest.mark.parametrize("address", ["nowhere", "ftp://somewhere:1", "tcp://:x"])
def test_address_that_is_none_is_named(address, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.2)
    with pytest.raises(DataError, match=f"no dask scheduler answers at {address}"):
        cluster.connected(address)


def test_scheduler_that_does_not_answer_leaves_no_client_behind(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.2)
    monkeypatch.setattr("distributed.Client", lambda *arguments, **options: pytest.fail("a client was made"))
    with pytest.raises(DataError, match="no dask scheduler answers"):
        cluster.connected("tcp://127.0.0.1:1")


def test_server_that_is_no_scheduler_is_named(monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(DataError, match=f"no dask scheduler answers at {address}"):
            cluster.connected(address)


@pytest.mark.parametrize("content", ["", "{}", "[]", '{"address"'])
def test_file_without_an_address_is_named(content, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "FILE_WAIT_S", 0.0)
    (tmp_path / "scheduler.json").write_text(content)
    with pytest.raises(DataError, match=r"scheduler\.json names no address"):
        cluster.connected(str(tmp_path / "scheduler.json"))


def test_file_of_a_scheduler_that_is_missing_is_named(tmp_path):
    with pytest.raises(DataError, match=r"there is no file .*none\.json; dask scheduler --scheduler-file"):
        cluster.connected(str(tmp_path / "none.json"))


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(DataError, match=r"pip install 'iris-sysid\[cluster\]'"):
        cluster.connected("tcp://127.0.0.1:8786")


@pytest.mark.parametrize(
    "command",
    [("gt", "DATA", "-o", "p.json"), ("benchmark", "DATA", "-o", "tables"), ("render", "--dataset", "DATA")],
    ids=lambda command: command[0],
)
def test_commands_take_workers_or_a_scheduler_not_both(command, cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "DATA").mkdir()
    outcome = cli(*command, "--scheduler", "none.json", "--workers", "2")
    assert (outcome.status, "give --workers or --scheduler, not both" in outcome.err) == (1, True)
    assert "there is no file none.json" in cli(*command, "--scheduler", "none.json").err
