"""A pendulum or a throw before a textured wall, filmed by hand: NumPy, OpenCV and SciPy alone.

The wall is drawn once, larger than the image; each frame looks it up through the camera's own shift and turn. The ball
is drawn by distance from its centre, pixel by pixel, at several moments of the exposure. Nothing of the library takes
part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BAND_HZ = (1.0, 8.0)  # of a hand's shake; amplitude falls with frequency
MARGIN_PX = 60  # of the wall beyond the image
FINER = 2  # pixels of the wall a pixel of the image


@dataclass(frozen=True, slots=True)
class Shake:
    """``shift_px`` root mean square along each axis, ``turn_rad`` of the turn about the line of sight; ``pan_px_s``."""

    shift_px: float = 5.0
    turn_rad: float = 0.002
    pan_px_s: float = 0.0


def hand_shake(t_s: Array, rng: np.random.Generator, shake: Shake, centre_px: tuple[float, float]) -> Array:
    """Maps (n, 2, 3) from the still scene to the image, px: shift, and turn about its centre, of 1/f spectrum.

    Parameters
    ----------
    t_s
        Times (n,), s.
    rng
        Of phases and amplitudes.
    shake
        Its size.
    centre_px
        Centre of the image, px.
    """
    courses = np.array([_course(t_s, rng) for _ in range(3)])
    maps = np.zeros((t_s.size, 2, 3))
    turn = shake.turn_rad * courses[2]
    maps[:, 0, 0] = maps[:, 1, 1] = np.cos(turn)
    maps[:, 0, 1], maps[:, 1, 0] = -np.sin(turn), np.sin(turn)
    maps[:, :, 2] = shake.shift_px * courses[:2].T
    maps[:, :, 2] += centre_px - maps[:, :, :2] @ np.array(centre_px)
    maps[:, 0, 2] += shake.pan_px_s * (t_s - t_s.mean())
    return maps


def _course(t_s: Array, rng: np.random.Generator) -> Array:
    """A random course (n,) of root mean square 1: sines between 1 and 8 Hz whose amplitude goes as 1/f."""
    frequency = rng.uniform(*BAND_HZ, 24)
    amplitude = rng.normal(0, 1, 24) / frequency
    course = (amplitude * np.sin(2 * np.pi * frequency * t_s[:, None] + rng.uniform(0, 2 * np.pi, 24))).sum(axis=1)
    return np.asarray((course - course.mean()) / course.std())


def wall(size: tuple[int, int], rng: np.random.Generator, contrast: float, margin_px: int = MARGIN_PX) -> Array:
    """A wall (h', w', 3) of BGR grey levels with texture of several scales, FINER pixels for each of the image.

    Parameters
    ----------
    size
        Width and height of the image, px.
    rng
        Of the texture.
    contrast
        Standard deviation of its brightness, grey levels.
    margin_px
        How much of it lies beyond each edge of the image, px.
    """
    width, height = ((side + 2 * margin_px) * FINER for side in size)
    texture = np.zeros((height, width))
    for scale_px in (1.5, 4.0, 12.0, 40.0):
        layer = cv2.GaussianBlur(rng.normal(0, 1, (height, width)), (0, 0), scale_px * FINER)
        texture += layer / layer.std()
    texture *= contrast / texture.std()
    tint = np.array([rng.uniform(90, 120), rng.uniform(100, 130), rng.uniform(110, 140)])
    return np.asarray(tint + texture[..., None], dtype=np.float64)


@dataclass(frozen=True, eq=False, slots=True)
class Studio:
    """What a clip is drawn with: the wall, the image's size, the ball's radius (px) and BGR colour, noise, exposure."""

    background: Array
    size: tuple[int, int]
    radius_px: float
    colour: tuple[float, float, float]
    noise: float
    margin_px: int = MARGIN_PX

    def image(self, motion: Array, centres: Array, rng: np.random.Generator) -> NDArray[np.uint8]:
        """A frame (h, w, 3) uint8 BGR: ``motion`` (2, 3) px of the camera, ``centres`` (m, 2) px in the exposure."""
        width, height = self.size
        columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
        inverse = cv2.invertAffineTransform(motion)
        x = inverse[0, 0] * columns + inverse[0, 1] * rows + inverse[0, 2]
        y = inverse[1, 0] * columns + inverse[1, 1] * rows + inverse[1, 2]
        across, down = ((side + self.margin_px + 0.5) * FINER - 0.5 for side in (x, y))
        seen = cv2.remap(
            self.background.astype(np.float32), across.astype(np.float32), down.astype(np.float32), cv2.INTER_CUBIC
        ).astype(np.float64)
        covered = np.mean(
            [np.clip(self.radius_px + 0.5 - np.hypot(x - cx, y - cy), 0, 1) for cx, cy in centres], axis=0
        )[..., None]
        painted = seen * (1 - covered) + np.array(self.colour) * covered
        noisy = painted + rng.normal(0, self.noise, painted.shape)
        return np.asarray(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))


def write_clip(path: Path, images: list[NDArray[np.uint8]], fps: int, options: Mapping[str, str]) -> Path:
    """Encode frames (h, w, 3) uint8 BGR as H.264.

    Parameters
    ----------
    path
        The .mp4 file.
    images
        In order.
    fps
        Frames a second.
    options
        Of the encoder, e.g. ``{"crf": "23"}``.
    """
    height, width = images[0].shape[:2]
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=fps, options=dict(options))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.thread_count = 1
        for image in images:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return path
