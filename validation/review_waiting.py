"""How long a person waits for a review: the first frame, a step through the frames, the fit after an edit.

``python -m validation.review_waiting`` writes three clips with the track of a pendulum (1080p, 4K, and 30 minutes of
54,000 frames), starts ``iris-sysid review`` on each in a separate process and asks for what the page asks for. What
the browser itself takes is not in it. Each cell is seconds of the clock, then of the processor in brackets: these are
less disturbed by what else a machine does. The fit of a long clip is a preview first, and that of all frames runs in a
process of its own: memory is that of both.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from threading import Thread
from typing import Any

import av
import numpy as np
from scipy.integrate import solve_ivp

from iris_sysid.calibration.pixel_scale import scale
from iris_sysid.io.csv_write import write_track
from iris_sysid.pipeline.one_clip import from_source
from iris_sysid.registry import PHENOMENA
from iris_sysid.review.request import ReviewRequest
from iris_sysid.types import Track
from validation import pages

RATE_HZ, LOOP = 30, 60  # frames a second; frames that are encoded, then repeated
LENGTH_M, SIGMA_PX = 0.5, 0.1
STEPS, JUMPS, EDITS = 60, 10, 5
SHOWN_PX = 1200  # width of the page's stage
ADDRESS = re.compile(r"(http://127\.0\.0\.1:\d+)/\?token=(\S+)")


@dataclass(frozen=True, slots=True)
class Case:
    """A clip of that size in px, of so many frames."""

    name: str
    size: tuple[int, int]
    frames: int


CASES = (
    Case("1080p, 10 s", (1920, 1080), 300),
    Case("4K, 10 s", (3840, 2160), 300),
    Case("720p, 30 minutes", (1280, 720), 54_000),
)


@dataclass(frozen=True, slots=True)
class Cost:
    """Seconds of the clock, and of the server's processor."""

    wall_s: float
    processor_s: float

    def __str__(self) -> str:
        return f"{self.wall_s:.2g} ({self.processor_s:.2g})"


