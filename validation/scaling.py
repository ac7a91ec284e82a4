"""How batches scale: what a clip costs beside its own work, one process against two, and the whole benchmark on paper.

``python -m validation.scaling`` times jobs that do nothing, in a pool and on dask workers of this machine, then renders
pendulums and measures them (as ``iris-sysid gt`` does) by one process and by two. The ratio of processor times is what
the processes take from one another, whatever else the machine does; that of the clock is that of an idle machine only.

The part on paper schedules the clips of the published data set (durations of the scenes, 60 frames/s, 3840x2160) in
their order on many processes: each clip takes its frames times the processor time a frame of its class, as measured by
``validation.speed`` (table in ``docs/validation/tracking.md``), times the
ratio of processor times, plus the overhead of a clip, both as the other two parts measured them.
"""

from __future__ import annotations

import argparse
import heapq
import os
import resource
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from iris_sysid.benchmark.groundtruth.clip import Conditions
from iris_sysid.benchmark.groundtruth.measure import measure
from iris_sysid.benchmark.render_dataset import render_dataset
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.clip_folders import benchmark_classes
from iris_sysid.pipeline.parallel import Workers, run_parallel
from iris_sysid.synthetic.scene import SCENES
from validation import pages

TRIALS = 10
FPS = 60
PENDULUM_MS, OTHER_MS = 36.3, 90.7  # a frame at 4K, idle: pendulum and drop of 300 frames, start included
PROCESSORS = 8  # of a machine, on paper
MACHINES = (1, 8, 64)
COPIES = (1, 100)  # of the data set of 240 clips


@dataclass(frozen=True)
class Cost:
    """Seconds of the clock and of all processors that a piece of work took."""

    wall_s: float
    processor_s: float


def nothing(folder: Path, number: int) -> int:
    """A job without work."""
    return number


