"""Run a fixed set of commands, list every number of their results, and compare two such lists.

A refactoring must not change results. Run this before and after it, each time with the environment of that checkout::

    python -m validation.same_results run --python BEFORE/.venv/bin/python --data ../shared/data -o before
    python -m validation.same_results run --python AFTER/.venv/bin/python --data ../shared/data -o after
    python -m validation.same_results compare before/numbers.json after/numbers.json

It uses the command line only, so that it works on any two commits. An interrupted run continues where it stopped.
Texts of more than one word are not compared: wording may change.
"""

from __future__ import annotations

import argparse
import configparser
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pandas as pd

# {data}: the recordings; {all}: the folder of all commands, by name; {out}: the command's own folder.
# A command may use what one above it has made. An indented line goes on with the one above it.
COMMANDS = """[commands]
list: list --json
schema-fit: schema fit
gt-template: gt --template
audit: python -m validation.audit {data}/iris_published -o {out}/audit
calibrate-board: calibrate {data}/opencv_checkerboard --board 9x6 --square 25mm -o {out}/calibration.json
real-juangomez: run {data}/juangomez_pendulum/pendulum.mp4 --phenomenon pendulum --scale 640px=1m -o {out}
real-iris-pendulum: run {data}/iris_footage/pendulum.gif --phenomenon pendulum --set ball_radius=33.5+-1mm -o {out}
real-sliding-cone: run {data}/iris_footage/Sliding_cone.gif --phenomenon sliding-cone
    --scale-bar 201,408,692,135=0.84m -o {out}
real-throw-30: run {data}/phystrack/Projectile_Motion__30Deg_2_726mps.MP4 --phenomenon projectile --fps 240
    --scale gravity=9.79 --mark launch=5,103 -o {out}
real-throw-60: run {data}/phystrack/Projectile_Motion__60Deg_2_699mps.MP4 --phenomenon projectile --fps 240
    --scale gravity=9.79 --mark launch=5,103 -o {out}
real-wooden-bob: fit {all}/tables/wooden_bob.csv --model pendulum -o {out}/fit.json
real-alexiev: fit {all}/tables/alexiev_length_68.csv --model pendulum -o {out}/fit.json
real-balltoss-track: track {data}/tracker_balltoss/BallToss.trz -o {out}/track.csv
real-balltoss-import: import {data}/tracker_balltoss/BallToss.trz -o {out}/track.csv
render-pendulum: render --phenomenon pendulum --effect quadratic-drag=0.12 --seconds 6 --size 480x270
    --seed 1 -o {out}/clip.mp4
render-pendulum-60: render --phenomenon pendulum --effect quadratic-drag=0.12 --seconds 6 --set theta_0=-60deg
    --size 480x270 --seed 1 -o {out}/clip.mp4
render-dropping-ball: render --phenomenon dropping-ball --size 640x360 --seed 1 --seconds 2 -o {out}/clip.mp4
render-falling-ball: render --phenomenon falling-ball --size 480x270 --seed 1 --seconds 1.5 -o {out}/clip.mp4
render-hitting-cones: render --phenomenon hitting-cones --size 480x270 --seed 1 --seconds 2 -o {out}/clip.mp4
render-led: render --phenomenon led --size 480x270 --seed 1 --seconds 5 -o {out}/clip.mp4
render-rotating-cone: render --phenomenon rotating-cone --size 480x270 --seed 1 --seconds 5 -o {out}/clip.mp4
render-sliding-cone: render --phenomenon sliding-cone --size 480x270 --seed 1 --seconds 3 -o {out}/clip.mp4
render-torricelli: render --phenomenon torricelli --size 480x270 --seed 1 --seconds 8 -o {out}/clip.mp4
render-two-moving: render --phenomenon two-moving-pendulums --size 480x270 --seed 1 --seconds 3 -o {out}/clip.mp4
render-one-static: render --phenomenon one-static-pendulum --size 480x270 --seed 1 --seconds 3 -o {out}/clip.mp4
run-pendulum: run {all}/render-pendulum/clip.mp4 --phenomenon pendulum --scale 404.3808px=1m
    --set ball_radius=33.5+-0.5mm -o {out}
run-pendulum-60: run {all}/render-pendulum-60/clip.mp4 --phenomenon pendulum --scale 404.3808px=1m -o {out}
run-dropping-ball: run {all}/render-dropping-ball/clip.mp4 --phenomenon dropping-ball --scale 201.455px=1m -o {out}
run-falling-ball: run {all}/render-falling-ball/clip.mp4 --phenomenon falling-ball --set h0=0.75+-0.01 -o {out}
run-hitting-cones: run {all}/render-hitting-cones/clip.mp4 --phenomenon hitting-cones --scale 135.2113px=1m -o {out}
run-led: run {all}/render-led/clip.mp4 --phenomenon led -o {out}
run-rotating-cone: run {all}/render-rotating-cone/clip.mp4 --phenomenon rotating-cone -o {out}
run-sliding-cone: run {all}/render-sliding-cone/clip.mp4 --phenomenon sliding-cone --scale 236.8421px=1m -o {out}
run-torricelli: run {all}/render-torricelli/clip.mp4 --phenomenon torricelli --scale 843.75px=1m -o {out}
run-two-moving: run {all}/render-two-moving/clip.mp4 --phenomenon two-moving-pendulums --scale 399.3344px=1m -o {out}
run-one-static: run {all}/render-one-static/clip.mp4 --phenomenon two-moving-pendulum-one-static
    --scale 399.3344px=1m -o {out}
track-two-bodies: track {all}/render-two-moving/clip.mp4 --bodies 2 --scale 399.3344px=1m -o {out}/track.csv
    --world {out}/world.csv
smooth: smooth {all}/tables/wooden_bob.csv -o {out}/smoothed.csv
fit-auto: fit {all}/tables/real_linear.csv --model auto -o {out}/fit.json
fit-set: fit {all}/run-pendulum/trajectory.csv --model pendulum --set gravity=9.79+-0.01 -o {out}/fit.json
fit-free: fit {all}/tables/wooden_bob.csv --model pendulum --free vertical --uncertainty all -o {out}/fit.json
fit-pooled: fit {all}/run-pendulum/trajectory.csv {all}/run-pendulum-60/trajectory.csv --model pendulum
    --shared length -o {out}/fit.json
discover: discover {all}/tables/real_linear.csv -o {out}/discovery.json
discover-residual: discover {all}/run-pendulum/trajectory.csv --residual-of pendulum -o {out}/discovery.json
diagnose-drag: diagnose {all}/run-pendulum/trajectory.csv --model pendulum -o {out}
diagnose-wooden-bob: diagnose {all}/tables/wooden_bob.csv --model pendulum -o {out}
diagnose-linear: diagnose {all}/tables/real_linear.csv --model linear-oscillator -o {out}
diagnose-two-clips: diagnose {all}/run-pendulum/trajectory.csv {all}/run-pendulum-60/trajectory.csv
    --model pendulum -o {out}
render-dataset: render --dataset {out}/set --classes Sliding_cone --trials 1 --seconds 3 --size 480x270 --seed 1
gt: gt {all}/render-dataset/set --trials 1 --board 9x6 --square 25mm --work {out}/work -o {out}/parameters.json
"""

