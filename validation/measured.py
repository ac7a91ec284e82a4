"""Diagnosis of real recordings: missing effects, and the error before and after, from the raw file of each.

``python -m validation.measured [--only NAME] [--folder OUT]`` needs the recordings in ``../shared/data``. Each row
comes from the two commands of its recording; the pages of the diagnoses stay in ``--folder``.
"""

from __future__ import annotations

import argparse
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid.io.csv_cells import read_sheet
from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_trajectory
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import DiagnosisDocument
from tests._real_data import wooden_bob
from validation import pages

DATA = Path("..") / "shared" / "data"
CLEAN = 18_000  # samples of alexiev's 001 before single-frame false detections
ORIGIN_PX = 1002.8  # where that pendulum hangs
BEFORE_HIT_S = 0.5  # the puck is hit at 0.8 s


def alexiev(folder: Path) -> None:
    """Write the pendulum's position in the frame, in px: no scale is known."""
    t_s, x_px = (np.loadtxt(DATA / f"alexiev_pendulum/001_{name}.csv")[:CLEAN] for name in ("times", "x_pos_pixels"))
    later = np.concatenate([[True], np.diff(t_s) > 0])
    pd.DataFrame({"t_s": t_s, "z_px": x_px - ORIGIN_PX})[later].to_csv(folder / "trajectory.csv", index=False)


def tanks(folder: Path) -> None:
    """Write the estimation record; a reading at full scale is a gap."""
    raw = read_sheet(DATA / "cascaded_tanks/tanque.csv")
    level, pump = raw.numbers("yEst"), raw.numbers("uEst")
    t_s = 4.0 * np.arange(level.size)
    table = pd.DataFrame({"t_s": t_s, "level_V": np.where(level < 10.0, level, np.nan), "u_V": pump})
    table.to_csv(folder / "trajectory.csv", index=False)


def bob(folder: Path) -> None:
    """Write the angle of the wooden bob."""
    write_trajectory(wooden_bob(), folder / "trajectory.csv", overwrite=True)


def puck(folder: Path) -> None:
    """Write the path of the puck that is hit, along its line, until it leaves the frame."""
    hit = min(read_track(folder / "track.csv"), key=lambda track: int(track.valid.sum()))
    kept = hit.valid & (hit.t_s > BEFORE_HIT_S)
    xy_px = hit.xy_px[kept]
    along = np.linalg.svd(xy_px - xy_px.mean(axis=0), full_matrices=False)[2][0]
    distance = (xy_px - xy_px[0]) @ along
    pd.DataFrame({"t_s": hit.t_s[kept], "s_px": np.sign(distance[-1]) * distance}).to_csv(
        folder / "trajectory.csv", index=False
    )


@dataclass(frozen=True)
class Recording:
    """Commands that lead from the raw file to a trajectory, and the arguments of its diagnosis."""

    name: str
    first: str | Callable[[Path], None]
    ask: str
    then: Callable[[Path], None] | None = None


FLIGHT = "--phenomenon projectile --fps 240 --scale gravity=9.79 --mark launch=5,103"
RECORDINGS = [
    Recording("alexiev-001", alexiev, "--model linear-oscillator"),
    Recording("cascaded-tanks", tanks, "--model examples/two_tanks.py:rimmed_tanks"),
    Recording(
        "iris-pendulum",
        "run {data}/iris_footage/pendulum.gif --phenomenon pendulum --set ball_radius=33.5+-1mm",
        "--phenomenon pendulum",
    ),
    Recording(
        "iris-sliding-cone",
        "run {data}/iris_footage/Sliding_cone.gif --phenomenon sliding-cone --scale-bar 201,408,692,135=0.84m",
        "--phenomenon sliding-cone",
    ),
    Recording(
        "iris-two-pendulums",
        "run {data}/iris_footage/Two_Moving_Pendulums.gif --phenomenon two-moving-pendulums",
        "--phenomenon two-moving-pendulums",
    ),
    *(
        Recording(
            f"sliding-friction-{name}",
            f"run {{data}}/phystrack/SlidingFriction_{name}.MP4 --phenomenon sliding-cone --fps 240 --scale 440px=1m",
            "--phenomenon sliding-cone",
        )
        for name in ("R1", "R3")
    ),
    *(
        Recording(
            f"projectile-{name[:2]}",
            f"run {{data}}/phystrack/Projectile_Motion__{name}.MP4 {FLIGHT}",
            "--phenomenon projectile --set gravity=9.79 --free magnification",
        )
        for name in ("30Deg_2_726mps", "60Deg_2_699mps")
    ),
    Recording(
        "carom-puck",
        "track {data}/phystrack/CaromPuck_HeadOn.MP4 --bodies 2 --fps 240",
        "--model incline",
        puck,
    ),
    Recording("wooden-bob", bob, "--model pendulum"),
    Recording(
        "juangomez",
        "run {data}/juangomez_pendulum/pendulum.mp4 --phenomenon pendulum --scale 640px=1m",
        "--phenomenon pendulum",
    ),
]


def command(text: str, output: Path) -> str:
    """Run one command of the program; return its error message, or an empty text."""
    program = Path(sys.executable).parent / "iris-sysid"
    done = subprocess.run([program, *shlex.split(text), "-o", output, "--force"], capture_output=True, text=True)
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["?"])[-1]


def row(recording: Recording, folder: Path) -> str:
    """From the raw file to one row of the table."""
    folder.mkdir(parents=True, exist_ok=True)
    if isinstance(recording.first, str):
        target = folder / "track.csv" if recording.first.startswith("track ") else folder
        command(recording.first.format(data=DATA), target)  # a misfit is no failure here: the diagnosis examines it
    else:
        recording.first(folder)
    if recording.then is not None:
        recording.then(folder)
    wrong = command(f"diagnose {folder / 'trajectory.csv'} {recording.ask}", folder / "diagnosis")
    if wrong:
        return f"| {recording.name} | {wrong} | | | |"
    document = read_document(folder / "diagnosis" / "diagnosis.json", DiagnosisDocument)
    errors = document.error
    fitted, heldout = (
        f"{_number(getattr(errors.before, which))} → {_number(getattr(errors.after, which))}"
        for which in ("fitted", "heldout")
    )
    noise = f"{_number(errors.noise_floor)} {errors.unit}"
    return f"| {recording.name} | {document.sentence} | {fitted} | {heldout} | {noise} |"


def _number(value: float | None) -> str:
    return "not known" if value is None else f"{value:.3g}"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--folder", type=Path, help="where tracks, tables and pages stay")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("measured", options.write_docs):
        print("| recording | what was found | fitted, before → after | held out | noise |\n|---|---|---|---|---|")
        with tempfile.TemporaryDirectory() as temporary:
            for recording in RECORDINGS:
                if options.only in recording.name:
                    print(row(recording, (options.folder or Path(temporary)) / recording.name), flush=True)


if __name__ == "__main__":
    main()
