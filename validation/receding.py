"""Discs that come nearer or go away, drawn by OpenCV: from which ratio of their radii on the default tracker sees it.

``python -m validation.receding`` draws discs whose radius changes by a known ratio, before a plain wall, one with
texture and one with boxes and circles on it, at 30 and 60 frames a second, nearer or farther, while an arm leaves. It
prints how often the sampled frames show a disc that changes its size by 1.1, 1.2 and 1.3, what the default makes of
the clip, and the same where the disc swings and keeps its size.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.registry import TRACKERS
from iris_sysid.types import Array, Frame, Track, TrackOptions
from trackers._disc import receding_disc
from trackers._frames.working_image import view_of
from validation import pages

WIDTH, HEIGHT, SHIFT = 480, 270, 6
SECONDS, SAMPLES, NOISE = 1.6, 40, 2.0
RATIOS = (1.0, 1.1, 1.15, 1.2, 1.3, 1.5, 2.0)
WALLS = ("plain", "texture", "clutter")
LIMITS = (1.1, 1.2, 1.3)
Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Scene:
    """One clip: the largest radius over the smallest, the wall, frames a second, and whether the disc comes nearer."""

    ratio: float
    wall: str
    fps: int
    nearer: bool
    seed: int

    def path(self) -> tuple[Array, Array]:
        """Centres (n, 2) and radii (n,), px: at rest for a quarter, then away as in free fall; a swing for ratio 1."""
        k = np.arange(round(SECONDS * self.fps)) / self.fps
        fallen = np.clip((k - SECONDS / 4) / (SECONDS / 2), 0, 1) ** 2
        rng = np.random.default_rng(self.seed)
        start = rng.uniform((170, 110), (250, 160))
        drift = rng.uniform(-6, 6, 2)
        radius = rng.uniform(26, 38) / (1 + (self.ratio - 1) * fallen)
        centre = start + drift * fallen[:, np.newaxis]
        if self.ratio == 1.0:
            centre = start + np.column_stack([60 * np.sin(5 * k), -6 * np.sin(5 * k) ** 2])
        return (centre[::-1], radius[::-1]) if self.nearer else (centre, radius)

    def images(self) -> list[Image]:
        """The frames (h, w), grey levels, with noise."""
        rng = np.random.default_rng(self.seed + 1)
        wall, bright = _wall(self.wall, rng), rng.choice([30.0, 215.0])
        centre, radius = self.path()
        n = len(radius)
        frames = []
        for k in range(n):
            image = wall.copy()
            leaves = 330 + 300 * max(0.0, (n - 1 - k if self.nearer else k) / n - 0.25)
            cv2.rectangle(image, (int(leaves), 120), (WIDTH, 150), 150.0, -1, cv2.LINE_AA)
            place = [round(value * 2**SHIFT) for value in centre[k]]
            cv2.circle(image, place, round(radius[k] * 2**SHIFT), float(bright), -1, cv2.LINE_AA, SHIFT)
            image = cv2.GaussianBlur(image, (0, 0), 0.8) + rng.normal(0, NOISE, image.shape)
            frames.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        return frames


def _wall(kind: str, rng: np.random.Generator) -> Array:
    """A still wall (h, w): plain, with texture, or with boxes and circles as well."""
    wall = np.full((HEIGHT, WIDTH), 105.0)
    if kind != "plain":
        wall += 10 * cv2.GaussianBlur(rng.normal(0, 3, wall.shape), (0, 0), 3)
    if kind == "clutter":
        for _ in range(10):
            x, y, size = (int(value) for value in rng.uniform((0, 0, 10), (WIDTH, HEIGHT, 45)))
            level = float(rng.uniform(60, 160))
            if rng.uniform() < 0.5:
                cv2.circle(wall, (x, y), size, level, -1, cv2.LINE_AA)
            else:
                cv2.rectangle(wall, (x, y), (x + 2 * size, y + size), level, -1)
    return wall


@dataclass(eq=False)
class Drawn:
    """The frames of a scene as a clip."""

    images: Sequence[Image]
    fps: int

    width, height = WIDTH, HEIGHT

    @property
    def n_expected(self) -> int:
        """Number of frames."""
        return len(self.images)

    def frames(self) -> Iterator[Frame]:
        """Every frame."""
        return (self._frame(k) for k in range(len(self.images)))

    def sample(self, count: int) -> list[Frame]:
        """Frames spread over the clip."""
        return [self._frame(int(k)) for k in np.unique(np.linspace(0, len(self.images) - 1, count).astype(int))]

    def _frame(self, k: int) -> Frame:
        return Frame(k, k / self.fps, self.images[k], lambda: cv2.cvtColor(self.images[k], cv2.COLOR_GRAY2BGR))


def found_ratio(clip: Drawn) -> float:
    """The ratio of the radii by which a disc changes its size in the samples, as the tracker takes it; 0 if none."""
    frames = clip.sample(SAMPLES)
    limit, receding_disc.MIN_RATIO = receding_disc.MIN_RATIO, 0.0
    try:
        discs = receding_disc.receding_disc(frames, view_of(clip, TrackOptions()))
    finally:
        receding_disc.MIN_RATIO = limit
    radii = sorted(disc.radius for disc in discs.values())
    return radii[-2] / radii[1] if radii else 0.0


def on_body(track: Track, centre: Array, radius: Array) -> tuple[float, float]:
    """Shares of all frames in which a track is on the disc, and elsewhere."""
    off = np.hypot(*(track.xy_px - centre).T)
    return float(np.mean(off < radius)), float(np.mean(off >= radius))


def row(ratio: float, repeats: int) -> str:
    """One row of the table."""
    above, followed, doubtful, wrong = np.zeros(len(LIMITS), int), 0, 0, 0
    settings = list(product(WALLS, (30, 60), (False, True), range(repeats)))
    for number, (wall, fps, nearer, _) in enumerate(settings):
        scene = Scene(ratio, wall, fps, nearer, round(1000 * ratio) + 10 * number)
        clip = Drawn(scene.images(), fps)
        above += found_ratio(clip) >= np.array(LIMITS)
        (track,) = TRACKERS["auto"].track(clip, TrackOptions())
        on, elsewhere = on_body(track, *scene.path())
        doubted = track.quality is not None and track.quality.doubtful
        followed += on >= 0.95
        doubtful += doubted
        wrong += elsewhere > 0.05 and not doubted
    return f"| {ratio:g} | {len(settings)} | {' | '.join(map(str, above))} | {followed} | {doubtful} | {wrong} |"


def main() -> None:
    """Print a row for each ratio."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--repeats", type=int, default=1, help="clips of each wall, frame rate and direction")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("receding", options.write_docs):
        limits = " | ".join(f"seen to change {limit:g} times" for limit in LIMITS)
        print(f"| ratio | clips | {limits} | followed | doubtful | wrong, no doubt |")
        print("| ---: | ---: | " + "---: | " * len(LIMITS) + "---: | ---: | ---: |")
        for ratio in RATIOS:
            print(row(ratio, options.repeats), flush=True)


if __name__ == "__main__":
    main()