# Commands of checkouts in which the module or option of the same name above does not exist yet.
FORMER = {"audit": ("validation/audit/__main__.py", "benchmark --audit {data}/iris_published -o {out}/audit")}

# Old name -> new name: a part of a key between / or . (or several such parts), or a text in a result.
# For example "t0_s": "start_s", "fit.json/rms": "fit.json/residual_rms", "quadratic-drag": "square-drag".
RENAMED: dict[str, str] = {"one-static-pendulum": "two-moving-pendulum-one-static"}

LEFT_OUT = re.compile(r"origin|versions?|\$?schema|.*sha256|hash|date|created|python|source")  # keys and columns
MAX_LIST = 20  # numbers or kinds of text given one by one; of more only the summary
Value = float | str


def main() -> int:
    """Run or compare, as the arguments say."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    actions = parser.add_subparsers(dest="action", required=True)
    running = actions.add_parser("run", help="run the commands and write numbers.json")
    running.add_argument("--python", type=Path, required=True, help="python of the environment to run")
    running.add_argument("--data", type=Path, required=True, help="folder of the recordings")
    running.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    running.add_argument("--only", default="*", help="only commands of that name; * stands for anything")
    comparing = actions.add_parser("compare", help="compare two files numbers.json")
    comparing.add_argument("files", type=Path, nargs=2, help="numbers.json before and after")
    comparing.add_argument("--rtol", type=float, default=1e-6, help="relative difference that is none")
    comparing.add_argument("--atol", type=float, default=1e-15, help="absolute difference that is none")
    options = parser.parse_args()
    return run(options) if options.action == "run" else compare(options)


def run(options: argparse.Namespace) -> int:
    """Run all commands that are not done yet, then write the numbers of all that are."""
    output, python = options.output.resolve(), options.python.absolute()
    make_tables(options.data, output / "tables")
    for name, command in commands_of(checkout_of(python)).items():
        if fnmatch(name, options.only) and not (output / name / "done.json").exists():
            paths = {"data": options.data.resolve(), "all": output, "out": output / name}
            program, *words = (word.format(**paths) for word in shlex.split(command))
            if program == "python":  # a module beside the package: found in the folder of the checkout only
                run_one(output / name, [str(python), *words], checkout_of(python))
            else:
                run_one(output / name, [str(python.parent / "iris-sysid"), program, *words], output / name)
    numbers = {key: value for name in commands() for key, value in numbers_of(output / name)}
    (output / "numbers.json").write_text(json.dumps(numbers, indent=0) + "\n", encoding="utf-8")
    print(f"{len(numbers)} numbers in {output / 'numbers.json'}")
    return 0


def commands() -> dict[str, str]:
    """Return the commands by name."""
    parser = configparser.ConfigParser(delimiters=(":",), interpolation=None)
    parser.read_string(COMMANDS)
    return dict(parser["commands"])


def checkout_of(python: Path) -> Path:
    """Return the folder that holds the environment of a Python program: CHECKOUT/.venv/bin/python."""
    return python.parents[2]


def commands_of(checkout: Path) -> dict[str, str]:
    """Return the commands by name, in the form that a checkout knows them."""
    former = {name: command for name, (path, command) in FORMER.items() if not (checkout / path).is_file()}
    return commands() | former


def run_one(folder: Path, command: list[str], where: Path) -> None:
    """Empty a folder, and run a command (its working folder is ``where``); keep output, exit code and time there."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment["OPENCV_FOR_THREADS_NUM"] = "1"  # two threads change the tenth digit of a calibration
    began = os.times()
    done = subprocess.run(command, cwd=where, env=environment, capture_output=True, text=True, encoding="utf-8")
    seconds = round(os.times().children_user + os.times().children_system - sum(began[2:4]), 1)
    suffix = "json" if done.stdout.startswith(("{", "[")) else "txt"
    (folder / f"printed.{suffix}").write_text(done.stdout, encoding="utf-8")
    (folder / "errors.txt").write_text(done.stderr, encoding="utf-8")
    (folder / "done.json").write_text(json.dumps({"exit": done.returncode, "seconds": seconds}), encoding="utf-8")
    print(f"{folder.name:24} exit {done.returncode}  {seconds:6.1f} s", flush=True)


