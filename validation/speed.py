"""Speed and memory of tracking a clip, compared with OpenCV reading, MOG2 and trackpy.

``python -m validation.speed [--seconds 10] [--size 3840x2160] [--clip CLIP.mp4]`` renders a pendulum at 60 frames a
second and 45 Mbit/s, then runs each row in a process of its own, in turns, and keeps the fastest run.
The row "track" is the whole command, from starting Python to the written table; the others leave out their start.
``--only track`` runs some rows alone, ``--repeat 15`` the clip so many times over: its memory must not grow with that.
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

from validation import pages

# imports nothing of the project: a process starts with the peak memory of its parent
PROGRAM = Path(sys.executable).parent / "iris-sysid"

FEW = {"mog2": 10, "trackpy": 1}  # frames for the slow rows


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
    for _ in range(FEW["mog2"]):
        subtractor.apply(capture.read()[1])
    return FEW["mog2"]


def locate_with_trackpy(clip: str) -> int:
    """Locate features of the ball's size in a few frames."""
    import trackpy

    from iris_sysid.video.reader import open_video

    for frame in islice(open_video(clip).frames(), FEW["trackpy"]):
        trackpy.locate(frame.luma, 2 * (frame.luma.shape[0] // 20) + 1)
    return FEW["trackpy"]


ROWS: dict[str, Callable[[str], int]] = {
    "opencv": read_with_opencv,
    "mog2": mog2_at_full_size,
    "trackpy": locate_with_trackpy,
}
TITLES = {
    "opencv": "`cv2.VideoCapture.read()` alone",
    "track": "`iris-sysid track`, the whole command",
    "mog2": f"MOG2 at full size ({FEW['mog2']} frames)",
    "trackpy": f"`trackpy.locate` ({FEW['trackpy']} frames)",
}


def run_row(name: str, clip: str) -> None:
    """Run one row in this process and print its cost as JSON."""
    wall, cpu = time.perf_counter(), time.process_time()
    frames = ROWS[name](clip)
    cost = [frames, time.perf_counter() - wall, time.process_time() - cpu, _peak_mb(resource.RUSAGE_SELF)]
    print(json.dumps(cost))


def _peak_mb(usage_of: int) -> float:
    return resource.getrusage(usage_of).ru_maxrss / 1024


def cost_of(name: str, clip: str) -> Cost | None:
    """Cost of one row in its own process; None where a package it needs is not installed."""
    if name == "track":
        return _cost_of_track(clip)
    command = [sys.executable, "-m", "validation.speed", "--row", name, "--clip", clip]
    done = subprocess.run(command, capture_output=True, text=True)
    return Cost(*json.loads(done.stdout)) if done.returncode == 0 else None


def _cost_of_track(clip: str) -> Cost:
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "track.csv"
        start = time.perf_counter()
        process = subprocess.Popen([PROGRAM, "track", clip, "-o", table], stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - start
        if status:
            raise SystemExit("iris-sysid track failed")
        frames = len(table.read_text().splitlines()) - 1
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


def main() -> None:
    """Render the clip and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the clip")
    parser.add_argument("--size", default="3840x2160", help="WIDTHxHEIGHT in px")
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
        clip = options.clip or str(Path(folder) / "pendulum.mp4")
        if not options.clip:
            film = ["--size", options.size, "--fps", "60", "--seconds", str(options.seconds)]
            subprocess.run([PROGRAM, "render", "--phenomenon", "pendulum", *film, "-o", clip], check=True)
        if options.repeat > 1:
            longer = str(Path(folder) / "repeated.mp4")
            with ProcessPoolExecutor(1) as pool:
                pool.submit(write_repeated, clip, options.repeat, longer).result()
            clip = longer
        with pages.table("speed", options.write_docs):
            print(
                f"{Path(clip).name}: {Path(clip).stat().st_size / 1e6:.1f} MB, {os.cpu_count()} processors\n",
                flush=True,
            )
            table(clip, options.turns, options.only)


if __name__ == "__main__":
    main()