@contextmanager
def dask_workers(count: int) -> Iterator[str]:
    """The address of a scheduler with so many workers on this machine."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


def timed(work: Callable[[], object]) -> Cost:
    """What work costs, with that of the processes that it starts and ends."""
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    usages = [resource.getrusage(one) for one in who]
    began, before = time.perf_counter(), sum(usage.ru_utime + usage.ru_stime for usage in usages)
    work()
    usages = [resource.getrusage(one) for one in who]
    after = sum(usage.ru_utime + usage.ru_stime for usage in usages)
    return Cost(time.perf_counter() - began, after - before)


def overhead(jobs: int, workers: Workers) -> tuple[float, float]:
    """Seconds until the first job that does nothing is done, and seconds for each further one."""
    began, landed = time.perf_counter(), []
    with tempfile.TemporaryDirectory() as folder:
        batch = Batch(Path(folder), nothing, nothing)
        landed = [time.perf_counter() - began for _ in run_parallel(batch, range(jobs), workers)]
    return landed[0], (landed[-1] - landed[0]) / (jobs - 1)


def overhead_table(jobs: int) -> pd.DataFrame:
    """The overhead of each way to run jobs."""
    costs = {}
    for count in (1, 2):
        costs[f"{count} processes"] = overhead(jobs, count)
        with dask_workers(count) as address:
            costs[f"{count} workers of dask"] = overhead(jobs, address)
    return pd.DataFrame(
        {"jobs without work": name, "first, s": f"{first:.2f}", "each further, s": f"{each:.3f}"}
        for name, (first, each) in costs.items()
    )


def scaling_table(folder: Path, trials: int) -> tuple[pd.DataFrame, float]:
    """What measuring clips costs by one process and by two, and the ratio of their processor times."""
    render_dataset(folder / "data", size=(640, 360), trials=trials, phenomena=["pendulum"], duration_s=2.0)
    measure(folder / "data", folder / "first", conditions=Conditions(trials=1), workers=1)  # compiles what is not yet
    costs = {}
    for count in (1, 2):
        target = folder / f"processes-{count}"
        costs[f"{count} processes"] = timed(
            lambda target=target, count=count: measure(folder / "data", target, workers=count)
        )
    for count in (1, 2):
        target = folder / f"dask-{count}"
        costs[f"{count} workers of dask"] = timed(
            lambda target=target, count=count: _on_dask(folder / "data", target, count)
        )
    table = [
        {
            "clips measured by": name,
            "clock, s": f"{cost.wall_s:.1f}",
            "processors, s": f"{cost.processor_s:.1f}",
        }
        for name, cost in costs.items()
    ]
    return pd.DataFrame(table), costs["2 processes"].processor_s / costs["1 processes"].processor_s


def _on_dask(data: Path, target: Path, count: int) -> None:
    with dask_workers(count) as address:
        measure(data, target, workers=address)


def published_clips() -> list[tuple[str, int]]:
    """Phenomenon and frames of each clip of the published data set, in the order in which they are measured."""
    shown = {folder: name for folder, (name, described) in benchmark_classes().items() if described.dataset == "iris"}
    scenes = [scene for scene in SCENES.values() if scene.folder in shown]
    clips = [(scene.name, round(scene.duration_s * FPS)) for scene in scenes for _ in scene.settings]
    return clips * TRIALS


def makespan(seconds: Iterable[float], workers: int) -> float:
    """Seconds until all jobs are done, each begun by the first free worker in their order."""
    free = [0.0] * workers
    for duration in seconds:
        heapq.heapreplace(free, free[0] + duration)
    return max(free)


def paper_table(each_s: float, ratio: float) -> pd.DataFrame:
    """Hours of the whole benchmark, and of a hundred of it, on several numbers of machines.

    Parameters
    ----------
    each_s
        Overhead of a clip, s.
    ratio
        By how much the processor time of a clip grows beside another.
    """
    rows = []
    for copies in COPIES:
        clips = published_clips() * copies
        seconds = [
            each_s + ratio * frames * (PENDULUM_MS if name == "pendulum" else OTHER_MS) / 1e3 for name, frames in clips
        ]
        hours = {machines: makespan(seconds, machines * PROCESSORS) / 3600 for machines in MACHINES}
        rows.append(
            {
                "clips": len(clips),
                "frames": sum(frames for _, frames in clips),
                "core hours": f"{sum(seconds) / 3600:.1f}",
            }
            | {f"{machines} machine{'s' * (machines > 1)}, h": f"{time_h:.2f}" for machines, time_h in hours.items()}
        )
    return pd.DataFrame(rows)


def print_overhead(jobs: int) -> None:
    """Print the table of jobs without work."""
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}\n\n{pages.markdown(overhead_table(jobs))}")


def print_clips(trials: int) -> None:
    """Print the table of clips by one process and by two."""
    with tempfile.TemporaryDirectory() as folder:
        table, ratio = scaling_table(Path(folder), trials)
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}\n\n{pages.markdown(table)}")
    print(f"\nProcessor time, two processes over one: {ratio:.2f}.")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=48, help="jobs without work")
    parser.add_argument("--trials", type=int, default=2, help="clips of each of three settings")
    parser.add_argument("--each", type=float, default=0.5, help="overhead of a clip on paper, s")
    parser.add_argument("--ratio", type=float, default=0.97, help="ratio of processor times on paper")
    parser.add_argument("--only", choices=("overhead", "clips", "paper"))
    pages.add_option(parser)
    options = parser.parse_args(arguments)
    parts: dict[str, Callable[[], None]] = {
        "overhead": lambda: print_overhead(options.jobs),
        "clips": lambda: print_clips(options.trials),
        "paper": lambda: print(pages.markdown(paper_table(options.each, options.ratio))),
    }
    for name in (options.only,) if options.only else parts:
        with pages.table(f"scaling-{name}", options.write_docs):
            parts[name]()


if __name__ == "__main__":
    main()
