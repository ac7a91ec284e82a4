"""Play five new users on files from the world: print what each command says, and whether it is right or a question.

Needs the recordings in ``../shared/data``. Each row is one command as its user types it first. ``right``: every value
that is known lies within its tolerance. ``question``: the command ends and names the option that it needs. ``answer``:
there is a result, and no truth to compare. ``doubt``: numbers that are not true, and the verdict says why not to trust
them, or that their equation is incomplete. ``WRONG``: numbers that are not true, and the verdict finds nothing amiss.
``stopped``: it ends and names no option.
"""

from __future__ import annotations

import argparse
import json
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from iris_sysid.types import SPOKEN
from validation import pages

WORLD = Path("..") / "shared" / "data" / "world"
TABLE = "five-users"
MAX_S = 180
INCH = 0.0254


@dataclass(frozen=True)
class Step:
    """One command of a user.

    ``command`` without ``iris-sysid``, with ``{world}`` and ``{out}``; several, joined by ``then``. ``known`` says what
    is known before. ``truth``: value and tolerance of parameters, by name; without any, no number can be right, unless
    ``anything`` may be answered, because nothing that is known can be compared.
    """

    user: str
    command: str
    known: str
    truth: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    anything: bool = False


STEPS = [
    Step("teacher", "frame {world}/bounce-green-rest/clip.avi --time 1 -o {out}/frame.png", "AVI", anything=True),
    Step(
        "teacher",
        "run {world}/pend-globe-62cm/clip.mp4 --phenomenon pendulum --stop 8 -o {out}",
        "T = 1.601 s: L = 0.637 m",
        {"length": (0.637, 0.02)},
    ),
    Step(
        "teacher",
        "run {world}/fall-marble-slowmo/clip.mp4 --phenomenon dropping-ball --scale 44px=25mm -o {out}",
        "filmed at 240 frames a second, which the file does not say",
    ),
    Step(
        "teacher",
        "run {world}/fall-marble-slowmo/clip.mp4 --phenomenon dropping-ball --scale 44px=25mm --fps 240 -o {out}",
        "g = 9.81 m/s^2, by a ball of about 25 mm",
        {"gravity": (9.81, 0.8)},
    ),
    Step(
        "teacher",
        "run {world}/pend-globe-62cm/clip.mp4 --phenomenon dropping-ball --stop 5 --scale 300px=1m -o {out}",
        "it is a pendulum",
    ),
    Step(
        "teacher",
        "run {world}/neg-hand-held-ball/clip.mp4 --phenomenon pendulum --stop 5 -o {out}",
        "a hand moves the ball",
    ),
    Step(
        "teacher",
        "run {world}/toss-ball-lamp/clip.mov --phenomenon projectile --scale gravity=9.81 -o {out}",
        "turned by 180 degrees; no scale is known",
        anything=True,
    ),
    Step(
        "student",
        "fit {world}/tab-90deg-pendulum/q2_data.csv --model pendulum -o {out}/fit.json",
        "columns X (s) and Y (rad), without units",
    ),
    Step(
        "student",
        "fit {world}/tab-90deg-pendulum/q4b_data1.csv --columns t=X,theta[rad]=Y --model pendulum -o {out}/fit.json",
        "44.75 in to the middle of the mass",
        {"length": (44.75 * INCH, 0.05)},
    ),
    Step(
        "student",
        "fit {world}/tab-hayson-pendulum/263.csv --model pendulum -o {out}/fit.json",
        "263 mm in the file's name; theta has no unit",
        {"length": (0.263, 0.03)},
    ),
    Step(
        "student",
        "fit {world}/tab-hayson-pendulum/263.csv --columns t=time,theta[deg]=theta --model pendulum -o {out}/fit.json",
        "the angle is in rad, not in degrees",
        {"length": (0.263, 0.03)},
    ),
    Step(
        "student",
        "fit {world}/tab-bridge-drops/Ball_drops_data.xls --model free-fall -o {out}/fit.json",
        "eleven sheets, .xlsx under the name .xls",
    ),
    Step(
        "student",
        "fit {world}/tab-coffee-filter/falling.txt --model auto -o {out}/fit.json",
        "a coffee filter: g is not free",
        anything=True,
    ),
    Step("student", "fit {world}/tab-phone-carts/cart-downhill.csv --model incline -o {out}/fit.json", "accelerations"),
    Step(
        "student",
        "fit {world}/tab-aeropendulum/telemetria_15graus_20260804_114336.csv --model pendulum -o {out}/fit.json",
        "ms and graus; a propeller drives it, so no free pendulum",
    ),
    Step(
        "physicist",
        "discover {world}/tab-90deg-pendulum/q4b_data1.csv --columns t=X,theta[rad]=Y -o {out}/discovery.json",
        "a pendulum",
        anything=True,
    ),
    Step(
        "physicist",
        "fit {world}/tab-foucault/2021_09_17_14_57_N.csv --model auto -o {out}/fit.json",
        "time;x;y in px: a swing in two directions",
        anything=True,
    ),
    Step(
        "physicist",
        "run {world}/pend-globe-62cm/clip.mp4 --phenomenon pendulum --stop 8 -o {out}/run then "
        "diagnose {out}/run -o {out}",
        "T = 1.601 s, weak drag",
        anything=True,
    ),
    Step(
        "physicist",
        "import {world}/roll-ball-slow/uniform-motion-ball-slow.trz -o {out}/ball.csv then "
        "fit {out}/ball-world.csv --model auto -o {out}/fit.json",
        "rolls at 0.32 m/s",
        anything=True,
    ),
    Step("physicist", "import {world}/carts-two-frames/two-carts.trz -o {out}/carts.csv", "two bodies", anything=True),
    Step(
        "physicist", "import {world}/incline-cart-bumper/bouncing_cart.trz -o {out}/cart.csv", "a project without marks"
    ),
    Step(
        "engineer",
        "fit {world}/tab-wheel-torsion/bicycle-wheel-axial-inertia-rate-gyro-measurement.csv "
        "--equation \"omega'' = -k*omega - c*omega'\" -o {out}/fit.json",
        "a gyroscope on a torsion rod, own equation, no units in the header",
        anything=True,
    ),
    Step(
        "engineer",
        "fit {world}/tab-coupled-drives/DATAPRBS.csv --model my_drives.py:drives -o {out}/fit.json",
        "a file of the user's that is not there",
    ),
    Step("engineer", "diagnose {world}/tab-drain-tank/liq_level_data_empty_train.csv -o {out}", "no model is named"),
    Step("author", "gt {world} -o {out}/parameters.json", "no class of a benchmark"),
    Step("author", "track {world}/two.trz -o {out}/track.csv", "a name that is not there"),
]


