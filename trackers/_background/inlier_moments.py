"""Samples that lie close together, pixel by pixel: their mean and variance (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np

from iris_sysid.io.kernels import kernel
from trackers._frames.arrays import Bytes, Flags, Image


@kernel(nogil=True)
def inlier_moments(stack: Bytes, centre: Image, cut: Image, usable: Flags, channels: int) -> tuple[Image, Image]:
    """Mean and variance of those samples that lie within a distance of a centre.

    Parameters
    ----------
    stack
        Samples (k, h, w * channels), grey levels.
    centre, cut
        Centre and distance (h, w * channels), grey levels.
    usable
        Which samples (k, h, w) may be used; (1, 1, 1) where all may.
    channels
        Number of channels.
    """
    samples, height, width = stack.shape
    mean, variance = np.empty((height, width), dtype=np.float32), np.empty((height, width), dtype=np.float32)
    count, total = np.empty(width, dtype=np.float32), np.empty(width, dtype=np.float32)
    squares, every = np.empty(width, dtype=np.float32), usable.size == 1
    one, nothing = np.float32(1), np.float32(0)
    for y in range(height):
        count[:], total[:], squares[:] = nothing, nothing, nothing
        for k in range(samples):
            row, about, farthest = stack[k, y], centre[y], cut[y]
            for x in range(width):
                deviation = np.float32(row[x]) - about[x]
                inlier = one if abs(deviation) <= farthest[x] else nothing
                if not every:
                    inlier = inlier if usable[k, y, x // channels] else nothing
                deviation = deviation * inlier
                count[x] += inlier
                total[x] += deviation
                squares[x] += deviation * deviation
        for x in range(width):
            seen = max(count[x], one)
            mean[y, x] = centre[y, x] + total[x] / seen
            variance[y, x] = (squares[x] - total[x] * total[x] / seen) / max(seen - one, one)
    return mean, variance