def make_tables(data: Path, folder: Path) -> None:
    """Write the recordings that are tables as CSV files of t_s and one quantity, in rad or m."""
    folder.mkdir(parents=True, exist_ok=True)
    bob_s, bob_deg = spreadsheet(data / "wooden_bob" / "damping_angle.xlsx").T
    web_s, x_px, y_px = (np.loadtxt(data / "alexiev_pendulum" / f"length_68_{column}.csv") for column in "txy")
    _, cart_s, cart_mm, _ = np.loadtxt(data / "schmidt_lipson" / "real_linear_h_1.txt", comments="%").T
    tables = {
        "wooden_bob": {"t_s": bob_s, "theta_rad": np.deg2rad(bob_deg)},
        "alexiev_length_68": {"t_s": web_s, "theta_rad": angles(x_px, y_px)},
        "real_linear": {"t_s": cart_s, "z_m": cart_mm / 1000},
    }
    for name, columns in tables.items():
        pd.DataFrame(columns).to_csv(folder / f"{name}.csv", index=False)


def spreadsheet(path: Path) -> np.ndarray:
    """Return the numbers in columns A and B of the first sheet of an xlsx file, which is a zip of XML."""
    with zipfile.ZipFile(path) as archive:
        sheet = ElementTree.fromstring(archive.read("xl/worksheets/sheet1.xml"))
    space = sheet.tag.removesuffix("worksheet")
    rows = []
    for row in sheet.iter(f"{space}row"):
        cells = {re.sub(r"\d", "", cell.get("r", "")): cell.findtext(f"{space}v") for cell in row}
        rows.append([float(text) for text in (cells.get("A"), cells.get("B")) if text is not None])
    return np.array([row for row in rows if len(row) == 2])