@dataclass(frozen=True)
class Said:
    """What a command said: its exit status, its last sentence, and the result it wrote (None where it wrote none)."""

    status: int
    text: str
    document: Mapping[str, Any] | None


def play(step: Step) -> Said:
    """Run the command of a step in a separate folder."""
    with tempfile.TemporaryDirectory() as folder:
        for command in step.command.format(world=WORLD, out=folder).split(" then "):
            program = [sys.executable, "-c", "from iris_sysid.cli import main; main()", *shlex.split(command)]
            try:
                done = subprocess.run(program, capture_output=True, text=True, check=False, timeout=MAX_S)
            except subprocess.TimeoutExpired:
                return Said(-1, f"no answer in {MAX_S} s", None)
        text = done.stderr.strip().splitlines()[-1] if done.returncode else first_line(done)
        result = Path(folder) / "fit.json"
        document = json.loads(result.read_text("utf-8")) if result.is_file() else None
        return Said(done.returncode, text.replace(folder, "OUT").replace(str(WORLD), "WORLD"), document)


def first_line(done: subprocess.CompletedProcess[str]) -> str:
    """The verdict where there is one (a diagnosis has sentences before it); else what was said first."""
    lines = [*done.stdout.strip().splitlines(), *done.stderr.strip().splitlines()]
    verdicts = (line for line in lines if line.startswith(tuple(SPOKEN.values())))
    return next(verdicts, lines[0] if lines else "")


def judgement(step: Step, said: Said) -> str:
    """One word of the docstring of this module."""
    if said.status:
        asks = re.search(r"--[a-z]|FILE|name one|there is no|should be|has no", said.text)
        return "question" if asks and "unexpected" not in said.text else "stopped"
    if step.anything:
        return "answer"
    if step.truth and said.document is not None and all(_true(step, said.document, name) for name in step.truth):
        return "right"
    return "doubt" if said.document is not None and _doubted(said.document) else "WRONG"


def _doubted(document: Mapping[str, Any]) -> bool:
    """Whether the verdict doubts the numbers, or says that the equation is incomplete."""
    verdict = document.get("verdict") or {}
    equation = verdict.get("equation") or {"complete": True}
    return verdict.get("word") != "good" or not equation["complete"]


def _true(step: Step, document: Mapping[str, Any], name: str) -> bool:
    value, tolerance = step.truth[name]
    return bool(abs(document["parameters"][name]["value"] - value) <= tolerance)


def found(step: Step, said: Said) -> str:
    """The values whose truth is known, as text."""
    entries = {} if said.document is None else said.document["parameters"]
    return "; ".join(f"{name} {entries[name]['value']:.4g}" for name in step.truth if name in entries)


def main() -> None:
    """Play the steps, print them as they end, then the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="steps of this user only")
    pages.add_option(parser)
    options = parser.parse_args()
    rows = []
    for step in STEPS:
        if options.only in step.user:
            said = play(step)
            rows.append((step.user, step.command, step.known, found(step, said), judgement(step, said), said.text))
            print(*rows[-1], sep=" | ", file=sys.stderr, flush=True)
    with pages.table(TABLE, options.write_docs):
        print(pages.markdown(pd.DataFrame(rows, columns=["user", "command", "known", "found", "judged", "said"])))


if __name__ == "__main__":
    main()
