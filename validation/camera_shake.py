"""Hand-held clips: length and g of a pendulum, and g of a throw, with and without a hand's shake.

``python -m validation.camera_shake`` draws each scene twice before a textured wall (``independent/shaken_scene.py``):
from a tripod, and with a shake of 5 px rms along each axis and 2 mrad of turn (1 to 8 Hz, amplitude as 1/f). Both are
compressed, read, tracked, observed and fitted as a user's clip would be, nothing adjusted. The motion is SciPy's, the
camera OpenCV's. Seeds below 1,000 may be looked at; those from 1,000 on are sealed, for the table.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from iris_sysid import Estimate, IrisError, open_video, scale
from iris_sysid.pipeline.one_clip import observe_and_fit, track
from iris_sysid.registry import PHENOMENA
from validation import pages
from validation.independent.motions import GRAVITY, MOTIONS, Array, integrate
from validation.independent.shaken_scene import Shake, Studio, hand_shake, wall, write_clip

SIZE_PX = (320, 240)
PX_PER_M = 300.0
SCALE_STDERR = 1e-4  # relative; so small that the error of the track counts
RADIUS_PX = 9.0
BALL_BGR = (40.0, 60.0, 210.0)
EXPOSURE_S, MOMENTS = 1 / 240, 5
ENCODER = {"crf": "18"}  # about 0.1 bits a pixel, as a phone's
CONTRAST, NOISE = (3.0, 10.0), 2.0  # grey levels; the contrast of the wall is drawn from a range
SEALED = 1_000
SHAKES = {"tripod": Shake(0.0, 0.0), "hand": Shake()}


@dataclass(frozen=True, slots=True)
class Scene:
    """A motion before the camera; ``aim_m`` is seen at the centre, ``measured`` what is estimated, given the rest."""

    phenomenon: str
    frames: int
    fps: int
    ranges: Mapping[str, tuple[float, float]]
    aim_m: tuple[float, float]
    measured: tuple[str, ...]


SCENES = (
    Scene(
        "pendulum",
        150,
        50,
        {"length": (0.4, 0.5), "damping": (0.02, 0.08), "x0": (0.35, 0.6), "v0": (-0.3, 0.3)},
        (0.0, -0.33),
        ("length", "gravity"),
    ),
    Scene(
        "projectile",
        64,
        120,
        {"x0": (-0.4, -0.35), "x1": (-0.25, -0.15), "v0": (1.2, 1.4), "v1": (2.2, 2.5)},
        (0.0, 0.05),
        ("gravity",),
    ),
)


@dataclass(frozen=True, slots=True)
class Outcome:
    """One value of one clip: error over the truth and over the standard error; ``refused`` where there is none."""

    scene: str
    camera: str
    seed: int
    name: str
    relative: float = float("nan")
    off: float = float("nan")
    inside: bool = False
    stated: float = float("nan")
    refused: str = ""


def places(scene: Scene, values: Mapping[str, float], t_s: Array) -> Array:
    """Places (n, 2) px of the ball in the still scene at times (n,) s.

    Parameters
    ----------
    scene
        What moves.
    values
        Its parameters and initial values.
    t_s
        Ascending.
    """
    motion = MOTIONS[scene.phenomenon]
    observed = integrate(motion, values, t_s)[:, : motion.size]
    if scene.phenomenon == "pendulum":
        angle, length = observed[:, 0], values["length"]
        observed = np.column_stack([length * np.sin(angle), -length * np.cos(angle)])
    away_m = (observed - np.array(scene.aim_m)) * np.array([1.0, -1.0])
    return np.asarray(away_m * PX_PER_M + np.array(SIZE_PX) / 2)


def film(scene: Scene, shake: Shake, seed: int, path: Path) -> dict[str, float]:
    """Draw a clip and encode it; the same seed gives the same motion and wall with every camera.

    Parameters
    ----------
    scene, shake
        What is filmed, and how.
    seed
        Of the motion, the wall, the shake and the noise.
    path
        The clip.
    """
    of_motion, of_wall, of_hand, of_noise = (np.random.default_rng([seed, part]) for part in range(4))
    values = {name: float(of_motion.uniform(*ends)) for name, ends in scene.ranges.items()}
    t_s = np.arange(scene.frames) / scene.fps
    moments = (t_s[:, None] + EXPOSURE_S * (np.arange(MOMENTS) - (MOMENTS - 1) / 2) / MOMENTS).ravel()
    start = moments.min()
    centres = places(scene, values, moments - start).reshape(scene.frames, MOMENTS, 2)
    background = wall(SIZE_PX, of_wall, float(of_wall.uniform(*CONTRAST)))
    studio = Studio(background, SIZE_PX, RADIUS_PX, BALL_BGR, NOISE)
    maps = hand_shake(t_s, of_hand, shake, (SIZE_PX[0] / 2, SIZE_PX[1] / 2))
    images = [studio.image(motion, seen, of_noise) for motion, seen in zip(maps, centres, strict=True)]
    write_clip(path, images, scene.fps, ENCODER)
    return {"gravity": GRAVITY, **values}


def outcomes(scene: Scene, camera: str, seed: int) -> list[Outcome]:
    """Film a clip and measure it as a user's would be; one outcome for each value that is measured."""
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        truth = film(scene, SHAKES[camera], seed, clip)
        phenomenon = PHENOMENA[scene.phenomenon]
        calibration = scale(PX_PER_M, 1.0, px_stderr=PX_PER_M * SCALE_STDERR)
        try:
            tracks = track(open_video(clip), phenomenon.tracker)
        except IrisError as error:
            return [Outcome(scene.phenomenon, camera, seed, name, refused=str(error)) for name in scene.measured]
    found = []
    for name in scene.measured:
        others = (
            {"length": Estimate(truth["length"], 1e-6, "m", "direct")}
            if name == "gravity" and "length" in truth
            else {}
        )
        try:
            free = ("gravity",) if name == "gravity" else ()
            fit = observe_and_fit(tracks, calibration, phenomenon, others, free, image_size=SIZE_PX)[2]
            found.append(_scored(scene, camera, seed, name, fit.estimates[name], truth[name]))
        except (IrisError, KeyError) as error:
            found.append(Outcome(scene.phenomenon, camera, seed, name, refused=str(error)))
    return found


