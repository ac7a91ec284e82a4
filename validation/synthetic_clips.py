"""Accuracy of the pixels of synthetic clips, and the time to render a frame.

``python -m validation.synthetic_clips`` prints two tables: the centroid of drawn discs against their truth,
and the seconds that painting, sensor and encoder take for a frame, each alone, and the whole clip.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from iris_sysid.synthetic import SCENES, Look, render_clip
from iris_sysid.synthetic.camera import CameraView, camera_for
from iris_sysid.synthetic.encoder import Encoder
from iris_sysid.synthetic.picture import Picture, painted
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.synthetic.scene import Stage, Wall
from iris_sysid.synthetic.sensor import Sensor
from iris_sysid.synthetic.shapes import Layer, disc

SCALE = 100.0  # px/m
SIZES = ((3840, 2160), (1920, 1080), (640, 480))


def disc_errors(radius_px: float, travel_px: float, count: int, seed: int) -> np.ndarray:
    """Centroid minus truth (count, 2) px of discs of grey 200 on grey 100 at random sub-pixel positions."""
    rng, side = np.random.default_rng(seed), 2 * int(radius_px + travel_px) + 16
    look = Look.plain(exposure_s=0.01 if travel_px else 0.0)
    half, errors = side / SCALE / 2, []
    y, x = np.mgrid[:side, :side]
    for offset in rng.uniform(-0.5, 0.5, (count, 2)) / SCALE:
        heading = rng.uniform(0, 2 * np.pi)
        speed = travel_px / SCALE / 0.01 * np.array([np.cos(heading), np.sin(heading)])

        def path(t_s: np.ndarray, offset: np.ndarray = offset, speed: np.ndarray = speed) -> np.ndarray:
            return offset + t_s[:, np.newaxis] * speed

        layer = Layer(disc(path, radius_px / SCALE), (200.0, 200.0, 200.0))
        view = CameraView(-half, half, -half, half)
        stage = Stage(view, Wall((100.0, 100.0, 100.0)), (), (layer,), (), {}, lambda t: [])
        image = painted(stage, camera_for(view, (side, side)), look, [0.0])[0].luma - 100.0
        centre = (side - 1) / 2 + SCALE * offset * [1, -1]
        errors.append(np.array([(x * image).sum(), (y * image).sum()]) / image.sum() - centre)
    return np.array(errors)


def parts(name: str, size: tuple[int, int], frames: int) -> tuple[float, float, float]:
    """Seconds a frame for painting, sensor and encoder, each alone, from the release on."""
    plan = plan_clip(name, size=size, duration_s=4.0)
    picture = Picture(plan.stage, plan.camera, plan.look, np.random.default_rng(0))
    sensor = Sensor(size, plan.look, np.random.default_rng(0))
    spent = np.zeros(3)
    with tempfile.TemporaryDirectory() as folder:
        encoder = Encoder(Path(folder) / "clip.mp4", size, plan.timing.rate, plan.look)
        frame, arrays = encoder.blank()
        sensor.read(picture.at(0.6), arrays)  # compile first
        for k in range(frames):
            start = time.perf_counter()
            planes = picture.at(0.7 + k / 60)
            painted_at = time.perf_counter()
            sensor.read(planes, arrays)
            read_at = time.perf_counter()
            frame.pts, frame.time_base, frame.color_range = k, encoder.tick, 2
            encoder.container.mux(encoder.stream.encode(frame))
            spent += np.diff([start, painted_at, read_at, time.perf_counter()])
        encoder.container.mux(encoder.stream.encode(None))
        encoder.container.close()
    return tuple(spent / frames)


def whole(name: str, size: tuple[int, int], frames: int) -> tuple[float, float]:
    """Seconds a frame for a whole clip, and the bit rate of its file in Mbit/s."""
    with tempfile.TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        start = time.perf_counter()
        render_clip(name, clip, size=size, duration_s=frames / 60, overrides={"release_time": 0.1})
        return (time.perf_counter() - start) / frames, clip.stat().st_size * 8 / (frames / 60) / 1e6


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=30, help="frames timed for each row")
    parser.add_argument("--all", action="store_true", help="time every scene at 3840x2160")
    options = parser.parse_args()
    print("| disc r px | travel px | centroid RMSE px | worst px | mean px |\n|---|---|---|---|---|")
    for radius, travel in ((4, 0), (8, 0), (12, 0), (40, 0), (12, 10), (40, 10), (40, 60)):
        errors = disc_errors(radius, travel, 100, seed=1)
        rmse, worst = np.sqrt(np.mean(errors**2)), np.abs(errors).max()
        print(f"| {radius} | {travel} | {rmse:.5f} | {worst:.5f} | {np.abs(errors.mean(axis=0)).max():.5f} |")
    print("\n| scene | size | paint s | sensor s | encode s | whole clip s/frame | Mbit/s |")
    print("|---|---|---|---|---|---|---|")
    rows = [("pendulum", size) for size in SIZES]
    rows += [(name, SIZES[0]) for name in SCENES if name != "pendulum"] if options.all else []
    for name, size in rows:
        paint, sensor, encode = parts(name, size, options.frames)
        seconds, rate = whole(name, size, options.frames)
        sizes = f"{size[0]}x{size[1]}"
        print(
            f"| {name} | {sizes} | {paint:.4f} | {sensor:.4f} | {encode:.4f} | {seconds:.4f} | {rate:.1f} |", flush=True
        )


if __name__ == "__main__":
    main()
