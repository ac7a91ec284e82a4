"""Frames of a clip that are in memory, as an array."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.types import Array, Frame, FrameSource, increasing_times

Images = NDArray[np.uint8]


def frames_from_array(images: Images, times_s: Array | float) -> FrameSource:
    """The frames of an array as a clip, for :func:`iris_sysid.track`, ``detect`` and ``measure``.

    Parameters
    ----------
    images
        Grey levels (n, h, w), or colours (n, h, w, 3) in the order blue, green, red as OpenCV has them; uint8.
    times_s
        Time (n,) of each frame in s, increasing; or the rate in frames/s.

    Raises
    ------
    DataError
        When the array has another shape or type, or the times do not increase or are not as many as the frames.
    """
    images = np.asarray(images)
    if images.dtype != np.uint8 or images.ndim not in (3, 4) or (images.ndim == 4 and images.shape[3] != 3):
        raise DataError(
            f"the images are {images.dtype} of shape {images.shape}; they must be uint8, (n, h, w) or (n, h, w, 3)"
        )
    if not images.size:
        raise DataError(f"the images have the shape {images.shape}; there must be a frame with a pixel")
    if np.ndim(times_s) == 0:
        rate = float(times_s)
        if not (np.isfinite(rate) and rate > 0):
            raise DataError(f"the rate is {rate:g} frames/s; it must be above 0")
        times_s = np.arange(len(images)) / rate
    t_s = increasing_times(np.asarray(times_s, dtype=np.float64))
    if len(t_s) != len(images):
        raise DataError(f"there are {len(t_s)} times of {len(images)} frames; give one a frame, or the rate")
    return _ArrayFrames(images, t_s)


@dataclass(frozen=True, eq=False, slots=True)
class _ArrayFrames:
    """A FrameSource over images in memory."""

    images: Images
    t_s: Array

    @property
    def width(self) -> int:
        """Width in pixels."""
        return int(self.images.shape[2])

    @property
    def height(self) -> int:
        """Height in pixels."""
        return int(self.images.shape[1])

    @property
    def n_expected(self) -> int:
        """Number of frames."""
        return len(self.images)

    def frames(self) -> Iterator[Frame]:
        """Every frame, in order."""
        return (self._frame(number) for number in range(len(self.images)))

    def sample(self, count: int) -> list[Frame]:
        """About ``count`` frames spread evenly over the clip."""
        numbers = np.unique(np.linspace(0, len(self.images) - 1, count).round().astype(int))
        return [self._frame(int(number)) for number in numbers]

    def _frame(self, number: int) -> Frame:
        image = self.images[number]
        if image.ndim == 2:
            return Frame(number, float(self.t_s[number]), image, lambda: np.repeat(image[..., np.newaxis], 3, axis=2))
        luma = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)
        return Frame(number, float(self.t_s[number]), luma, lambda: image)