def _scored(scene: Scene, camera: str, seed: int, name: str, estimate: Estimate, truth: float) -> Outcome:
    low, high = estimate.interval
    error = estimate.value - truth
    about = (scene.phenomenon, camera, seed, name, error / truth, error / estimate.stderr)
    return Outcome(*about, inside=low <= truth <= high, stated=estimate.stderr / truth)


def table(results: Sequence[Outcome]) -> pd.DataFrame:
    """A line for each value and camera, and one for all values of a camera."""
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for result in results:
        for label in (f"{result.scene}: {result.name}", "all"):
            groups.setdefault((label, result.camera), []).append(result)
    return pd.DataFrame(
        [_row(*key, group) for key, group in sorted(groups.items(), key=lambda item: item[0][0] == "all")]
    )


def _row(label: str, camera: str, group: Sequence[Outcome]) -> dict[str, object]:
    known = [result for result in group if not result.refused]
    inside = sum(result.inside for result in known)
    return {
        "value": label,
        "camera": camera,
        "clips": len(group),
        "in the 95 % interval": f"{inside} of {len(known)} ({100 * inside / max(len(known), 1):.0f} %)",
        "refused": len(group) - len(known),
        "median error": f"{100 * np.median([abs(result.relative) for result in known]):.2f} %" if known else "",
        "stated": f"{100 * np.median([result.stated for result in known]):.2f} %" if known else "",
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and unless the seeds are sealed the values outside their interval."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clips", type=int, default=20, help="of each scene, with each camera")
    parser.add_argument("--first", type=int, default=SEALED, help="first seed")
    pages.add_option(parser)
    options = parser.parse_args(arguments)
    seeds = range(options.first, options.first + options.clips)
    with pages.table("camera-shake", options.write_docs):
        results = [
            result
            for seed in seeds
            for scene in SCENES
            for camera in SHAKES
            for result in outcomes(scene, camera, seed)
        ]
        print(pages.markdown(table(results)))
    if options.first < SEALED:
        for result in results:
            print(result)


if __name__ == "__main__":
    main()
