"""Long tables: processor time and memory of `fit` and `diagnose`, against curve_fit + solve_ivp on the same table.

The table is a pendulum with a quadratic drag that the model lacks for `diagnose`, and without it for `fit`, solved by
SciPy, with white noise. SciPy's fit is of the complete equation, starts 0.01 % off the truth, and gives no more than
values and the errors for white noise.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp
from scipy.optimize import curve_fit

from iris_sysid.types import Array
from validation import pages

TRUTH = {"length": 1.2, "damping": 0.002, "drag": 0.02, "theta_0": 0.6, "omega_0": 0.0}
GRAVITY, NOISE_RAD, RATE_HZ = 9.80665, 2e-3, 240.0
SCIPY_ROWS = 100_000  # beyond, the comparison is left out
PROGRAM = str(Path(sys.executable).with_name("iris-sysid"))


@dataclass(frozen=True, slots=True)
class Cost:
    """Processor time in s and largest resident memory in MB of a process."""

    cpu_s: float
    memory_mb: float


def swing(t_s: Array, length: float, damping: float, drag: float, theta_0: float, omega_0: float) -> Array:
    """Angles (n,) in rad of a damped pendulum with quadratic drag."""

    def rhs(_: float, state: Array) -> tuple[float, float]:
        theta, omega = state
        return omega, -GRAVITY / length * np.sin(theta) - damping * omega - drag * abs(omega) * omega

    solution = solve_ivp(rhs, t_s[[0, -1]], (theta_0, omega_0), t_eval=t_s, method="DOP853", rtol=1e-9, atol=1e-11)
    return np.asarray(solution.y[0])


def write_table(path: Path, rows: int, drag: float, seed: int = 1) -> None:
    """A table of so many samples at RATE_HZ."""
    t_s = np.arange(rows) / RATE_HZ
    theta = swing(t_s, **{**TRUTH, "drag": drag}) + NOISE_RAD * np.random.default_rng(seed).standard_normal(rows)
    np.savetxt(path, np.c_[t_s, theta], delimiter=",", header="t_s,theta_rad", comments="", fmt=["%.9f", "%.8f"])


def by_scipy(path: Path, drag: float) -> None:
    """Fit the table at ``path`` with curve_fit over solve_ivp, and print each value with its error."""
    t_s, theta = np.loadtxt(path, delimiter=",", skiprows=1).T
    free = [name for name in TRUTH if drag or name != "drag"]

    def model(times_s: Array, *values: float) -> Array:
        return swing(times_s, **{**TRUTH, "drag": 0.0, **dict(zip(free, values, strict=True))})

    start = [TRUTH[name] * 1.0001 + 1e-6 for name in free]
    values, covariance = curve_fit(model, t_s, theta, p0=start)
    for name, value, stderr in zip(free, values, np.sqrt(np.diag(covariance)), strict=True):
        print(f"{name} {value:.9g} +- {stderr:.2g}")


def cost(command: list[str]) -> Cost:
    """Run a command, and say what it took."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise RuntimeError(f"{' '.join(command)} ended with {status}")
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3)


def row(task: str, rows: int, folder: Path, scipy: bool) -> dict[str, str | int]:
    """One row of the table: the command, and SciPy on the same table where wanted."""
    drag, table = TRUTH["drag"] if task == "diagnose" else 0.0, folder / f"{task}{rows}.csv"
    write_table(table, rows, drag)
    ours = cost([PROGRAM, task, str(table), "--model", "pendulum", "-o", str(folder / f"{task}{rows}")])
    said: dict[str, str | int] = {"command": task, "rows": rows, "processor, s": f"{ours.cpu_s:.1f}"}
    said["memory, MB"] = round(ours.memory_mb)
    if scipy and rows <= SCIPY_ROWS:
        theirs = cost([sys.executable, "-m", "validation.large", "--scipy", str(table), "--drag", str(drag)])
        said["curve_fit, s"], said["curve_fit, MB"] = f"{theirs.cpu_s:.1f}", str(round(theirs.memory_mb))
        said["ratio of times"] = f"{theirs.cpu_s / ours.cpu_s:.1f}"
    return said


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fit", type=int, nargs="*", default=[10**4, 10**5, 10**6], help="rows of tables to fit")
    parser.add_argument("--diagnose", type=int, nargs="*", default=[10**4, 10**5], help="rows of tables to diagnose")
    parser.add_argument("--no-scipy", action="store_true", help="leave out the comparison")
    parser.add_argument("--scipy", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--drag", type=float, default=0.0, help=argparse.SUPPRESS)
    pages.add_option(parser)
    options = parser.parse_args()
    if options.scipy:
        by_scipy(options.scipy, options.drag)
        return
    with tempfile.TemporaryDirectory() as folder, pages.table("large", options.write_docs):
        sizes = [*(("fit", rows) for rows in options.fit), *(("diagnose", rows) for rows in options.diagnose)]
        rows = [row(task, count, Path(folder), not options.no_scipy) for task, count in sizes]
        print(pages.markdown(pd.DataFrame(rows).fillna("")))


if __name__ == "__main__":
    main()
