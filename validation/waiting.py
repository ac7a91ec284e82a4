"""How long people wait: whole commands, from starting Python to the last file, here and in an earlier checkout.

``python -m validation.waiting --before ../earlier`` renders two pendulums that strike one another (55 frames), a
pendulum, and six clips of 3 s, and runs each command in a separate process, in turns with the checkout named; the
fastest turn of each counts, since the first one compiles. ``--data`` adds the recording of two pendulums among others'
data. What a diagnosis reads is what the run before it has written, so ``--only`` names both. Processor time is less
disturbed by what else a machine does than the clock is; the ratio is that of processor times.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from validation import pages

COMMAND = "import sys; from iris_sysid.cli import main; sys.argv[0] = 'iris-sysid'; main()"
PAIR = "two-moving-pendulums"
FOOTAGE = Path("iris_footage") / "Two_Moving_Pendulums.gif"
SIZE = "960x540"


@dataclass(frozen=True)
class Cost:
    """Seconds of the clock and of the processor that one command took."""

    wall_s: float
    processor_s: float


def tasks(folder: Path, data: Path | None) -> dict[str, list[str]]:
    """The commands by what they do; ``{out}`` stands for where they write, ``{own}`` for what this checkout has run.

    Parameters
    ----------
    folder
        Holds what :func:`prepare` made.
    data
        Folder of recordings.
    """
    pair, table = str(folder / "pair.mp4"), str(folder / "pendulum.csv")
    run, diagnose = ["run", "--phenomenon", PAIR, "--force", "-o"], ["diagnose", "--phenomenon", PAIR, "--force", "-o"]
    commands = {
        "list": ["list"],
        "fit, 360 samples": ["fit", table, "--model", "pendulum", "--force", "-o", "{out}.json"],
        "diagnose, 360 samples": ["diagnose", table, "--model", "pendulum", "--force", "-o", "{out}"],
        "run, two pendulums, 55 frames": [*run, "{own}/pair", pair],
        "diagnose, two pendulums, 55 frames": [*diagnose, "{out}", "{own}/pair"],
        "benchmark, six clips of 3 s": ["benchmark", str(folder / "six"), "--force", "-o", "{out}"],
    }
    if data is not None:
        commands["run, filmed pendulums"] = [*run, "{own}/filmed", str(data / FOOTAGE)]
        commands["diagnose, filmed pendulums"] = [*diagnose, "{out}", "{own}/filmed"]
    return commands


def prepare(folder: Path) -> None:
    """Render the clips with the present checkout; what is there already stays."""
    picture = ["--size", SIZE]
    clip = ["render", "--phenomenon", PAIR, "--fps", "20", "--seconds", "2.75", "--seed", "3", *picture]
    six = ["--dataset", str(folder / "six"), "--classes", "pendulum", "--trials", "2", "--seconds", "3"]
    make = {
        "pair.mp4": [*clip, "-o", str(folder / "pair.mp4")],
        "six": ["render", *six, *picture],
    }
    for name, command in make.items():
        if not (folder / name).exists():
            cost_of(pages.ROOT, command)
    write_pendulum(folder / "pendulum.csv")


def write_pendulum(path: Path) -> None:
    """Write 6 s of a pendulum with drag at 60 Hz, with noise of 1 mrad, by SciPy's integrator."""
    import numpy as np
    from scipy.integrate import solve_ivp

    t_s = np.arange(360) / 60
    solved = solve_ivp(
        lambda t, y: [y[1], -0.1 * y[1] - 0.05 * y[1] * abs(y[1]) - 9.80665 / 0.5 * np.sin(y[0])],
        (0.0, float(t_s[-1])),
        [0.8, 0.0],
        t_eval=t_s,
        rtol=1e-9,
    )
    theta = solved.y[0] + 1e-3 * np.random.default_rng(0).standard_normal(t_s.size)
    lines = [f"{t:.6f},{angle:.8f}" for t, angle in zip(t_s, theta, strict=True)]
    path.write_text("t_s,theta_rad\n" + "\n".join(lines) + "\n", encoding="utf-8")


def cost_of(checkout: Path, command: Sequence[str]) -> Cost:
    """Run one command with the package of a checkout; RuntimeError with its last lines where it fails."""
    environment = {**os.environ, "PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *command], cwd=checkout, env=environment, capture_output=True, text=True
    )
    wall_s, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr[-500:]}")
    return Cost(wall_s, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def fastest(checkouts: Mapping[str, Path], command: Sequence[str], folder: Path, turns: int) -> dict[str, Cost]:
    """The turn of least processor time of each checkout, in turns.

    Parameters
    ----------
    checkouts
        By name.
    command
        With ``{out}`` and ``{own}`` as :func:`tasks` has them.
    folder
        For what it writes.
    turns
        How many turns; a fresh checkout compiles in the first.
    """
    costs: dict[str, list[Cost]] = {name: [] for name in checkouts}
    for turn in range(turns):
        for name, checkout in checkouts.items():
            # each turn writes anew: a benchmark does not repeat what it finds
            out, own = folder / f"{name}-{turn}-{command[0]}", folder / name
            costs[name].append(cost_of(checkout, [word.format(out=out, own=own) for word in command]))
    return {name: min(several, key=lambda cost: cost.processor_s) for name, several in costs.items()}


def row(task: str, costs: Mapping[str, Cost]) -> str:
    """One line of the table."""
    seconds = [f"{cost.processor_s:.2g} | {cost.wall_s:.2g}" for cost in costs.values()]
    first, *_, last = costs.values()
    ratio = f"{first.processor_s / last.processor_s:.1f}" if len(costs) > 1 else ""
    return f"| {task} | {' | '.join(seconds)} | {ratio} |"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--before", type=Path, help="checkout of an earlier commit to compare with")
    parser.add_argument("--data", type=Path, help="folder of recordings that others made")
    parser.add_argument("--clips", type=Path, help="folder in which the clips are kept; default: a temporary one")
    parser.add_argument("--only", nargs="+", help="tasks whose name contains one of these")
    parser.add_argument("--turns", type=int, default=2, help="turns, of which the fastest counts")
    pages.add_option(parser)
    options = parser.parse_args()
    checkouts = {"now": pages.ROOT.resolve()}
    if options.before is not None:
        checkouts = {"before": options.before.resolve(), **checkouts}
    data = None if options.data is None else options.data.resolve()
    with tempfile.TemporaryDirectory() as temporary, pages.table("waiting", options.write_docs):
        folder = Path(temporary) if options.clips is None else options.clips.resolve()
        prepare(folder)
        print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
        print(f"| command | {' | '.join(f'processor {name}, s | clock {name}, s' for name in checkouts)} | ratio |")
        print("|---|" + "---:|---:|" * len(checkouts) + "---:|")
        for task, command in tasks(folder, data).items():
            if not options.only or any(part in task for part in options.only):
                print(row(task, fastest(checkouts, command, Path(temporary), options.turns)), flush=True)


if __name__ == "__main__":
    main()
