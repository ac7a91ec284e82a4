"""How a frame becomes the picture that is worked on: cut to the region, with or without colour, and made smaller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types import Frame, FrameSource, TrackOptions
from trackers._background import Bytes, Flags
from trackers._colour import Colour, luma_and_chroma, read_colour

WIDEST_DETECTION = 960  # px: wider pictures are searched at reduced size


@dataclass(frozen=True, slots=True)
class View:
    """Region of the frame (px), whether colour counts, the colour wanted, and the reduction for detection."""

    left: int
    top: int
    width: int
    height: int
    chroma: bool = False
    colour: Colour | None = None

    @property
    def step(self) -> int:
        """How many pixels a side make one pixel of the search for bodies."""
        return -(-self.width // WIDEST_DETECTION)

    @property
    def small_size(self) -> tuple[int, int]:
        """Width and height of the picture that is searched."""
        return (-(-self.width // self.step), -(-self.height // self.step))

    def picture(self, frame: Frame) -> Bytes:
        """The frame's region, (h, w) luma or (h, w, 3) luma and chroma."""
        luma = self._cut(frame.luma)
        return luma_and_chroma(luma, self._cut(frame.bgr())) if self.chroma else luma

    def small(self, picture: Bytes) -> Bytes:
        """The picture at the size that is searched, each pixel the mean of those it stands for."""
        if self.step == 1:
            return picture
        return np.asarray(cv2.resize(picture, self.small_size, interpolation=cv2.INTER_AREA))

    def smalls(self, pictures: Bytes) -> Bytes:
        """Pictures (k, h, w[, 3]) at the size that is searched."""
        return pictures if self.step == 1 else np.stack([self.small(picture) for picture in pictures])

    def wanted(self, frame: Frame) -> Flags | None:
        """True for pixels (at the size that is searched) of the colour asked for; None when none was."""
        if self.colour is None:
            return None
        return self.colour.mask(self.small(self._cut(frame.bgr())))

    def fitted(self, frames: Sequence[Frame], moving: Sequence[Flags]) -> View:
        """The same view with the colour fitted to the pixels that move in some frames."""
        if self.colour is None:
            return self
        pixels = [self.small(self._cut(frame.bgr()))[where] for frame, where in zip(frames, moving, strict=True)]
        return replace(self, colour=self.colour.fitted(np.concatenate(pixels)))

    def with_chroma(self) -> View:
        """The same view with colour counted."""
        return replace(self, chroma=True)

    def _cut(self, image: Bytes) -> Bytes:
        return image[self.top : self.top + self.height, self.left : self.left + self.width]


def view_of(video: FrameSource, options: TrackOptions) -> View:
    """The view that the options ask for; DataError when they cannot be met."""
    if options.bodies < 1:
        raise DataError(f"bodies = {options.bodies}: there must be at least one body to follow")
    left, top, width, height = options.roi or (0, 0, video.width, video.height)
    inside = left >= 0 and top >= 0 and left + width <= video.width and top + height <= video.height
    if width < 1 or height < 1 or not inside:
        raise DataError(
            f"the region x={left}, y={top}, width={width}, height={height} does not lie in the picture, "
            f"which is {video.width} px wide and {video.height} px high"
        )
    colour = read_colour(options.colour) if options.colour else None
    return View(left, top, width, height, chroma=colour is not None, colour=colour)
