"""Processor time of a fit and a diagnosis of a driven record against the whole library, by its number of samples.

``python -m validation.driven_speed [--samples 4000 40000]``: a cart on a spring under a held voltage, by SciPy's
integrator, with dry friction that the equation lacks. The last column holds on any machine. What numba compiles is
compiled before: a record of WARM samples goes first.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from iris_sysid import Quantity, Trajectory, diagnose, fit, model_from_equation
from iris_sysid.types import Array
from validation.pages import add_option, table

CART = model_from_equation("q'' = (35*u - c*q' - k*q)/m", units={"q": "m", "u": "V", "m": "kg"})
MASS, VISCOUS, STIFFNESS, DRY, GAIN = 9.0, 20.0, 150.0, 12.0, 35.0  # kg, N s/m, N/m, N, N/V
STEP_S, HELD, NOISE_M = 0.005, 20, 2e-4  # of a sample; samples between steps of the voltage; of the position
WARM = 1000

Force = Callable[[float, float], float]  # N, of the position in m and the velocity in m/s


def positions(acting: Array, force: Force | None = None) -> Array:
    """Where the cart is (n,), m, at each sample under a voltage (n,) that is held from one to the next, and a force."""
    state, moved = np.zeros(2), np.zeros(acting.size)
    changes = np.flatnonzero(np.diff(acting, prepend=np.inf))
    for first, last in zip(changes, [*changes[1:], acting.size], strict=True):

        def slope(t: float, now: Array, drive: float = GAIN * float(acting[first])) -> tuple[float, float]:
            more = 0.0 if force is None else force(float(now[0]), float(now[1]))
            return float(now[1]), float((drive - VISCOUS * now[1] - STIFFNESS * now[0] + more) / MASS)

        times = np.arange(last - first + 1) * STEP_S
        solved = solve_ivp(slope, (0.0, times[-1]), state, t_eval=times, rtol=1e-7, atol=1e-9).y
        moved[first:last], state = solved[0, :-1], solved[:, -1]
    return moved


def table_of(seen: Array, voltage: Array) -> Trajectory:
    """The record of positions (n,), m, and of the voltage (n,)."""
    q, valid = seen[:, None], np.ones(seen.size, dtype=np.bool_)
    return Trajectory(
        np.arange(seen.size) * STEP_S,
        (Quantity("q", "m"),),
        q,
        np.full_like(q, np.nan),
        valid,
        CART.inputs,
        voltage[:, None],
        sensor="encoder",
        hold="zero-order",
    )


def dry(size: float, velocity: float) -> float:
    """A friction (N) of a size, against the velocity in m/s, rounded off."""
    return -size * velocity / float(np.hypot(velocity, 1e-2))


def record(samples: int, seed: int = 0) -> Trajectory:
    """The cart for that number of samples; the voltage is drawn anew every HELD of them."""
    rng = np.random.default_rng(seed)
    voltage = np.repeat(rng.uniform(-10, 10, samples // HELD + 1), HELD)[:samples]
    seen = positions(voltage, lambda q, v: dry(DRY, v))
    return table_of(seen + NOISE_M * rng.standard_normal(samples), voltage)


def row(samples: int) -> str:
    """One row of the table."""
    clip = record(samples)
    begin_s = time.process_time()
    fit(clip, CART)
    fitted_s = time.process_time()
    found = diagnose(clip, CART)
    spent_s = fitted_s - begin_s, time.process_time() - fitted_s
    named = ", ".join(effect.name for effect in found.added) or "nothing"
    return f"| {samples} | {named} | {spent_s[0]:.1f} | {spent_s[1]:.1f} | {spent_s[1] / spent_s[0]:.1f} |"


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, nargs="+", default=[4000, 40000], help="lengths of the records")
    add_option(parser)
    options = parser.parse_args()
    with table("driven-speed", options.write_docs):
        row(WARM)
        print("| samples | named | fit, s of processor | diagnosis, s | diagnosis / fit |")
        print("|---|---|---|---|---|")
        for samples in options.samples:
            print(row(samples), flush=True)


if __name__ == "__main__":
    main()
