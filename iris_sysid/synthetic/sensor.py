"""The sensor: shot and read noise, rounding to 8 bits, frames left out, a camera that is not quite still."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from iris_sysid.io.kernels import kernel
from iris_sysid.synthetic.backdrop import Planes
from iris_sysid.synthetic.coverage import Plane
from iris_sysid.synthetic.look import Look
from iris_sysid.types import Array

POOL = 1 << 20  # normal numbers; each row of each frame starts at a random place among them
SHAKE_HZ = 3.0  # of a hand
MID_GREY = 100.0
COLOUR_NOISE = 0.5  # a phone smooths colour noise more than brightness


class Sensor:
    """Turns planes of exact grey levels into the 8-bit frame that the camera would have stored."""

    def __init__(self, size: tuple[int, int], look: Look, rng: np.random.Generator) -> None:
        self.look, self.rng = look, rng
        self.noisy = look.read_noise > 0 or look.shot_noise > 0
        self.pool = rng.standard_normal(POOL + size[0], dtype=np.float32) if self.noisy else np.zeros(1, np.float32)

    def read(self, planes: Planes, out: tuple[NDArray[np.uint8], ...]) -> None:
        """Write the planes into three uint8 arrays of the same shapes, with fresh noise.

        In grey levels: luma (h, w), colour differences (h / 2, w / 2).

        Noise at grey level I has the variance read_noise^2 + shot_noise I; it is independent from row to row and
        frame to frame.
        """
        read, shot = self.look.read_noise**2, self.look.shot_noise
        # the level of a colour plane is not a brightness: take the noise of mid grey
        colour = (COLOUR_NOISE**2 * (read + MID_GREY * shot), 0.0)
        for plane, target, variance in zip(
            (planes.luma, planes.blue, planes.red), out, ((read, shot), colour, colour), strict=True
        ):
            if self.noisy:
                starts = self.rng.integers(0, POOL, plane.shape[0])
                _with_noise(plane, self.pool, starts, np.float32(variance[0]), np.float32(variance[1]), target)
            else:
                _rounded(plane, target)


@kernel(nogil=True, error_model="python")
def _with_noise(
    plane: Plane,
    pool: NDArray[np.float32],
    starts: NDArray[np.int64],
    read_variance: np.float32,
    shot_variance: np.float32,
    out: NDArray[np.uint8],
) -> None:
    half = np.float32(0.5)
    top = np.float32(255.0)
    zero = np.float32(0.0)
    for row in range(plane.shape[0]):
        line = pool[starts[row] : starts[row] + plane.shape[1]]
        for column in range(plane.shape[1]):
            level = plane[row, column]
            deviation = np.sqrt(max(read_variance + shot_variance * level, zero))
            value = level + deviation * line[column] + half
            out[row, column] = np.uint8(min(max(value, zero), top))


@kernel(nogil=True, error_model="python")
def _rounded(plane: Plane, out: NDArray[np.uint8]) -> None:
    for row in range(plane.shape[0]):
        for column in range(plane.shape[1]):
            out[row, column] = np.uint8(min(max(plane[row, column] + np.float32(0.5), np.float32(0.0)), 255.0))


def kept_frames(count: int, fraction: float, rng: np.random.Generator) -> NDArray[np.int64]:
    """Numbers of the frames that were not left out; the first and the last always stay. Shape (kept,)."""
    keep = rng.random(count) >= fraction
    keep[[0, -1]] = True
    return np.flatnonzero(keep)


def shake(count: int, fps: float, deviation_px: float, rng: np.random.Generator) -> Array:
    """Offset (count, 2) px of the image in each frame: smooth random motion.

    Parameters
    ----------
    count, fps
        Number of frames, and how many a second.
    deviation_px
        Standard deviation along each axis.
    rng
        Source of the motion.
    """
    if deviation_px == 0:
        return np.zeros((count, 2))
    memory = math.exp(-2 * math.pi * SHAKE_HZ / fps)
    noise = rng.standard_normal((count + 200, 2))
    smooth = lfilter([1 - memory], [1, -memory], noise, axis=0)
    smooth = lfilter([1 - memory], [1, -memory], smooth, axis=0)[200:]
    # variance of two equal first-order filters in a row
    gain = (1 - memory) ** 4 * (1 + memory**2) / (1 - memory**2) ** 3
    return np.asarray(deviation_px * smooth / math.sqrt(gain))
