"""The ODE engine: recovery from starts 50 % off, speed against plain lmfit + solve_ivp, cost to a million samples."""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import lmfit
import numpy as np
from scipy.integrate import solve_ivp

from fitters.models.pendulum import MODEL
from fitters.ode import FitOptions, fit, sensitivity, simulate
from iris_sysid.types import FitResult, Trajectory

NOISE_RAD = 2e-3
FRAME_RATE_HZ = 60.0
NAMES = ("length", "damping", "theta_0", "omega_0")
GRAVITY = 9.80665


def random_truth(rng: np.random.Generator) -> dict[str, float]:
    """A pendulum of 0.2-2 m, 20-120 degrees, damping 0-0.2 1/s, with a push of up to a third of its speed."""
    length = rng.uniform(0.2, 2.0)
    return {
        "length": length,
        "damping": rng.uniform(0.0, 0.2),
        "theta_0": np.deg2rad(rng.uniform(20.0, 120.0)),
        "omega_0": 0.3 * rng.standard_normal() * np.sqrt(GRAVITY / length),
    }


def noisy_pendulum(truth: dict[str, float], duration_s: float, rng: np.random.Generator) -> Trajectory:
    """The pendulum at 60 Hz, with white noise of 2 mrad."""
    t_s = np.arange(int(duration_s * FRAME_RATE_HZ)) / FRAME_RATE_HZ
    theta = simulate(MODEL, t_s, truth).observed
    theta = theta + NOISE_RAD * rng.standard_normal(theta.shape)
    return Trajectory(t_s, MODEL.observed, theta, np.full_like(theta, np.nan), np.ones(t_s.size, dtype=bool))


def recovers(truth: dict[str, float], result: FitResult) -> bool:
    """Whether the global minimum was found: residual at the noise, and every parameter within 6 standard errors."""
    near = all(abs(result.estimates[name].value - truth[name]) < 6 * result.estimates[name].stderr for name in truth)
    return near and bool(abs(result.rms[0] / NOISE_RAD - 1) < 0.2)


def recovery(n_fits: int, *, given: bool, multistart: int, seed: int = 2024) -> tuple[int, list[float]]:
    """Number of random fits that reach the global minimum, and the seconds of each.

    Parameters
    ----------
    n_fits
        Number of fits.
    given
        Start 50 % too low or too high in every parameter; otherwise from the model's own guess.
    multistart
        Random starts allowed after that.
    seed
        Seed of the random pendulums.
    """
    rng = np.random.default_rng(seed)
    recovered, seconds = 0, []
    for _ in range(n_fits):
        truth = random_truth(rng)
        trajectory = noisy_pendulum(truth, rng.uniform(10.0, 150.0), rng)
        start = {name: truth[name] * rng.choice([0.5, 1.5]) for name in NAMES} if given else {}
        began = time.process_time()
        result = fit(trajectory, MODEL, start=start, options=FitOptions(multistart=multistart))
        seconds.append(time.process_time() - began)
        recovered += recovers(truth, result)
    return recovered, seconds


def plain_fit(trajectory: Trajectory, start: dict[str, float]) -> lmfit.minimizer.MinimizerResult:
    """The same fit without the engine: lmfit's leastsq, its own derivatives, solve_ivp at rtol 1e-8."""
    t_s, theta = trajectory.t_s, trajectory.position[:, 0]

    def rhs(t: float, state: Any, length: float, damping: float) -> list[float]:
        return [state[1], -damping * state[1] - GRAVITY / length * np.sin(state[0])]

    def residual(parameters: lmfit.Parameters) -> Any:
        value = parameters.valuesdict()
        initial = [value["theta_0"], value["omega_0"]]
        arguments = (value["length"], value["damping"])
        solution = solve_ivp(rhs, t_s[[0, -1]], initial, t_eval=t_s, args=arguments, rtol=1e-8, atol=1e-10)
        return theta - solution.y[0]

    parameters = lmfit.Parameters()
    for name in NAMES:
        parameters.add(name, value=start[name])
    return lmfit.minimize(residual, parameters)


def seconds_of(action: Callable[[], object], repeats: int = 1) -> float:
    """Median processor time of a few runs, in s: the same on a busy machine."""
    times = []
    for _ in range(repeats):
        began = time.process_time()
        action()
        times.append(time.process_time() - began)
    return float(np.median(times))


