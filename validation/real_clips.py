"""Print the results of the commands on real recordings, and the published truth.

Needs the recordings in ``../shared/data``. Each row is one command, run as a user would run it.
"""

from __future__ import annotations

import json
import math
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_trajectory
from iris_sysid.io.osp_tracker import read_osp
from iris_sysid.report.text import with_error
from iris_sysid.types import Estimate
from tests._real_data import alexiev_length_68, wooden_bob

DATA = Path("..") / "shared" / "data"
TABLES = {"wooden_bob": wooden_bob, "alexiev_length_68": alexiev_length_68}  # recordings without a video


@dataclass(frozen=True)
class Clip:
    """One row: the command (without its output), the value read from its result, and the published truth."""

    command: str
    results: Callable[[Path], str]
    truth: str


def value(folder: Path, name: str, degrees: bool = False) -> str:
    """Format one estimate of fit.json, or of the geometry in it."""
    document = json.loads((folder / "fit.json").read_text())
    entry = {**document["geometry"], **document["parameters"]}[name]
    factor, unit = (180 / math.pi, "°") if degrees else (1.0, entry["unit"])
    stderr = entry["stderr"] if entry["stderr"] is not None else math.nan
    return f"{name} {with_error(Estimate(entry['value'] * factor, stderr * factor, unit, entry['measurement_type']))}"


def status(folder: Path) -> str:
    """Return the status of the fit, as text; nothing where it is ok or nothing was fitted."""
    path = folder / "fit.json"
    found = json.loads(path.read_text())["status"] if path.is_file() else "ok"
    return "" if found == "ok" else f"; status `{found}`"


def tracked(folder: Path) -> str:
    """Return how many frames were tracked, as text."""
    body = read_track(folder / "track.csv")[0]
    return f"{body.n_valid} of {len(body.t_s)} frames"


def used(folder: Path) -> str:
    """Return which samples were fitted, as text."""
    document = json.loads((folder / "fit.json").read_text())
    spans = [f"{part['start']}-{part['stop'] - 1}" for part in document["segments"] if part["label"] == "motion"]
    return f"motion in frames {', '.join(spans)}"


def against_marks(folder: Path) -> str:
    """Compare the track with the marks that came with the clip."""
    body = read_track(folder / "track.csv")[0]
    ((frames, marks_px),) = read_osp(DATA / "tracker_balltoss/BallToss.trz").marks.values()
    rows = [int(np.flatnonzero(body.frame == frame)[0]) for frame in frames]
    difference = body.xy_px[rows] - marks_px
    return f"RMS {np.sqrt(np.mean(np.sum(difference**2, axis=1))):.2f} px over {len(rows)} marks"


CLIPS = [
    Clip(
        "run {data}/juangomez_pendulum/pendulum.mp4 --phenomenon pendulum --scale 640px=1m",
        lambda out: f"{tracked(out)}; {value(out, 'length')}",
        "1.7 m",
    ),
    Clip(
        "run {data}/iris_footage/pendulum.gif --phenomenon pendulum --set ball_radius=33.5+-1mm",
        lambda out: f"{used(out)}; {value(out, 'length')}; {value(out, 'rope_length')}",
        "rope 0.50 m, ball r 0.0335 m",
    ),
    Clip(
        "run {data}/iris_footage/Sliding_cone.gif --phenomenon sliding-cone --scale-bar 201,408,692,135=0.84m",
        lambda out: f"{used(out)}; {value(out, 'angle', degrees=True)}; {value(out, 'acceleration')}",
        "board drawn at 29°",
    ),
    Clip(
        "run {data}/phystrack/Projectile_Motion__30Deg_2_726mps.MP4 --phenomenon projectile --fps 240"
        " --scale gravity=9.79 --mark launch=5,103",
        lambda out: f"{value(out, 'launch_speed')}; {value(out, 'launch_angle', degrees=True)}",
        "2.726 m/s, 30°",
    ),
    Clip(
        "run {data}/phystrack/Projectile_Motion__60Deg_2_699mps.MP4 --phenomenon projectile --fps 240"
        " --scale gravity=9.79 --mark launch=5,103",
        lambda out: f"{value(out, 'launch_speed')}; {value(out, 'launch_angle', degrees=True)}",
        "2.699 m/s, 60°",
    ),
    Clip("fit {table:wooden_bob}.csv --model pendulum", lambda out: value(out, "length"), "0.334 m"),
    Clip("fit {table:alexiev_length_68}.csv --model pendulum", lambda out: value(out, "length"), "0.68 m to the bob"),
    Clip("track {data}/tracker_balltoss/BallToss.trz", against_marks, "the file's own marks"),
]


class Names:
    """Expand placeholders of a command: ``{data}`` the recordings, ``{table:NAME}`` a table made from one of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def __format__(self, name: str) -> str:
        path = self.folder / name
        write_trajectory(TABLES[name](), path.with_suffix(".csv"), overwrite=True)
        return str(path)


def row(clip: Clip) -> str:
    """Run one command and format its row of the table."""
    with tempfile.TemporaryDirectory() as temporary:
        out = Path(temporary)
        target = out / {"track": "track.csv", "fit": "fit.json"}.get(clip.command.split()[0], "")
        command = shlex.split(clip.command.format(data=DATA, table=Names(out)))
        program = Path(sys.executable).parent / "iris-sysid"
        done = subprocess.run([program, *command, "-o", target, "--force"], capture_output=True, text=True)
        result = (
            f"{clip.results(out)}{status(out)}"
            if done.returncode == 0
            else f"failed: {done.stderr.strip().splitlines()[-1]}"
        )
    shown = clip.command.replace("{data}", "$DATA").replace("{table:", "").replace("}", "")
    return f"| `iris-sysid {shown}` | {result} | {clip.truth} |"


def main() -> None:
    """Print the table as Markdown."""
    print("| command | result | truth |\n|---|---|---|")
    for clip in CLIPS:
        print(row(clip), flush=True)


if __name__ == "__main__":
    main()
