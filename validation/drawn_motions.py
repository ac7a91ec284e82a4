"""Standard errors of discs on paths that no polynomial follows: circles, Lissajous figures, bounces, stop and go.

``python -m validation.drawn_motions [--seeds 1 2]`` draws discs by OpenCV, sixteen times finer than the pixels, on a
textured wall, stores them without loss in Matroska and as H.264, tracks them, and prints the standard deviation of the
errors, the stated standard error, and the standard deviation of error over standard error (ideally 1): medians over
both axes and all seeds, and the least and the largest.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid import open_video
from iris_sysid.registry import TRACKERS
from iris_sysid.types import Array, TrackOptions
from validation import pages

WIDTH, HEIGHT, RADIUS, FINER = 320, 240, 12.0, 16
FRAMES, FPS = 90, 60
CONTRAST, NOISE = 100.0, 3.0  # grey levels
STORED = {"ffv1": {}, "libx264": {"crf": "23", "bf": "0", "preset": "superfast"}}
Images = list[NDArray[np.uint8]]


def circle(rate: float) -> Callable[[Array], Array]:
    """The path of the issue: radii 90 and 70 px, ``rate`` rad a frame."""
    return lambda k: np.column_stack([160 + 90 * np.cos(rate * k), 120 + 70 * np.sin(rate * k)])


def lissajous(k: Array) -> Array:
    """Frequencies 3 to 2, of which the faster is a circle's 0.18 rad a frame."""
    return np.column_stack([160 + 110 * np.cos(0.12 * k), 120 + 80 * np.sin(0.18 * k + 0.4)])


def bouncing(k: Array) -> Array:
    """Parabolas of 13 frames between floor and floor, sideways at 2.6 px a frame."""
    phase = np.mod(k + 3.7, 13.3) / 13.3
    return np.column_stack([40 + 2.6 * k, 200 - 4 * 130 * phase * (1 - phase)])


def stop_and_go(k: Array) -> Array:
    """Moves for 15 frames, rests for 15, and so on."""
    moved = 15 * np.floor(k / 30) + np.minimum(np.mod(k, 30), 15)
    return np.column_stack([50 + 4.6 * moved, 120 + 50 * np.sin(0.1 * moved)])


MOTIONS: dict[str, Callable[[Array], Array]] = {
    "circle, 0.11 rad a frame": circle(0.11),
    "circle, 0.2 rad a frame": circle(0.2),
    "circle, 0.35 rad a frame": circle(0.35),
    "Lissajous": lissajous,
    "bouncing": bouncing,
    "stop and go": stop_and_go,
}


def drawn(path: Array, rng: np.random.Generator) -> Images:
    """Images (h, w) of a disc at ``path`` (n, 2), px, before a textured wall, with noise."""
    wall = 70 + cv2.GaussianBlur(rng.normal(0, 12, (HEIGHT, WIDTH)), (0, 0), 3)
    images = []
    for x, y in path:
        fine = np.zeros((HEIGHT * FINER, WIDTH * FINER), np.uint8)
        centre = [round(((value + 0.5) * FINER - 0.5) * 256) for value in (x, y)]
        cv2.circle(fine, centre, round(RADIUS * FINER * 256), 255, cv2.FILLED, shift=8)
        share = cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float64) / 255
        image = wall + CONTRAST * share + rng.normal(0, NOISE, wall.shape)
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return images


def store(path: Path, images: Images, codec: str) -> Path:
    """Write the images as a grey film."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=FPS, options=STORED[codec])
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for image in images:
            frame = av.VideoFrame.from_ndarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), "bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def errors_of(motion: str, seed: int, codec: str, tracker: str, folder: Path) -> tuple[Array, Array, Array]:
    """Standard deviation of the errors, median standard error, and standard deviation of the pulls, each (2,)."""
    rng = np.random.default_rng(seed)
    path = MOTIONS[motion](np.arange(FRAMES) + rng.uniform(0, 1)) + rng.uniform(-0.5, 0.5, 2)
    clip = store(folder / "clip.mkv", drawn(path, rng), codec)
    track = TRACKERS[tracker].track(open_video(clip), TrackOptions())[0]
    error = track.xy_px - path
    error -= np.nanmean(error, axis=0)
    return (
        np.nanstd(error, axis=0),
        np.nanmedian(track.sigma_px, axis=0),
        np.nanstd(error / track.sigma_px, axis=0),
    )


def row(motion: str, codec: str, tracker: str, seeds: Sequence[int]) -> str:
    """One row of the table."""
    with tempfile.TemporaryDirectory() as folder:
        numbers = np.array([errors_of(motion, seed, codec, tracker, Path(folder)) for seed in seeds])
    sd, told, pull = np.median(numbers, axis=(0, 2))
    least, largest = numbers[:, 2].min(), numbers[:, 2].max()
    kept = "without loss" if codec == "ffv1" else "H.264"
    return f"| {motion} | {kept} | {tracker} | {sd:.4f} | {told:.4f} | {pull:.2f} | {least:.2f}, {largest:.2f} |"


def main() -> None:
    """Print a row for each motion, way of storing, and tracker."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2], help="of phase, place, wall and noise")
    parser.add_argument("--trackers", nargs="+", default=["median-background", "disc"])
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("pulls-drawn", options.write_docs):
        print("| motion | stored | tracker | sd of errors | told | pull sd | from, to |")
        print("| --- | --- | --- | ---: | ---: | ---: | ---: |")
        for motion in MOTIONS:
            for codec in STORED:
                for tracker in options.trackers:
                    print(row(motion, codec, tracker, options.seeds), flush=True)


if __name__ == "__main__":
    main()
