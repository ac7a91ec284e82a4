"""Impacts against a continuous coupling on the real and the rendered pendulums, and the bias of the linear pendulum."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fitters.integrator.event_times import event_times
from fitters.ode import FitOptions, fit, simulate
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.pipeline.one_clip import observe, track
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.synthetic import read_truth, render_clip
from iris_sysid.types import FitResult, TrackOptions, Trajectory
from iris_sysid.video.reader import open_video
from validation import pages

FOOTAGE = Path("..") / "shared" / "data" / "iris_footage" / "Two_Moving_Pendulums.gif"
PAIRS = ("two-moving-pendulums", "two-moving-pendulum-one-static")
SETTINGS = ("pendulum_20", "pendulum_45", "pendulum_90")
VALUES = ("length_1", "length_2", "restitution")
FPS, SIZE, DURATION_S = 60.0, (960, 540), 4.0


def tracked(clip: Path, phenomenon: str) -> Trajectory:
    """Both angles of a clip."""
    tracks = track(open_video(clip), PHENOMENA[phenomenon].tracker, TrackOptions(bodies=2))
    return observe(tracks, uncalibrated(), phenomenon)[1]


def both_fits(trajectory: Trajectory, phenomenon: str) -> tuple[FitResult, FitResult]:
    """The fit with impacts, and the one with the continuous coupling."""
    chosen = PHENOMENA[phenomenon]
    impacts = fit(trajectory, MODELS[chosen.model], free=chosen.free)
    return impacts, fit(trajectory, MODELS["coupled-pendulums"], options=FitOptions(multistart=2))


def residuals(result: FitResult) -> str:
    """Residual of both angles and the status."""
    return f"{1e3 * result.rms[0]:.3g}, {1e3 * result.rms[1]:.3g} ({result.status})"


def print_comparison(clips: Sequence[tuple[str, Trajectory, str]]) -> None:
    """Print the residual of both models, and the estimates of the model with impacts."""
    print("| clip | residual, impacts / mrad | residual, kappa / mrad | L1 / m | L2 / m | e | kappa / s^-2 |")
    print("|---|---|---|---|---|---|---|")
    for name, trajectory, phenomenon in clips:
        impacts, spring = both_fits(trajectory, phenomenon)
        shown = [f"{impacts.estimates[k].value:.4f} ± {impacts.estimates[k].stderr:.2g}" for k in VALUES]
        kappa = f"{spring.estimates['coupling'].value:.2f}"
        print(f"| {name} | {residuals(impacts)} | {residuals(spring)} | {' | '.join(shown)} | {kappa} |", flush=True)


def print_twin(folder: Path) -> None:
    """Print the largest errors on rendered and tracked clips."""
    print("\n| synthetic clip | L1 / % | L2 / % | e / % | impacts found | largest error of an impact's time / frames |")
    print("|---|---|---|---|---|---|")
    for phenomenon in PAIRS:
        for setting in SETTINGS:
            clip = folder / f"{phenomenon}-{setting}.mp4"
            render_clip(phenomenon, clip, size=SIZE, fps=FPS, duration_s=DURATION_S, setting=setting, seed=3)
            truth, trajectory = read_truth(clip), tracked(clip, phenomenon)
            chosen = PHENOMENA[phenomenon]
            result = fit(trajectory, MODELS[chosen.model], free=chosen.free)
            times = impact_times(result, trajectory)
            true = [t for t, name in truth.events if name == "impact" and result.t0_s < t < trajectory.t_s[-1]]
            pairs = min(len(times), len(true), 6)
            late = max((abs(a - b) for a, b in zip(times[:pairs], true[:pairs], strict=True)), default=np.nan)
            errors = [100 * (result.estimates[k].value / truth.parameters[k].value - 1) for k in VALUES]
            row = " | ".join(f"{error:+.3f}" for error in errors)
            print(f"| {phenomenon} {setting} | {row} | {len(times)} of {len(true)} | {late * FPS:.3f} |", flush=True)


def impact_times(result: FitResult, trajectory: Trajectory) -> list[float]:
    """Times of the impacts in the fitted motion."""
    derived = {quantity.name for quantity in result.model.derived}
    values = {name: estimate.value for name, estimate in result.estimates.items() if name not in derived}
    t_s = trajectory.t_s[trajectory.t_s >= result.t0_s]
    return [event_time.t_s for event_time in event_times(result.model, t_s, values) if event_time.name == "impact"]


def print_linear_bias() -> None:
    """Print the length that the linear and the exact equation give for a pendulum of 0.5 m without damping."""
    print("\n| angle | linear-pendulum: error of L / % | pendulum: error of L / % |\n|---|---|---|")
    t_s = np.arange(600) / FPS
    for degrees in (20, 45, 90):
        truth = {"length": 0.5, "damping": 0.0, "theta_0": np.deg2rad(degrees), "omega_0": 0.0}
        theta = simulate(MODELS["pendulum"], t_s, truth).observed
        theta = theta + 1e-4 * np.random.default_rng(0).standard_normal(theta.shape)
        valid = np.ones(t_s.size, dtype=bool)
        data = Trajectory(t_s, MODELS["pendulum"].observed, theta, np.full_like(theta, np.nan), valid)
        lengths = [fit(data, MODELS[name]).estimates["length"].value for name in ("linear-pendulum", "pendulum")]
        print(f"| {degrees}° | " + " | ".join(f"{100 * (length / 0.5 - 1):+.3f}" for length in lengths) + " |")


def main() -> None:
    """Print the tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("impacts-linear-pendulum", options.write_docs):
        print_linear_bias()
    with pages.table("impacts", options.write_docs):
        if FOOTAGE.is_file():
            print()
            name = "two-moving-pendulums"
            print_comparison([("the benchmark's footage, 10 frames a second", tracked(FOOTAGE, name), name)])
        with tempfile.TemporaryDirectory() as temporary:
            print_twin(Path(temporary))


if __name__ == "__main__":
    np.seterr(all="ignore")
    main()
