"""What breaks the program: damaged input, kills, full disks, clocks, two at once, memory.

Every command runs in a separate process with a limit of time. ``--short`` is what the tests run.
"""

from __future__ import annotations

import argparse
import os
import random
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
import pandas as pd

from iris_sysid.errors import VideoError
from iris_sysid.video.reader import open_video
from validation import pages

COMMAND = [str(Path(sys.executable).with_name("iris-sysid"))]
LIMIT_S = 300.0  # of one command: beyond it is a hang
FUTURE_S = 10 * 365 * 86400.0
FRAMES = 30
CLIPS = {
    "mp4": "libx264", "mov": "libx264", "mkv": "libx264", "webm": "libvpx", "avi": "mpeg4", "flv": "libx264",
    "mpegts": "libx264", "mpeg": "mpeg2video", "ogg": "libvpx", "gif": "gif",
}  # fmt: skip
PARTS = ("readers", "clips", "commands")
READER = re.compile(r"^(\S+) \| ([0-9]+) \| (.*)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Step:
    """A command on the input in the folder ``work``."""

    name: str
    work: Path

    def command(self, out: Path) -> list[str]:
        """The command line that writes into a folder."""
        return [*COMMAND, *(word.format(work=self.work, out=out) for word in COMMANDS[self.name])]


SMALL = ("--size", "160x120", "--seconds", "2")
ONE_CLASS = ("--classes", "Pendulum", "--trials", "1", *SMALL)
COMMANDS = {
    "fit": ("fit", "{work}/swing.csv", "--model", "linear-pendulum", "-o", "{out}/fit.json", "--force"),
    "run": (
        *("run", "{work}/clip.mp4", "--phenomenon", "pendulum", "--scale", "200px=1m", "-o", "{out}/run", "--force"),
    ),
    "track": ("track", "{work}/clip.mp4", "--phenomenon", "pendulum", "-o", "{out}/track.csv", "--force"),
    "calibrate": (
        *("calibrate", "{work}/board.png", "--board", "9x6", "--square", "25mm", "--one-image"),
        *("-o", "{out}/calibration.json", "--force"),
    ),
    "render": ("render", "--dataset", "{out}/dataset", *ONE_CLASS),
    "gt": ("gt", "{work}/dataset", "-o", "{out}/parameters.json"),
    "benchmark": ("benchmark", "{work}/dataset", "-o", "{out}/benchmark"),
}
SAME_INPUT = {"track": "run", "benchmark": "gt"}
SQUARE_PX, BOARD = 90, (7, 10)  # of the picture of a board
INPUTS = {  # of the commands that need more than a table
    "run": ("render", "--phenomenon", "pendulum", *SMALL, "-o", "{work}/clip.mp4"),
    "gt": ("render", "--dataset", "{work}/dataset", *ONE_CLASS),
}


def make_input(work: Path, commands: Sequence[str]) -> None:
    """A table of a swing, a picture of a board, and where they are needed a rendered clip and data set."""
    t_s = np.arange(200) / 50
    noise = np.random.default_rng(1).normal(0, 1e-3, t_s.size)
    theta = 0.2 * np.exp(-0.05 * t_s) * np.cos(4 * t_s) + noise
    rows = "".join(f"{t:.3f},{angle:.6f}\n" for t, angle in zip(t_s, theta, strict=True))
    (work / "swing.csv").write_text(f"t_s,theta_rad\n{rows}")
    white = np.indices(BOARD).sum(axis=0) % 2 * 200 + 30
    board = np.pad(np.kron(white, np.ones((SQUARE_PX, SQUARE_PX))), SQUARE_PX, constant_values=230)
    cv2.imwrite(str(work / "board.png"), cv2.GaussianBlur(board.astype(np.uint8), (5, 5), 1.0))
    for name in dict.fromkeys(SAME_INPUT.get(name, name) for name in commands):
        if name in INPUTS:
            words = [word.format(work=work) for word in INPUTS[name]]
            subprocess.run([*COMMAND, *words], check=True, capture_output=True)


# --------------------------------------------------------------------------- readers and clips


def readers(seconds: float) -> pd.DataFrame:
    """Inputs tried of each reader, and whether anything but results and stated errors came out."""
    command = [sys.executable, "-m", "tests.fuzz", "--engine", "hypothesis", "--seconds", str(seconds)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=pages.ROOT)
    rows = [
        {
            "reader": reader,
            "inputs": int(inputs),
            "not our errors": int(outcome.startswith("an error")),
            "crashes": int(outcome.startswith("a crash")),
            "hangs": int(outcome.startswith("a hang")),
        }
        for reader, inputs, outcome in READER.findall(done.stdout)
        if reader != "---"
    ]
    return pd.DataFrame(rows)


def clip(path: Path, kind: str) -> Path:
    """A clip of a disc that moves, in a container of that kind."""
    with av.open(str(path), "w", format={"mkv": "matroska"}.get(kind, kind)) as container:
        stream = container.add_stream(CLIPS[kind], rate=25)
        stream.width, stream.height = 96, 64
        stream.pix_fmt = "rgb8" if kind == "gif" else "yuv420p"
        for k in range(FRAMES):
            image = np.full((64, 96, 3), 60, np.uint8)
            cv2.circle(image, (10 + 2 * k, 32), 6, (230, 230, 230), -1)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    return path


def what_came(path: Path) -> str:
    """What the reader makes of a damaged clip; ``said``: by a warning, or as not complete."""
    try:
        video = open_video(path, fps=25.0)
        count = sum(1 for _ in video.frames())
    except VideoError:
        return "refused"
    except Exception:
        return "not ours"
    if video.warning or not video.complete:
        return "said"
    return "whole" if count == FRAMES else "silent loss"


def damaged_clips(work: Path, each: int) -> pd.DataFrame:
    """Cuts and flipped bits of each kind of container: what the reader says of them."""
    rng = random.Random(0)
    rows = []
    for kind in CLIPS:
        data = clip(work / f"clip.{kind}", kind).read_bytes()
        cuts = [data[: rng.randrange(1, len(data))] for _ in range(each)]
        flips = [_flipped(data, rng.randrange(8 * len(data))) for _ in range(each)]
        for harm, damaged in (("cut", cuts), ("a bit flipped", flips)):
            came = [what_came(_written(work / f"damaged.{kind}", content)) for content in damaged]
            kinds = ("refused", "said", "whole", "silent loss", "not ours")
            rows.append({"clip": kind, "harm": harm, "tried": each, **{name: came.count(name) for name in kinds}})
    return pd.DataFrame(rows)


def _flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


# --------------------------------------------------------------------------- commands


@dataclass(frozen=True, slots=True)
class Ended:
    """How a command ended: exit status (None: a hang), last line of stderr, seconds, peak memory in MB."""

    status: int | None
    said: str
    seconds: float
    peak_mb: float


def ended(command: Sequence[str], *, kill_after_s: float | None = None, file_limit: int | None = None) -> Ended:
    """Run a command to its end, to its kill, or to the limit of time; ``file_limit`` bytes is the largest file."""

    def limit() -> None:
        if file_limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))

    start = time.monotonic()
    with tempfile.TemporaryFile() as file:
        # the limit would hold for that file too: what a limited command says goes through a pipe, a line or two
        errors = file if file_limit is None else subprocess.PIPE
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=errors, preexec_fn=limit, cwd=pages.ROOT, start_new_session=True
        )
        end = start + (LIMIT_S if kill_after_s is None else kill_after_s)
        status, used = _waited(process.pid, end)
        process.returncode = -9 if status is None else status  # waited for here
        file.seek(0)
        with process.stderr or file as written:
            said = written.read().decode(errors="replace").strip().splitlines()[-1:]
    return Ended(status, "".join(said), time.monotonic() - start, used)


