"""Speed and memory of tracking each class of clips, relative to a bare OpenCV reading loop over the same file.

``python -m validation.speed --class pendulum dropping-ball [--size 3840x2160] [--seconds 5]`` renders a clip of each
class at 60 frames a second and 45 Mbit/s (at 4K), tracks it by the whole command (from starting Python to the written
table, the tracker that the phenomenon names) and reads it with OpenCV, in turns, each in a separate process; the
fastest run of each counts. "After the start" is the rate by which the time grows where the clip is repeated three
times, by the clock and in processor time, which is less disturbed by what else a machine does.

``python -m validation.speed --only opencv track mog2 trackpy [--clip CLIP.mp4]`` compares other programs on a pendulum;
``--repeat 15`` runs on the clip so many times over: its memory must not grow with that.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import cast

from validation import pages

# imports nothing of the project: a process starts with the peak memory of its parent
PROGRAM = Path(sys.executable).parent / "iris-sysid"

BODIES = {  # of each class: phenomena with several bodies
    "pendulum": 1,
    "falling-ball": 1,
    "dropping-ball": 1,
    "sliding-cone": 1,
    "rotating-cone": 1,
    "led": 1,
    "torricelli": 1,
    "two-moving-pendulums": 2,
    "two-moving-pendulum-one-static": 2,
    "hitting-cones": 16,
}
REPEATED = 3  # times, to tell the rate after the start

SLOW_FRAMES = {"mog2": 10, "trackpy": 1}  # frames for the slow rows


@dataclass(frozen=True)
class Cost:
    """Cost of one run: frames, s of wall clock and of processor, and the peak of memory in MB."""

    frames: int
    wall_s: float
    cpu_s: float
    peak_mb: float


def read_with_opencv(clip: str) -> int:
    """Read every frame, as the shortest program does."""
    import cv2

    capture, frames = cv2.VideoCapture(clip), 0
    while capture.read()[0]:
        frames += 1
    return frames


def mog2_at_full_size(clip: str) -> int:
    """Subtract the background of a few frames at full size."""
    import cv2

    capture, subtractor = cv2.VideoCapture(clip), cv2.createBackgroundSubtractorMOG2(detectShadows=False)
    for _ in range(SLOW_FRAMES["mog2"]):
        subtractor.apply(capture.read()[1])
    return SLOW_FRAMES["mog2"]


def locate_with_trackpy(clip: str) -> int:
    """Locate features of the ball's size in a few frames."""
    import trackpy

    from iris_sysid.video.reader import open_video

    for frame in islice(open_video(clip).frames(), SLOW_FRAMES["trackpy"]):
        trackpy.locate(frame.luma, 2 * (frame.luma.shape[0] // 20) + 1)
    return SLOW_FRAMES["trackpy"]


ROWS: dict[str, Callable[[str], int]] = {
    "opencv": read_with_opencv,
    "mog2": mog2_at_full_size,
    "trackpy": locate_with_trackpy,
}
TITLES = {
    "opencv": "`cv2.VideoCapture.read()` alone",
    "track": "`iris-sysid track`, the whole command",
    "mog2": f"MOG2 at full size ({SLOW_FRAMES['mog2']} frames)",
    "trackpy": f"`trackpy.locate` ({SLOW_FRAMES['trackpy']} frames)",
}


def run_row(name: str, clip: str) -> None:
    """Run one row in this process and print its cost as JSON."""
    wall, cpu = time.perf_counter(), time.process_time()
    frames = ROWS[name](clip)
    cost = [frames, time.perf_counter() - wall, time.process_time() - cpu, _peak_mb(resource.RUSAGE_SELF)]
    print(json.dumps(cost))


def _peak_mb(usage_of: int) -> float:
    return resource.getrusage(usage_of).ru_maxrss / 1024


def cost_of(name: str, clip: str, phenomenon: str = "pendulum") -> Cost | None:
    """Cost of one row in its own process; None where a package it needs is not installed."""
    if name == "track":
        return _cost_of_track(clip, phenomenon)
    command = [sys.executable, "-m", "validation.speed", "--row", name, "--clip", clip]
    done = subprocess.run(command, capture_output=True, text=True)
    return Cost(*json.loads(done.stdout)) if done.returncode == 0 else None


def _cost_of_track(clip: str, phenomenon: str) -> Cost:
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "track.csv"
        start = time.perf_counter()
        kind = ["--phenomenon", phenomenon, "--bodies", str(BODIES[phenomenon])]
        process = subprocess.Popen([PROGRAM, "track", clip, *kind, "-o", table], stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - start
        if status:
            raise SystemExit("iris-sysid track failed")
        frames = (len(table.read_text().splitlines()) - 1) // BODIES[phenomenon]
    return Cost(frames, wall, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)


def write_repeated(clip: str, times: int, path: str) -> None:
    """Write the packets of a clip that begins with a key frame several times into one file, without coding it again."""
    import av

    with av.open(path, "w") as target:
        copy, begin = None, 0
        for _ in range(times):
            with av.open(clip) as source:
                stream = source.streams.video[0]
                copy = copy or target.add_stream_from_template(stream)
                for packet in source.demux(stream):
                    if packet.dts is None:
                        continue
                    packet.dts, packet.pts = packet.dts + begin, packet.pts + begin
                    end = packet.dts + packet.duration
                    packet.stream = copy
                    target.mux(packet)
                begin = end


def table(clip: str, turns: int, rows: Sequence[str]) -> None:
    """Print the rows as Markdown, each relative to OpenCV's reading where that is among them."""
    costs: dict[str, list[Cost]] = {name: [] for name in TITLES if name in rows}
    for _ in range(turns):
        for name, measured in costs.items():
            cost = cost_of(name, clip)
            measured += [] if cost is None else [cost]
    best = {
        name: min(measured, key=lambda cost: cost.wall_s / cost.frames) for name, measured in costs.items() if measured
    }
    print("| | frames/s | processor time a frame, ms | relative to reading | peak memory, MB |\n|---|---|---|---|---|")
    seconds = {name: cost.wall_s / cost.frames for name, cost in best.items()}
    for name in costs:
        if name not in best:
            print(f"| {TITLES[name]} | not installed | | | |")
            continue
        cpu, peak = 1e3 * best[name].cpu_s / best[name].frames, best[name].peak_mb
        relative = f"{seconds['opencv'] / seconds[name]:.2f}" if "opencv" in seconds else ""
        print(f"| {TITLES[name]} | {1 / seconds[name]:.1f} | {cpu:.1f} | {relative} | {peak:.0f} |", flush=True)


@dataclass(frozen=True)
class ClassCost:
    """Costs of one class: bare reading, the whole command, and the command on the clip three times over."""

    reading: Cost
    command: Cost
    repeated: Cost | None

    def row(self, name: str) -> str:
        """The row of the table."""
        read, track = (cost.wall_s / cost.frames for cost in (self.reading, self.command))
        after = cpu_after = ""
        if self.repeated is not None:
            more = self.repeated.frames - self.command.frames
            after = f"{more / max(self.repeated.wall_s - self.command.wall_s, 1e-3):.0f}"
            cpu_after = f"{1e3 * (self.repeated.cpu_s - self.command.cpu_s) / more:.1f}"
        cpu = [f"{1e3 * cost.cpu_s / cost.frames:.1f}" for cost in (self.reading, self.command)]
        numbers = [f"{1 / read:.0f}", f"{1 / track:.1f}", after, f"{read / track:.3f}", *cpu, cpu_after]
        return f"| {name} | {BODIES[name]} | {' | '.join(numbers)} | {self.command.peak_mb:.0f} |"


def class_cost(phenomenon: str, clip: str, longer: str | None, turns: int) -> ClassCost:
    """The fastest of some turns on a clip, and on the same clip repeated where that is given."""

    def fastest(name: str, path: str) -> Callable[[], Cost]:
        return lambda: cast("Cost", cost_of(name, path, phenomenon))

    rows = [fastest("opencv", clip), fastest("track", clip), *([fastest("track", longer)] if longer else [])]
    costs = [[measure() for measure in rows] for _ in range(turns)]
    best = [min(runs, key=lambda cost: cost.wall_s) for runs in zip(*costs, strict=True)]
    return ClassCost(best[0], best[1], best[2] if longer else None)


def class_table(options: argparse.Namespace, folder: Path) -> None:
    """Render a clip of each class, and print a row each as it is measured."""
    print(f"{options.size}, {options.seconds:g} s, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}\n")
    titles = "class | bodies | reading, frames/s | command, frames/s | after the start, frames/s | relative to reading"
    print(f"| {titles} | reading, ms of processor a frame | command, ms | after the start, ms | peak memory, MB |")
    print("|---" + "|---:" * 9 + "|", flush=True)
    for phenomenon in options.classes:
        clip, longer = rendered(phenomenon, options, folder), None
        if not options.no_start:
            longer = str(folder / f"{phenomenon}-repeated.mp4")
            repeat(clip, REPEATED, longer)
        print(class_cost(phenomenon, clip, longer, options.turns).row(phenomenon), flush=True)


def rendered(phenomenon: str, options: argparse.Namespace, folder: Path) -> str:
    """A clip of a phenomenon."""
    clip = str(folder / f"{phenomenon}.mp4")
    film = ["--size", options.size, "--fps", "60", "--seconds", str(options.seconds), "--seed", str(options.seed)]
    subprocess.run(
        [PROGRAM, "render", "--phenomenon", phenomenon, *film, "-o", clip], check=True, stdout=subprocess.DEVNULL
    )
    return clip


def repeat(clip: str, times: int, path: str) -> None:
    """Write a clip repeated, in another process, which keeps this one small."""
    with ProcessPoolExecutor(1) as pool:
        pool.submit(write_repeated, clip, times, path).result()


def main() -> None:
    """Render the clips and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--class", dest="classes", nargs="+", choices=list(BODIES), help="classes to run")
    parser.add_argument("--no-start", action="store_true", help="leave out the rate after the start")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the clip")
    parser.add_argument("--size", default="3840x2160", help="WIDTHxHEIGHT in px")
    parser.add_argument("--seed", type=int, default=0, help="of the rendered clips")
    parser.add_argument("--clip", help="a clip that is there already, instead of rendering one")
    parser.add_argument("--turns", type=int, default=2, help="runs of each row, in turns; the fastest counts")
    parser.add_argument("--only", choices=list(TITLES), nargs="+", default=list(TITLES), help="rows to run")
    parser.add_argument("--repeat", type=int, default=1, help="run on the clip so many times over")
    parser.add_argument("--row", choices=list(ROWS), help=argparse.SUPPRESS)
    pages.add_option(parser)
    options = parser.parse_args()
    if options.row:
        run_row(options.row, options.clip)
        return
    with tempfile.TemporaryDirectory() as folder:
        if options.classes:
            with pages.table("speed-classes", options.write_docs):
                class_table(options, Path(folder))
            return
        clip = options.clip or rendered("pendulum", options, Path(folder))
        if options.repeat > 1:
            longer = str(Path(folder) / "repeated.mp4")
            repeat(clip, options.repeat, longer)
            clip = longer
        with pages.table("speed", options.write_docs):
            print(
                f"{Path(clip).name}: {Path(clip).stat().st_size / 1e6:.1f} MB, {os.cpu_count()} processors\n",
                flush=True,
            )
            table(clip, options.turns, options.only)


if __name__ == "__main__":
    main()