class Server:
    """A review in a separate process, asked as the page asks."""

    def __init__(self, folder: Path) -> None:
        self.began = time.perf_counter()
        command = [sys.executable, "-m", "iris_sysid", "review", str(folder), "--no-browser"]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, cwd=pages.ROOT)
        line = self.process.stderr.readline() if self.process.stderr else ""
        found = ADDRESS.search(line)
        if found is None:
            raise RuntimeError(f"the review of {folder} did not start: {line}")
        self.address, self.token = found.groups()
        self.of_fit_mb = 0.0
        Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        """Keep the largest memory of a process that fits, which is gone when its fit is done."""
        tasks = Path(f"/proc/{self.process.pid}/task")
        while self.process.poll() is None:
            with suppress(OSError, IndexError):  # a process that has just ended states no memory
                children = [pid for file in tasks.glob("*/children") for pid in file.read_text("utf-8").split()]
                self.of_fit_mb = max(self.of_fit_mb, sum(map(_peak_mb, children)))
            time.sleep(0.1)

    def ask(self, path: str, content: Any = None) -> bytes:
        """The answer to a request, with JSON content where it changes something."""
        headers = {"x-review-token": self.token, "content-type": "application/json"}
        data = None if content is None else json.dumps(content).encode()
        with urllib.request.urlopen(urllib.request.Request(f"{self.address}{path}", data, headers)) as answer:
            return bytes(answer.read())

    def timed(self, path: str, content: Any = None) -> Cost:
        """What a request costs."""
        wall, processor = time.perf_counter(), self.processor_s
        self.ask(path, content)
        return Cost(time.perf_counter() - wall, self.processor_s - processor)

    @property
    def processor_s(self) -> float:
        """Processor time so far, with that of fits in separate processes that have ended."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text("utf-8").rpartition(")")[2].split()
        return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")

    @property
    def peak_mb(self) -> float:
        """Largest memory so far, with that of the process that fits all frames."""
        return _peak_mb(str(self.process.pid)) + self.of_fit_mb

    def close(self) -> None:
        """End it."""
        self.process.terminate()
        self.process.communicate(timeout=30)


def _peak_mb(pid: str) -> float:
    return int(Path(f"/proc/{pid}/status").read_text("utf-8").partition("VmHWM:")[2].split()[0]) / 1024


def prepare(case: Case, folder: Path) -> Path:
    """Write the clip of a case and a folder with its track; what is there already stays."""
    clip, result = folder / f"{case.size[1]}-{case.frames}.mp4", folder / f"{case.size[1]}-{case.frames}"
    if not clip.exists():
        _write_clip(case, clip)
    if not (result / "track.csv").exists():
        result.mkdir(exist_ok=True)
        request = ReviewRequest(PHENOMENA["pendulum"], calibration=scale(_px_per_metre(case), 1.0))
        write_track(from_source([_swing(case)], clip, request.recorded()), result / "track.csv")
    return result


def _write_clip(case: Case, path: Path) -> None:
    """A few textured frames in one group of pictures, repeated without coding them again."""
    width, height = case.size
    rng = np.random.default_rng(0)
    wall = np.kron(rng.integers(60, 190, (height // 8 + 1, width // 8 + 9)), np.ones((8, 8))).astype(np.uint8)
    once = path.with_suffix(".once.mp4")
    with av.open(str(once), "w") as file:
        stream = file.add_stream("libx264", rate=RATE_HZ, options={"preset": "ultrafast", "bf": "0", "g": str(LOOP)})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for k in range(LOOP):
            moved = np.full((height * 3 // 2, width), 128, np.uint8)
            moved[:height] = wall[:height, k : k + width]
            file.mux(stream.encode(av.VideoFrame.from_ndarray(moved, "yuv420p")))
        file.mux(stream.encode())
    with av.open(str(once)) as source, av.open(str(path), "w") as file:
        stream = file.add_stream_from_template(source.streams.video[0])
        packets = [packet for packet in source.demux(video=0) if packet.dts is not None]
        coded = [(bytes(packet), packet.is_keyframe) for packet in packets]
        for number in range(case.frames):
            content, key = coded[number % LOOP]
            packet = av.Packet(content)
            packet.stream, packet.time_base, packet.is_keyframe = stream, Fraction(1, RATE_HZ), key
            packet.pts = packet.dts = number
            packet.duration = 1
            file.mux(packet)
    once.unlink()


def _px_per_metre(case: Case) -> float:
    return case.size[1] / 1.2


def _swing(case: Case) -> Track:
    """A pendulum below the middle of the upper edge, located with an error."""
    t_s = np.arange(case.frames) / RATE_HZ
    solved = solve_ivp(
        lambda t, y: [y[1], -0.002 * y[1] - 9.80665 / LENGTH_M * np.sin(y[0])],
        (0.0, float(t_s[-1])),
        [0.4, 0.0],
        t_eval=t_s,
        rtol=1e-8,
        method="DOP853",
    )
    arm = LENGTH_M * _px_per_metre(case) * np.column_stack([np.sin(solved.y[0]), np.cos(solved.y[0])])
    pivot = np.array([case.size[0] / 2, case.size[1] / 4])
    xy = pivot + arm + np.random.default_rng(1).normal(0, SIGMA_PX, arm.shape)
    return Track(
        t_s=t_s,
        xy_px=xy,
        sigma_px=np.full(xy.shape, SIGMA_PX),
        valid=np.ones(t_s.size, np.bool_),
        frame=np.arange(t_s.size),
        radius_px=np.full(t_s.size, case.size[1] / 60),
    )


def measured(case: Case, folder: Path) -> list[str]:
    """The row of a case: first frame, steps, jumps, fit after an edit, whole fit, and memory."""
    server = Server(prepare(case, folder))
    try:
        start = time.perf_counter() - server.began, server.processor_s
        for path in ("/", "/static/review.js", "/api/clip", "/api/state", _frame(0)):
            server.ask(path)
        first = Cost(time.perf_counter() - server.began, server.processor_s)
        _fitted(server, 1, whole=True)
        steps = [server.timed(_frame(number)) for number in range(1, STEPS)]
        far = np.random.default_rng(2).integers(0, case.frames, JUMPS)
        jumps = [server.timed(_frame(int(number))) for number in far]
        fits = [_edited(server, frame, whole=False) for frame in range(10, 10 + EDITS)]
        _fitted(server, 1 + EDITS, whole=True)  # the last of them, before the clock runs again
        whole = _edited(server, 100, whole=True)
        return [
            case.name,
            str(Cost(*start)),
            str(first),
            *(str(_median(costs)) for costs in (steps, jumps, fits)),
            str(whole),
            f"{server.peak_mb:.0f}",
        ]
    finally:
        server.close()


def _frame(number: int) -> str:
    return f"/frame/{number}.jpg?width={SHOWN_PX}"


def _edited(server: Server, frame: int, *, whole: bool) -> Cost:
    """From an edit to the fit that follows it; of a long clip its preview, or the whole."""
    wall, processor = time.perf_counter(), server.processor_s
    version = json.loads(server.ask("/api/progress"))["version"]
    edit = {"kind": "delete", "body": "1", "first": frame, "last": frame}
    version = json.loads(server.ask("/api/edit", {"version": version, "edit": edit}))["version"]
    _fitted(server, version, whole=whole)
    return Cost(time.perf_counter() - wall, server.processor_s - processor)


def _fitted(server: Server, version: int, *, whole: bool) -> None:
    while json.loads(server.ask(f"/api/fit?version={version}{'&whole' if whole else ''}")).get("pending"):
        pass


def _median(costs: Sequence[Cost]) -> Cost:
    return Cost(float(np.median([one.wall_s for one in costs])), float(np.median([one.processor_s for one in costs])))


def lines(folder: Path, only: str) -> Iterator[str]:
    """The table, a row a clip."""
    yield f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}"
    yield ""
    titles = ("clip", "started", "first frame", "step", "jump", "fit after an edit", "whole fit", "memory, MB")
    yield f"| {' | '.join(titles)} |"
    yield "|---" * len(titles) + "|"
    for case in CASES:
        if only in case.name:
            yield f"| {' | '.join(measured(case, folder))} |"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, help="where the clips are kept; default: a temporary one")
    parser.add_argument("--only", default="", help="clips whose name contains this")
    pages.add_option(parser)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary, pages.table("review-waiting", options.write_docs):
        folder = Path(temporary) if options.folder is None else options.folder.resolve()
        for line in lines(folder, options.only):
            print(line, flush=True)


if __name__ == "__main__":
    main()