def angles(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return the angles of points, in rad from the y axis, about the centre of the circle nearest to them (Kasa)."""
    columns = np.column_stack([x, y, np.ones_like(x)])
    centre = np.linalg.lstsq(columns, x**2 + y**2, rcond=None)[0] / 2
    return np.asarray(np.arctan2(x - centre[0], y - centre[1]))


def numbers_of(folder: Path) -> Iterator[tuple[str, Value]]:
    """Yield every number and short text of one command's results, in JSON and CSV files, and its exit code."""
    done = folder / "done.json"
    if not done.exists():
        return
    yield f"{folder.name}/exit", json.loads(done.read_text(encoding="utf-8"))["exit"]
    for path in sorted(folder.rglob("*.json")) + sorted(folder.rglob("*.csv")):
        if path != done:
            content = flat(json.loads(path.read_text("utf-8")), "") if path.suffix == ".json" else csv_numbers(path)
            yield from under(f"{path.relative_to(folder.parent).as_posix()}/", content)


def under(start: str, content: Iterator[tuple[str, Value]]) -> Iterator[tuple[str, Value]]:
    """Put the same text before every key."""
    return ((start + key, value) for key, value in content)


def flat(node: Any, path: str) -> Iterator[tuple[str, Value]]:
    """Yield the numbers and short texts under a node; a long list of numbers gives its summary."""
    array = numeric(node)
    if array is not None:
        yield from under(f"{path}.", summary(array))
    elif isinstance(node, dict | list):
        for key, child in node.items() if isinstance(node, dict) else enumerate(node):
            if not LEFT_OUT.fullmatch(str(key)):
                yield from flat(child, f"{path}.{key}" if path else str(key))
    elif not isinstance(node, str) or is_short(node):
        yield path, "null" if node is None else node


def numeric(node: Any) -> np.ndarray | None:
    """Return a long list of numbers as a flat array, null as NaN; None for anything else."""
    if not isinstance(node, list) or len(node) <= MAX_LIST:
        return None
    try:
        return np.array(node, dtype=float).ravel()
    except (TypeError, ValueError):
        return None


def csv_numbers(path: Path) -> Iterator[tuple[str, Value]]:
    """Yield the summary of every column of a CSV file: of its numbers, and of its texts."""
    frame = pd.read_csv(path, dtype=str, keep_default_na=False)
    yield "rows", len(frame)
    for header in frame.columns:
        if not LEFT_OUT.fullmatch(header):
            numbers = pd.to_numeric(frame[header], errors="coerce").to_numpy(dtype=float)
            yield from under(f"{header}.", summary(numbers))
            yield from under(f"{header}.", kinds([text for text in frame[header][np.isnan(numbers)] if text]))


def summary(values: np.ndarray) -> Iterator[tuple[str, Value]]:
    """Yield how many values are finite, and of these the mean, spread, first, last, and mean logarithm of the size."""
    finite = values[np.isfinite(values)]
    yield "count", finite.size
    if finite.size:
        logs = np.log(np.abs(finite[finite != 0]))  # they show when a small value among large ones has changed
        moments = {"mean": finite.mean(), "sd": finite.std(), "first": finite[0], "last": finite[-1]}
        yield from ((key, float(value)) for key, value in {**moments, "log": logs.sum() / finite.size}.items())


def kinds(texts: list[str]) -> Iterator[tuple[str, Value]]:
    """Yield how many texts there are, and how often each short one occurs, where there are few kinds."""
    if texts:
        yield "texts", len(texts)
    if len(set(texts)) <= MAX_LIST:
        yield from ((f"texts.{text}", texts.count(text)) for text in sorted(set(texts)) if is_short(text))


def is_short(text: str) -> bool:
    """Return whether a text is one word: a name, a status or a unit, neither prose nor a path."""
    return re.fullmatch(r"[^\s/.]\S{,39}", text) is not None


def compare(options: argparse.Namespace) -> int:
    """Print each number that differs or is on one side only, and how many there are; return 1 when there is any."""
    read = (json.loads(path.read_text(encoding="utf-8")) for path in options.files)
    before, after = (
        {renamed(key): RENAMED.get(str(value), value) for key, value in numbers.items()} for numbers in read
    )
    lines = [
        f"{key}: {before.get(key, 'nothing')} -> {after.get(key, 'nothing')}"
        for key in dict.fromkeys([*before, *after])
        if not same(before.get(key), after.get(key), options.rtol, options.atol)
    ]
    print("\n".join([*lines, f"{len(lines)} differences among {len(before)} numbers before, {len(after)} after"]))
    return 1 if lines else 0


def renamed(key: str) -> str:
    """Return a key with its old names replaced, where they are whole parts of it."""
    for old, new in RENAMED.items():
        key = re.sub(rf"(?<![^/.]){re.escape(old)}(?![^/.])", new.replace("\\", r"\\"), key)
    return key


def same(old: Value | None, new: Value | None, rtol: float, atol: float) -> bool:
    """Return whether two values are equal, numbers within the tolerances; None is equal to None only."""
    if isinstance(old, float | int) and isinstance(new, float | int):
        return math.isclose(old, new, rel_tol=rtol, abs_tol=atol)
    return old == new


if __name__ == "__main__":
    sys.exit(main())
