"""Angle, orientation, intensity, level and apparent radius on synthetic clips: errors and pulls.

``python -m validation.observables`` renders short clips of several settings and seeds and prints one row a clip.
The zero of orientation and intensity, and the scale of intensity, come from the truth: a clip does not show them.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iris_sysid import PHENOMENA, TRACKERS, open_video
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.pipeline.one_clip import observe
from iris_sysid.synthetic import Truth, render_clip
from iris_sysid.types import Array, Track, TrackOptions
from validation import pages


@dataclass(frozen=True)
class Observable:
    """One observable of a scene: error and standard error (n,) of the usable samples, unit and target RMSE."""

    name: str
    scene: str
    tracker: str
    settings: tuple[str, ...]
    duration_s: float
    fps: float
    error: Callable[[Track, Truth], tuple[Array, Array]]
    unit: str
    target: float | None


def column(truth: Truth, name: str) -> Array:
    """One column (n,) of the truth."""
    return truth.table[name].to_numpy(float)


def of_pendulum(track: Track, truth: Truth) -> tuple[Array, Array]:
    """Angle about the pivot fitted to the arc, in the motion segment."""
    _, trajectory = observe([track], uncalibrated(), "pendulum")
    used = trajectory.valid & trajectory.mask("motion")
    error = trajectory.position[:, 0] - column(truth, "theta_rad")
    return np.degrees(error[used]), np.degrees(trajectory.sigma[used, 0])


def of_orientation(track: Track, truth: Truth) -> tuple[Array, Array]:
    """Angle of the arm, in all frames that show it."""
    assert track.angle_rad is not None
    assert track.sigma_angle_rad is not None
    error = track.angle_rad - column(truth, "phi_rad")
    error -= np.median(error[track.valid])
    return np.degrees(error[track.valid]), np.degrees(track.sigma_angle_rad[track.valid])


def of_intensity(track: Track, truth: Truth) -> tuple[Array, Array]:
    """Light over its full brightness, in percent."""
    assert track.intensity is not None
    assert track.sigma_intensity is not None
    light = column(truth, "intensity_1")
    slope, start = np.polyfit(light, track.intensity, 1)
    return 100 * (track.intensity - start - slope * light) / slope, 100 * track.sigma_intensity / slope


def of_level(track: Track, truth: Truth) -> tuple[Array, Array]:
    """Row of the surface."""
    error = track.xy_px[:, 1] - column(truth, "y_px")
    return error[track.valid], track.sigma_px[track.valid, 1]


def of_radius(track: Track, truth: Truth) -> tuple[Array, Array]:
    """Apparent radius, in the motion segment."""
    assert track.radius_px is not None
    assert track.sigma_radius_px is not None
    used = track.valid & (truth.table.phase == "motion").to_numpy()
    return (track.radius_px - column(truth, "radius_px"))[used], track.sigma_radius_px[used]


OBSERVABLES = (
    Observable("orientation", "rotating-cone", "orientation", ("slow", "mid", "fast"), 5, 20, of_orientation,
               "deg", 0.1),
    Observable("intensity", "led", "intensity", ("led_2s", "led_5s", "led_10s"), 4, 60, of_intensity, "%", 0.5),
    Observable("level", "torricelli", "level", ("small", "medium", "large"), 8, 30, of_level, "px", 0.1),
    Observable("angle", "pendulum", PHENOMENA["pendulum"].tracker, ("pendulum_45", "pendulum_90"), 3, 60, of_pendulum,
               "deg", 0.05),
    Observable("radius", "falling-ball", "disc", ("big",), 1.0, 60, of_radius, "px", None),
)  # fmt: skip


def rows(observable: Observable, size: tuple[int, int], seeds: int) -> Iterator[str]:
    """One row a clip."""
    for number, setting in enumerate(observable.settings * seeds):
        seed = 1 + number
        with tempfile.TemporaryDirectory() as folder:
            clip = Path(folder) / "clip.mp4"
            length, fps = observable.duration_s, observable.fps
            truth = render_clip(
                observable.scene, clip, setting=setting, seed=seed, size=size, duration_s=length, fps=fps
            )
            (track,) = TRACKERS[observable.tracker].track(open_video(clip), TrackOptions())
        error, sigma = observable.error(track, truth)
        rmse, pull = float(np.sqrt(np.mean(error**2))), float(np.std(error / sigma))
        target = "" if observable.target is None else f"{observable.target:g}"
        measured = f"{rmse:.4f} {observable.unit} | {target} | {pull:.2f}"
        yield f"| {observable.name} | {setting} | {seed} | {error.size} | {measured} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, nargs=2, default=(640, 360), help="width and height, px")
    parser.add_argument("--seeds", type=int, default=1, help="clips of each setting")
    parser.add_argument("--only", choices=[observable.name for observable in OBSERVABLES], help="one observable alone")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("observables", options.write_docs):
        print(
            "| observable | setting | seed | samples | RMSE | target | sd of error / sigma |\n"
            "|---|---|---|---|---|---|---|"
        )
        for observable in OBSERVABLES:
            if options.only in (None, observable.name):
                for row in rows(observable, tuple(options.size), options.seeds):
                    print(row, flush=True)


if __name__ == "__main__":
    main()
