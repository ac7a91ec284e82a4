"""Processor time of a diagnosis: a pendulum's clip of 600 and of 9,000 samples with 0, 1 or 2 hidden effects.

``python -m validation.search`` prints seconds of processor for the first run, which compiles what it fits, and for the
second, beside one fit of the model alone, and how many fits that is: the ratio holds on any machine.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from fitters.compose_effects import with_effects
from fitters.ode import fit, simulate
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Trajectory
from validation import pages

MODEL = MODELS["pendulum"]
FRAME_RATE_HZ, NOISE_RAD = 60.0, 5e-4
HIDDEN: tuple[dict[str, float], ...] = ({}, {"quadratic-drag": 0.02}, {"quadratic-drag": 0.02, "camera-tilt": 0.02})
Given = TypeVar("Given")


def clip(samples: int, hidden: dict[str, float]) -> Trajectory:
    """A swing with effects of these sizes in it, damped so that it lasts as long as the clip.

    Parameters
    ----------
    samples
        Number of samples at 60 frames a second.
    hidden
        Sizes by effect.
    """
    t_s = np.arange(samples) / FRAME_RATE_HZ
    values = {"length": 0.5, "damping": min(0.03, 1.5 / t_s[-1]), "theta_0": 0.8, "omega_0": 0.0}
    sizes = {EFFECTS[name].parameters[0].name: size for name, size in hidden.items()}
    model = with_effects(MODEL, [EFFECTS[name] for name in hidden])
    seen = simulate(model, t_s, {**values, **sizes}).observed
    seen = seen + NOISE_RAD * np.random.default_rng(1).standard_normal(seen.shape)
    return Trajectory(t_s, MODEL.observed, seen, np.full_like(seen, np.nan), np.ones(samples, dtype=bool))


def timed(work: Callable[[], Given]) -> tuple[Given, float]:
    """Result of a function, and its processor time in s."""
    start = time.process_time()
    return work(), time.process_time() - start


def row(samples: int, hidden: dict[str, float]) -> str:
    """One row of the table."""
    trajectory = clip(samples, hidden)
    first = timed(lambda: diagnose(trajectory, MODEL))[1]
    diagnosis, second = timed(lambda: diagnose(trajectory, MODEL))
    alone = timed(lambda: fit(trajectory, MODEL))[1]
    named = ", ".join(effect.name for effect in diagnosis.added) or "nothing"
    return f"| {samples} | {len(hidden)} | {named} | {first:.1f} | {second:.1f} | {second / alone:.0f} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, nargs="+", default=[600, 9000])
    pages.add_option(parser)
    options = parser.parse_args(arguments)
    fit(clip(600, {}), MODEL)  # compiled before anything is timed
    with pages.table("search", options.write_docs):
        print("| samples | hidden | added | first run, s | second run, s | fits of the model in that time |")
        print("|---|---|---|---|---|---|")
        for samples in options.samples:
            for hidden in HIDDEN:
                print(row(samples, hidden), flush=True)


if __name__ == "__main__":
    main()