def _waited(process: int, end: float) -> tuple[int | None, float]:
    """Exit status and peak memory in MB; after the end the process group is killed: None."""
    while True:
        done, status, usage = os.wait4(process, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), usage.ru_maxrss / 1e3
        if time.monotonic() > end:
            os.killpg(process, 9)
            os.wait4(process, 0)
            return None, 0.0
        time.sleep(0.01)


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a folder; temporary ones, which a later run removes, apart."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.startswith(".iris-"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def same_bytes(step: Step, work: Path, disturb: Callable[[list[str], Path], None]) -> bool:
    """Whether a command that was disturbed, and then run to its end, leaves the bytes of one that was not."""
    calm, disturbed = work / f"{step.name}-calm", work / f"{step.name}-disturbed"
    if not calm.exists():
        calm.mkdir()
        ended(step.command(calm))
    shutil.rmtree(disturbed, ignore_errors=True)
    disturbed.mkdir()
    disturb(step.command(disturbed), disturbed)
    last = ended(step.command(disturbed))
    return last.status in (0, 1) and content(disturbed) == content(calm)


def disturbances(work: Path, commands: Sequence[str], kills: int) -> pd.DataFrame:
    """Of each command: killed at random times, two at once, a full disk, files from the future, memory."""
    rng = random.Random(0)
    rows = []
    make_input(work, commands)
    for step in (Step(name, work) for name in commands):
        (work / f"{step.name}-calm").mkdir()
        calm = ended(step.command(work / f"{step.name}-calm"))

        def killed(command: list[str], _: Path, calm: Ended = calm) -> None:
            ended(command, kill_after_s=rng.uniform(0.05, 1.0) * calm.seconds)

        def twice(command: list[str], _: Path) -> None:
            others = [subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL, cwd=pages.ROOT)]
            ended(command)
            others[0].wait(LIMIT_S)

        def from_the_future(command: list[str], folder: Path) -> None:
            ended(command)
            for path in folder.rglob("*"):
                os.utime(path, (time.time() + FUTURE_S,) * 2)

        survived = [same_bytes(step, work, killed) for _ in range(kills)]
        rows.append(
            {
                "command": step.name,
                "status": calm.status,
                "kills": kills,
                "same bytes after": sum(survived),
                "two at once": _word(same_bytes(step, work, twice)),
                "disk full": _full_disk(step, work),
                "files from the future": _word(same_bytes(step, work, from_the_future)),
                "peak memory, MB": round(calm.peak_mb),
            }
        )
    return pd.DataFrame(rows)


