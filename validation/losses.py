"""The latent pipeline's losses and integrators on tracked angles: error due to the loss or the encoder."""

from __future__ import annotations

import argparse
import functools
from collections.abc import Sequence

import numpy as np

from fitters.ode import fit, simulate
from iris_sysid.registry import MODELS
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.types import Array, Trajectory
from validation import pages
from validation.latent_losses import BENDS, HORIZONS, INTEGRATORS, stiffness_of
from validation.recovery import NOISE_PX, SIZE, best_latent, through_phenomenon

GRAVITY = 9.80665
TRAINED, AHEAD = 100, (10, 25, 50)  # frames
FRAMES = 1200  # 20 s at 60 Hz
SETTINGS = ("pendulum_20", "pendulum_45", "pendulum_90")


@functools.cache
def clip(setting: str, seed: int) -> Trajectory:
    """The angle of a synthetic pendulum as a tracker measures it."""
    plan = plan_clip("pendulum", setting=setting, size=SIZE, duration_s=FRAMES / 60 + 1, seed=seed)
    make = through_phenomenon("pendulum", {"length": "length"})
    return make(plan.truth, np.random.default_rng(seed)).trajectory


def in_motion(trajectory: Trajectory) -> tuple[Array, Array]:
    """Times and angles from the release on."""
    used = np.flatnonzero(trajectory.valid & trajectory.mask("motion"))[:FRAMES]
    return trajectory.t_s[used], trajectory.position[used, 0]


def loss_row(name: str, loss: str, equation: str, seeds: Sequence[int]) -> list[str]:
    """Median error of the length, in %, one entry for each setting."""
    row = []
    for setting in SETTINGS:
        errors = []
        for seed in seeds:
            t_s, theta = in_motion(clip(setting, seed))
            dt = float(np.median(np.diff(t_s)))
            stiffness = stiffness_of(theta, dt, INTEGRATORS[name], HORIZONS[loss], BENDS[equation])
            errors.append(100 * abs(GRAVITY / stiffness / 0.5 - 1))
        size = float(np.median(errors))
        row.append(f"{size:.2f}" if np.isfinite(size) else "no gradient")
    return row


def engine_row(model: str, seeds: Sequence[int]) -> list[str]:
    """The same for a fit of the trajectory itself."""
    row = []
    for setting in SETTINGS:
        fits = [fit(clip(setting, seed), MODELS[model]) for seed in seeds]
        row.append(f"{100 * np.median([abs(fit.estimates['length'].value / 0.5 - 1) for fit in fits]):.4g}")
    return row


def extrapolated(setting: str, seeds: Sequence[int], model: str) -> list[str]:
    """Mean and standard deviation of the error k frames beyond the first 100, in mrad."""
    errors = []
    for seed in seeds:
        trajectory = clip(setting, seed)
        t_s, theta = in_motion(trajectory)
        valid = trajectory.valid & (trajectory.t_s <= t_s[TRAINED - 1])
        result = fit(trajectory.with_(valid=valid), MODELS[model])
        values = {name: estimate.value for name, estimate in result.estimates.items() if np.isfinite(estimate.value)}
        predicted = simulate(MODELS[model], t_s[: TRAINED + AHEAD[-1]], values).observed[:, 0]
        errors.append([1e3 * abs(predicted[TRAINED + k - 1] - theta[TRAINED + k - 1]) for k in AHEAD])
    return [f"{m:.3g} ± {s:.2g}" for m, s in zip(np.mean(errors, axis=0), np.std(errors, axis=0), strict=True)]


def main() -> None:
    """Print both tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=5, help="clips of each setting")
    pages.add_option(parser)
    options = parser.parse_args()
    seeds = range(options.trials)
    with pages.table("losses", options.write_docs):
        print(
            f"Error of the length / %, median of {len(seeds)} tracked pendulums of {FRAMES} frames, {NOISE_PX} px noise"
        )
        print("| loss | integrator | equation | 20° | 45° | 90° |\n|---|---|---|---|---|---|")
        for loss in HORIZONS:
            for name in INTEGRATORS:
                for equation in BENDS:
                    print(
                        f"| {loss} | {name} | {equation} | {' | '.join(loss_row(name, loss, equation, seeds))} |",
                        flush=True,
                    )
        for equation, model in (("linear", "linear-pendulum"), ("sine", "pendulum")):
            print(f"| whole trajectory | order 8 | {equation} | {' | '.join(engine_row(model, seeds))} |")
        published = [f"{100 * best_latent('Pendulum', setting, 'length') / 0.5:.0f}" for setting in SETTINGS]
        print(f"| published, best of both losses | with the encoder | linear | {' | '.join(published)} |")
    with pages.table("losses-extrapolation", options.write_docs):
        print(f"\nError k frames beyond the first {TRAINED} / mrad, mean ± sd of {len(seeds)} clips")
        print("| setting | equation | k = 10 | k = 25 | k = 50 |\n|---|---|---|---|---|")
        for setting in SETTINGS:
            for equation, model in (("linear", "linear-pendulum"), ("sine", "pendulum")):
                print(f"| {setting} | {equation} | {' | '.join(extrapolated(setting, seeds, model))} |", flush=True)


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