COLD = """
import time; began = time.perf_counter()
import numpy as np
from fitters.ode import simulate
from fitters.models.pendulum import MODEL
imported = time.perf_counter()
simulate(MODEL, np.arange(3.0), {"length": 1.0, "theta_0": 1.0, "omega_0": 0.0})
print(imported - began, time.perf_counter() - imported)
"""


def cold_start_s() -> tuple[float, float]:
    """Seconds to import the engine (its integrator from the disk cache), and to compile the first model."""
    printed = subprocess.run([sys.executable, "-c", COLD], check=True, capture_output=True, text=True).stdout
    imported, compiled = map(float, printed.split())
    return imported, compiled


def print_recovery(n_fits: int) -> None:
    """Print the recovery table."""
    print(
        f"Recovery of {n_fits} random pendulums: 0.2-2 m, 20-120 degrees, damping 0-0.2 1/s, 10-150 s at 60 Hz, 2 mrad"
    )
    cases = (
        ("starts 50 % off, growing horizon alone", True, 0),
        ("starts 50 % off, as by default", True, 8),
        ("no start given", False, 8),
    )
    for text, given, multistart in cases:
        recovered, seconds = recovery(n_fits, given=given, multistart=multistart)
        print(
            f"  {text:<40} {recovered:4d} of {n_fits}   median {np.median(seconds):.3f} s, longest {max(seconds):.3f} s"
        )


def print_speed() -> None:
    """Print the time of one long fit, against the plain one."""
    rng = np.random.default_rng(9000)
    truth = {"length": 0.5, "damping": 0.02, "theta_0": 1.0, "omega_0": 0.0}
    trajectory = noisy_pendulum(truth, 150.0, rng)
    start = {name: float(value) for name, value in MODEL.guess(trajectory).items()}
    fit(trajectory, MODEL)
    ours_s = seconds_of(lambda: fit(trajectory, MODEL), repeats=5)
    began = time.process_time()
    plain = plain_fit(trajectory, start)
    plain_s = time.process_time() - began
    result = fit(trajectory, MODEL)
    print(f"\nOne fit of {trajectory.n} samples, 150 s, both from the model's guess (processor time)")
    print(f"  {'':<28} {'time':>9}   length / m")
    for text, seconds, value, stderr in (
        ("iris-sysid (warm)", ours_s, result.estimates["length"].value, result.estimates["length"].stderr),
        ("lmfit + solve_ivp", plain_s, plain.params["length"].value, plain.params["length"].stderr),
    ):
        print(f"  {text:<28} {seconds:7.3f} s   {value:.7f} +- {stderr:.7f}")
    print(f"  ratio {plain_s / ours_s:.0f}")
    imported, compiled = cold_start_s()
    print(f"  cold, in a new process: import {imported:.2f} s, compile the model {compiled:.2f} s")


def print_cost() -> None:
    """Print how the cost grows with the number of samples."""
    print("\nCost of one integration, of the four sensitivities, and of a whole fit")
    print(f"  {'samples':>9} {'integrate':>12} {'sensitivity':>12} {'fit':>12}   per sample")
    truth = {"length": 0.5, "damping": 1e-4, "theta_0": 1.0, "omega_0": 0.0}
    for n in (10_000, 100_000, 1_000_000):
        trajectory = noisy_pendulum(truth, n / FRAME_RATE_HZ, np.random.default_rng(n))
        times = [
            seconds_of(lambda t_s=trajectory.t_s: simulate(MODEL, t_s, truth)),
            seconds_of(lambda t_s=trajectory.t_s: sensitivity(MODEL, t_s, truth, NAMES)),
            seconds_of(lambda data=trajectory: fit(data, MODEL)),
        ]
        per_sample = ", ".join(f"{1e6 * seconds / n:.2f}" for seconds in times)
        print(f"  {n:9d} " + " ".join(f"{seconds:10.3f} s" for seconds in times) + f"   {per_sample} us")


def main() -> None:
    """Print the three tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fits", type=int, default=100, help="number of random pendulums")
    arguments = parser.parse_args()
    print_recovery(arguments.fits)
    print_speed()
    print_cost()


if __name__ == "__main__":
    main()