def _word(same: bool) -> str:
    return "same bytes" if same else "differs"


def _full_disk(step: Step, work: Path) -> str:
    """What a command does when no file may be larger than 100 bytes: a stated error, and no part of a file."""
    out = work / f"{step.name}-full"
    out.mkdir()
    full = ended(step.command(out), file_limit=100)
    torn = [path for path, data in content(out).items() if len(data) == 100]
    if full.status == 1 and full.said.startswith("iris-sysid: ") and "unexpected" not in full.said and not torn:
        return "stated, nothing half-written"
    return f"status {full.status}, {len(torn)} torn: {full.said[:80]}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="what the tests run: under a minute")
    parser.add_argument("--seconds", type=float, default=600.0, help="of mutated input for all readers together")
    parser.add_argument("--kills", type=int, default=10, help="kill points of each command")
    parser.add_argument("--each", type=int, default=100, help="cuts, and flipped bits, of each kind of clip")
    parser.add_argument("--part", choices=PARTS, action="append", help="readers, clips, commands; all if none is given")
    parser.add_argument("--command", action="append", help=f"{', '.join(COMMANDS)}; all if none is given")
    pages.add_option(parser)
    options = parser.parse_args()
    seconds, kills, each = (8.0, 2, 8) if options.short else (options.seconds, options.kills, options.each)
    commands = ["fit"] if options.short else options.command or list(COMMANDS)
    makes: dict[str, Callable[[Path], pd.DataFrame]] = {
        "readers": lambda _: readers(seconds),
        "clips": lambda work: damaged_clips(work, each),
        "commands": lambda work: disturbances(work, commands, kills),
    }
    for part in options.part or PARTS:
        with pages.table(f"torture-{part}", options.write_docs), tempfile.TemporaryDirectory() as folder:
            print(pages.markdown(makes[part](Path(folder))), flush=True)


if __name__ == "__main__":
    main()
