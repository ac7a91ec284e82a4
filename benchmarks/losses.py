"""The latent pipeline's losses and integrators on tracked angles: what of its error is the loss, what the encoder."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from benchmarks.recovery import NOISE_PX, SIZE, best_latent, through_phenomenon
from fitters.ode import fit, simulate
from iris_sysid.registry import MODELS
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.types import Array, Trajectory

GRAVITY = 9.80665
START = np.array([0.5, 0.05])  # gamma_0 and gamma_1 before training, as the paper has them
WEIGHTS = np.array([1.0, 1.0, 0.5, 0.5, 0.25])  # of the horizons 1 to 5, as the paper has them
TRAINED, AHEAD = 100, (10, 25, 50)  # frames
FRAMES = 1200  # 20 s at 60 Hz
SETTINGS = ("pendulum_20", "pendulum_45", "pendulum_90")

Pull = Callable[[Array, Array], Array]
Step = Callable[[Array, Array, float, Pull], tuple[Array, Array]]


def without_acceleration(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Euler's step: the position does not feel the acceleration."""
    return z + dt * v, v + dt * pull(z, v)


def euler_cromer(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """The corrected step of the paper: the position moves with the new velocity."""
    v = v + dt * pull(z, v)
    return z + dt * v, v


def stoermer_verlet(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Half a kick, a drift, half a kick."""
    half = v + dt / 2 * pull(z, v)
    z = z + dt * half
    return z, half + dt / 2 * pull(z, half)


def runge_kutta(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """The classical method of order 4."""
    k1, l1 = v, pull(z, v)
    k2, l2 = v + dt / 2 * l1, pull(z + dt / 2 * k1, v + dt / 2 * l1)
    k3, l3 = v + dt / 2 * l2, pull(z + dt / 2 * k2, v + dt / 2 * l2)
    k4, l4 = v + dt * l3, pull(z + dt * k3, v + dt * l3)
    return z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4), v + dt / 6 * (l1 + 2 * l2 + 2 * l3 + l4)


def yoshida(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Three Stoermer-Verlet steps of order 4 (Yoshida 1990, Phys. Lett. A 150, 262)."""
    outer = 1 / (2 - 2 ** (1 / 3))
    for part in (outer, 1 - 2 * outer, outer):
        z, v = stoermer_verlet(z, v, part * dt, pull)
    return z, v


INTEGRATORS: dict[str, Step] = {
    "no acceleration in z": without_acceleration,
    "Euler-Cromer": euler_cromer,
    "Stoermer-Verlet": stoermer_verlet,
    "RK4": runge_kutta,
    "Yoshida-4": yoshida,
}


def misses(gamma: Array, theta: Array, dt: float, step: Step, horizons: int, bend: Callable[[Array], Array]) -> Array:
    """Weighted differences of all windows: the angle after 1 to ``horizons`` steps less the tracked one.

    The velocity at the start of a window is the backward difference of the tracked angle.
    """
    z, v = theta[1 : theta.size - horizons], np.diff(theta)[: theta.size - horizons - 1] / dt
    parts = []
    for k in range(1, horizons + 1):
        z, v = step(z, v, dt, lambda z, v: -gamma[1] * v - gamma[0] * bend(z))
        parts.append(np.sqrt(WEIGHTS[k - 1]) * (z - theta[1 + k : theta.size - horizons + k]))
    return np.concatenate(parts)


def length_of(theta: Array, dt: float, step: Step, horizons: int, bend: Callable[[Array], Array]) -> float:
    """Length that a loss gives, minimised exactly from the paper's start; NaN where it has no gradient."""
    found = least_squares(misses, START, args=(theta, dt, step, horizons, bend), x_scale="jac")
    if np.allclose(found.x[0], START[0], rtol=1e-6):
        return np.nan
    return GRAVITY / float(found.x[0])


@functools.cache
def clip(setting: str, seed: int) -> Trajectory:
    """The angle of one of the twin's pendulums as a tracker sees it."""
    plan = plan_clip("pendulum", setting=setting, size=SIZE, duration_s=FRAMES / 60 + 1, seed=seed)
    make = through_phenomenon("pendulum", {"length": "length"})
    return make(plan.truth, np.random.default_rng(seed)).trajectory


def in_motion(trajectory: Trajectory) -> tuple[Array, Array]:
    """Times and angles from the release on."""
    used = np.flatnonzero(trajectory.valid & trajectory.mask("motion"))[:FRAMES]
    return trajectory.t_s[used], trajectory.position[used, 0]


def loss_row(name: str, horizons: int, bend: Callable[[Array], Array], seeds: Sequence[int]) -> list[str]:
    """Median error of the length, in %, one entry for each setting."""
    row = []
    for setting in SETTINGS:
        errors = []
        for seed in seeds:
            t_s, theta = in_motion(clip(setting, seed))
            dt = float(np.median(np.diff(t_s)))
            errors.append(100 * abs(length_of(theta, dt, INTEGRATORS[name], horizons, bend) / 0.5 - 1))
        size = float(np.median(errors))
        row.append(f"{size:.2f}" if np.isfinite(size) else "no gradient")
    return row


def engine_row(model: str, seeds: Sequence[int]) -> list[str]:
    """The same for a fit of the trajectory itself."""
    row = []
    for setting in SETTINGS:
        fits = [fit(clip(setting, seed), MODELS[model]) for seed in seeds]
        row.append(f"{100 * np.median([abs(one.estimates['length'].value / 0.5 - 1) for one in fits]):.4g}")
    return row


def extrapolated(setting: str, seeds: Sequence[int], model: str) -> list[str]:
    """Mean and standard deviation of the error k frames beyond the first 100, in mrad."""
    errors = []
    for seed in seeds:
        trajectory = clip(setting, seed)
        t_s, theta = in_motion(trajectory)
        valid = trajectory.valid & (trajectory.t_s <= t_s[TRAINED - 1])
        result = fit(trajectory.with_(valid=valid), MODELS[model])
        values = {name: one.value for name, one in result.estimates.items() if np.isfinite(one.value)}
        predicted = simulate(MODELS[model], t_s[: TRAINED + AHEAD[-1]], values).observed[:, 0]
        errors.append([1e3 * abs(predicted[TRAINED + k - 1] - theta[TRAINED + k - 1]) for k in AHEAD])
    return [f"{m:.3g} ± {s:.2g}" for m, s in zip(np.mean(errors, axis=0), np.std(errors, axis=0), strict=True)]


def main() -> None:
    """Print both tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=5, help="clips of each setting")
    seeds = range(parser.parse_args().trials)
    print(f"Error of the length / %, median of {len(seeds)} tracked pendulums of {FRAMES} frames, {NOISE_PX} px noise")
    print("| loss | integrator | equation | 20° | 45° | 90° |\n|---|---|---|---|---|---|")
    for horizons, loss in ((1, "one-step"), (5, "five-step")):
        for name in INTEGRATORS:
            for equation, bend in (("linear", np.asarray), ("sine", np.sin)):
                print(
                    f"| {loss} | {name} | {equation} | {' | '.join(loss_row(name, horizons, bend, seeds))} |",
                    flush=True,
                )
    for equation, model in (("linear", "linear-pendulum"), ("sine", "pendulum")):
        print(f"| whole trajectory | order 8 | {equation} | {' | '.join(engine_row(model, seeds))} |")
    published = [f"{100 * best_latent('Pendulum', setting, 'length') / 0.5:.0f}" for setting in SETTINGS]
    print(f"| published, best of both losses | with the encoder | linear | {' | '.join(published)} |")
    print(f"\nError k frames beyond the first {TRAINED} / mrad, mean ± sd of {len(seeds)} clips")
    print("| setting | equation | k = 10 | k = 25 | k = 50 |\n|---|---|---|---|---|")
    for setting in SETTINGS:
        for equation, model in (("linear", "linear-pendulum"), ("sine", "pendulum")):
            print(f"| {setting} | {equation} | {' | '.join(extrapolated(setting, seeds, model))} |", flush=True)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
