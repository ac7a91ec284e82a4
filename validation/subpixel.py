"""Accuracy of position and radius beside the Cramér-Rao bound, under blur and compression; pulls of stated errors.

``python -m validation.subpixel`` prints two tables. Drawn discs: centre RMSE over the Cramér-Rao bound, bias over the
sub-pixel phase, radius, pulls (error over standard error); other methods on the same images. Filmed balls of
synthetic clips: errors and pulls of both trackers, clean to compressed, at 3840x2160 with 10 px of blur at 45 Mbit/s.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import trackpy

from iris_sysid import open_video
from iris_sysid.synthetic import Look
from iris_sysid.synthetic.camera import CameraView, camera_for
from iris_sysid.synthetic.clip import film
from iris_sysid.synthetic.plan import ClipPlan, Timing, plan_clip
from iris_sysid.synthetic.scene import Stage, Wall
from iris_sysid.synthetic.shapes import Layer, Shading
from iris_sysid.synthetic.shapes import disc as disc_outline
from iris_sysid.types import Array, Track, TrackOptions
from tests._drawn import DrawnClip, disc, moving_disc, swing
from trackers.disc import track as by_disc
from trackers.median_background import track as by_background
from validation import pages

TRACKERS = {"disc": by_disc, "median-background": by_background}
CONTRAST, NOISE, LEVEL = 100.0, 3.0, 80.0  # grey levels of the drawn discs
FPS = 60
SIZE_4K, SIZE_720 = (3840, 2160), (1280, 720)
GREEN = (200.0, 190.0, 60.0)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=300, help="of each drawn disc")
    parser.add_argument("--bodies", type=int, default=3, help="of each synthetic clip that are tracked")
    pages.add_option(parser)
    options = parser.parse_args()
    warnings.filterwarnings("ignore", module="trackpy")
    trackpy.quiet()
    with pages.table("subpixel", options.write_docs):
        _print_drawn(options.frames)
    with pages.table("subpixel-rendered", options.write_docs):
        _print_filmed(options.bodies)


# --------------------------------------------------------------------------- drawn discs


def cramer_rao_px(radius: float) -> float:
    """Least standard error of x that white noise allows for a disc of known brightness and radius, px."""
    shape, at, step = (int(2 * radius) + 60,) * 2, radius + 30.3, 1e-3
    slope = (disc(shape, at + step, at, radius, 64) - disc(shape, at - step, at, radius, 64)) / (2 * step)
    return float(NOISE / CONTRAST / np.sqrt(np.sum(slope**2)))


def locking_px(errors: Array, path: Array) -> float:
    """Amplitude of the bias that repeats with every pixel: first harmonic of the errors over the sub-pixel phase."""
    wave = np.exp(2j * np.pi * path.ravel())
    return float(np.abs(2 * np.mean(errors.ravel() * wave)))


def _threshold(image: np.ndarray) -> Array:
    moments = cv2.moments((image > LEVEL + CONTRAST / 2).astype(np.uint8), binaryImage=True)
    return np.array([moments["m10"], moments["m01"]]) / moments["m00"]


def _ellipse(image: np.ndarray) -> Array:
    mask = (image > LEVEL + CONTRAST / 2).astype(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.array(cv2.fitEllipse(max(contours, key=len))[0])


def _blob(image: np.ndarray) -> Array:
    settings = cv2.SimpleBlobDetector_Params()
    settings.filterByConvexity = settings.filterByInertia = settings.filterByCircularity = False
    settings.blobColor, settings.minArea, settings.maxArea = 255, 10, 4 * CONTRAST**2
    settings.minDistBetweenBlobs, settings.minThreshold, settings.maxThreshold = 100, LEVEL + 20, LEVEL + 80
    blobs = cv2.SimpleBlobDetector_create(settings).detect(image)
    return np.array(max(blobs, key=lambda keypoint: keypoint.size).pt) if blobs else np.full(2, np.nan)


def _located(radius: float) -> Callable[[np.ndarray], Array]:
    diameter = 2 * int(np.ceil(radius)) + 3

    def located(image: np.ndarray) -> Array:
        features = trackpy.locate(image, diameter, topn=1)
        return features[["x", "y"]].to_numpy()[0] if len(features) else np.full(2, np.nan)

    return located


def _print_drawn(frames: int) -> None:
    print(f"Discs of contrast {CONTRAST:g} in noise of {NOISE:g} grey levels, {frames} pictures each, px")
    print(
        "| radius | method | centre RMSE | over the bound | locking | radius bias | radius sd | pull sd | radius pull |"
    )
    print("| ---: | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for radius in (4, 12, 40):
        shape, amplitude = ((64, 96), (30, 14)) if radius == 4 else ((3 * radius + 60, 5 * radius + 100), (50, 20))
        path = swing(frames, (shape[1] / 2, shape[0] / 2), amplitude, period=73.7)
        clip = moving_disc(path, radius, shape, CONTRAST, NOISE)
        for name, track in TRACKERS.items():
            tracked = track(clip, TrackOptions())[0]
            off = tracked.radius_px - radius
            pulls = np.std((tracked.xy_px - path) / tracked.sigma_px), np.std(off / tracked.sigma_radius_px)
            numbers = f"{np.mean(off):+.4f} | {np.std(off):.4f} | {pulls[0]:.2f} | {pulls[1]:.2f}"
            _print_centre(radius, name, tracked.xy_px, path, numbers)
        others = {
            "threshold, cv2.moments": _threshold,
            "cv2.fitEllipse": _ellipse,
            "cv2.SimpleBlobDetector": _blob,
            "trackpy.locate": _located(radius),
        }
        for name, method in others.items():
            _print_centre(radius, name, np.array([method(image) for image in clip.images]), path, "| | |")


def _print_centre(radius: float, name: str, positions: Array, path: Array, numbers: str) -> None:
    seen = np.isfinite(positions[:, 0])
    errors = (positions - path)[seen]
    rmse = np.sqrt(np.mean(errors**2))
    note = name if seen.all() else f"{name} ({seen.sum()} of {seen.size} seen)"
    share = rmse / cramer_rao_px(radius)
    print(
        f"| {radius} | {note} | {rmse:.4f} | {share:.2f} | {locking_px(errors, path[seen]):.4f} | {numbers} |",
        flush=True,
    )


# --------------------------------------------------------------------------- filmed bodies


@dataclass(frozen=True, slots=True)
class Setting:
    """A synthetic clip: shaded balls that go round, one in each square of ``side`` px."""

    name: str
    size: tuple[int, int]
    look: Look
    radius: float
    circle: float
    step: float
    side: int


SMALL = {"size": SIZE_720, "radius": 14.0, "circle": 80.0, "step": 8.4, "side": 240}
LARGE = {"size": SIZE_4K, "radius": 40.0, "circle": 200.0, "step": 20.0, "side": 540}
SETTINGS = (
    Setting("clean", look=Look.plain(shading=True), **SMALL),
    Setting("noise 3, lossless", look=Look.plain(shading=True, read_noise=3.0), **SMALL),
    Setting("phone's rate, 720p", look=Look(exposure_s=1 / 1000), **SMALL),
    Setting("textured wall, blur, 720p", look=Look(exposure_s=1 / 120, texture=4.0), **SMALL),
    Setting("45 Mbit/s, 4K", look=Look(exposure_s=1 / 1000, bit_rate=45e6), **LARGE),
    Setting(
        "textured wall, 10 px of blur, 4K",
        look=Look(exposure_s=1 / 120, texture=4.0, bit_rate=45e6),
        **LARGE,
    ),
)
ROUND = 64  # frames, about one round


def filmed(setting: Setting, bodies: int, seed: int = 3) -> list[tuple[DrawnClip, Array]]:
    """The squares of some bodies as separate clips, decoded from one file, and their true centres (n, 2) px."""
    width, height = setting.size
    view = CameraView(-width / 2, width / 2, -height / 2, height / 2, distance_m=float(width))
    camera, rng = camera_for(view, setting.size), np.random.default_rng(seed)
    times, layers, paths, corners = np.arange(ROUND) / FPS, [], [], []
    for column in range(width // setting.side):
        for row in range(height // setting.side):
            corner = np.array([column, row]) * setting.side
            middle = np.array([-width / 2, height / 2]) + (corner + setting.side / 2) * [1, -1]
            centre = _round(middle + rng.uniform(-0.5, 0.5, 2), setting, rng.uniform(0, 2 * np.pi))
            shading = Shading(centre, setting.radius)
            layers.append(Layer(disc_outline(centre, setting.radius), GREEN, shading=shading))
            paths.append(camera.project(centre(times)))
            corners.append(corner)
    stage = Stage(view, Wall(), (), tuple(layers), (), {}, lambda t_s: [])
    timing = Timing(times, np.arange(ROUND), Fraction(FPS))
    truth = plan_clip("pendulum", size=setting.size, duration_s=1.0).truth  # not used: film does not read it
    plan = ClipPlan(stage, camera, setting.look, timing, np.zeros((ROUND, 2)), 0.0, seed, truth)
    chosen = np.random.default_rng(seed).permutation(len(paths))[:bodies]
    clips = _squares(plan, [corners[k] for k in chosen], setting.side)
    return [(clip, paths[k] - corners[k]) for clip, k in zip(clips, chosen, strict=True)]


def _round(middle: Array, setting: Setting, start: float) -> Callable[[Array], Array]:
    rate = setting.step * FPS / setting.circle

    def centre(t_s: Array) -> Array:
        angle = start + rate * t_s
        return middle + setting.circle * np.stack([np.cos(angle), np.sin(angle)], axis=-1)

    return centre


def _squares(plan: ClipPlan, corners: list[Array], side: int) -> list[DrawnClip]:
    pictures: list[list[np.ndarray]] = [[] for _ in corners]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.mp4"
        with film(path, plan, None, overwrite=True):
            pass
        for frame in open_video(path).frames():
            for image, (x, y) in zip(pictures, corners, strict=True):
                image.append(frame.luma[y : y + side, x : x + side].copy())
    return [DrawnClip(image, FPS) for image in pictures]


def _print_filmed(bodies: int) -> None:
    print(f"\nSynthetic shaded balls on a circle, {bodies} of each clip, {ROUND} frames, px")
    print("| clip | tracker | seen | centre RMSE | bias | told | pull sd | pull rms | radius bias | radius pull |")
    print("| --- | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |")
    for setting in SETTINGS:
        clips = filmed(setting, bodies)
        for name, track in TRACKERS.items():
            tracks = [track(clip, TrackOptions())[0] for clip, _ in clips]
            _print_pulls(setting, name, tracks, [path for _, path in clips])


def _print_pulls(setting: Setting, name: str, tracks: list[Track], paths: list[Array]) -> None:
    errors = np.concatenate([track.xy_px - path for track, path in zip(tracks, paths, strict=True)])
    sigma = np.concatenate([track.sigma_px for track in tracks])
    off = np.concatenate([track.radius_px - setting.radius for track in tracks])
    pull, radius_pull = errors / sigma, off / np.concatenate([track.sigma_radius_px for track in tracks])
    seen = np.isfinite(off).mean()
    rmse, stated, rms = (np.sqrt(np.nanmean(np.square(values))) for values in (errors, sigma, pull))
    bias = np.hypot(*np.nanmean(errors, axis=0))
    print(
        f"| {setting.name} | {name} | {seen:.0%} | {rmse:.4f} | {bias:.4f} | {stated:.4f} | {np.nanstd(pull):.2f} | "
        f"{rms:.2f} | {np.nanmean(off):+.3f} | {np.nanstd(radius_pull):.2f} |",
        flush=True,
    )


if __name__ == "__main__":
    main()
