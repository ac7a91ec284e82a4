"""From a frame to the working image: cut to the region of interest, with or without colour, reduced in size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types import Frame, FrameSource, TrackOptions
from trackers._frames.arrays import Box, Bytes, Flags
from trackers._frames.colour_selection import Colour, colour_planes, read_colour, reduced

MAX_SEARCH_WIDTH = 960  # px: wider images are searched at reduced size


@dataclass(frozen=True, slots=True)
class WorkingView:
    """Region of the frame (px), whether colour counts, the given colour, and the reduction for detection.

    ``coarser`` is how many times smaller than usual an image is searched whose bodies are large.
    """

    left: int
    top: int
    width: int
    height: int
    chroma: bool = False
    colour: Colour | None = None
    coarser: int = 1

    @property
    def step(self) -> int:
        """How many pixels a side make one pixel of the search for bodies."""
        return min(self.coarser * -(-self.width // MAX_SEARCH_WIDTH), self.height)

    @property
    def box(self) -> Box:
        """Left, top, right and bottom (exclusive) of the region, px of the frame."""
        return (self.left, self.top, self.left + self.width, self.top + self.height)

    @property
    def search_size(self) -> tuple[int, int]:
        """Width and height of the image of the search; pixels beyond a whole number of them are left out."""
        return (self.width // self.step, self.height // self.step)

    def image(self, frame: Frame) -> Bytes:
        """The frame's region, (h, w) luma or (h, w, 3) luma and chroma."""
        return self.part(frame, (0, 0, self.width, self.height))

    def part(self, frame: Frame, box: Box, step: int = 1) -> Bytes:
        """A part of the region, (h, w) or (h, w, 3), each pixel the mean of ``step`` x ``step``.

        ``box`` is left, top, right, bottom (exclusive) in such pixels, from the region's corner.
        """
        left, top, right, bottom = (side * step for side in box)
        x, y = left + self.left, top + self.top
        luma = reduced(frame.luma[y : bottom + self.top, x : right + self.left], step)
        if not self.chroma:
            return luma
        red, blue = colour_planes(frame, (x, y, right + self.left, bottom + self.top), step)
        return np.asarray(cv2.merge((luma, red, blue)), dtype=np.uint8)

    def search_image(self, frame: Frame) -> Bytes:
        """The frame's region at the size of the search."""
        return self.part(frame, (0, 0, *self.search_size), self.step)

    def sparse_image(self, frame: Frame, spacing: int) -> Bytes:
        """Single pixels of the region, one for every ``spacing`` pixels a side of the image of the search."""
        pace = self.step * spacing
        height, width = (size // spacing for size in self.search_size[::-1])
        start = (self.top + pace // 2, self.left + pace // 2)
        planes = [frame.luma, *(frame.chroma() or ())[::-1]] if self.chroma else [frame.luma]
        chosen = []
        for plane in planes:
            down, across = (-(-frame.luma.shape[k] // plane.shape[k]) for k in (0, 1))
            rows, columns = start[0] // down, start[1] // across
            chosen.append(plane[rows :: pace // down, columns :: pace // across][:height, :width])
        return np.ascontiguousarray(chosen[0]) if len(chosen) == 1 else np.dstack(chosen)

    def small(self, image: Bytes) -> Bytes:
        """An image of the region at the size of the search, each pixel the mean of those it stands for."""
        width, height = (size * self.step for size in self.search_size)
        return reduced(image[:height, :width], self.step)

    def colour_mask(self, frame: Frame, box: Box | None = None) -> Flags | None:
        """True for pixels of the given colour, in a box of the search image; None when no colour is given."""
        if self.colour is None:
            return None
        left, top, right, bottom = (side * self.step for side in box or (0, 0, *self.search_size))
        bgr = frame.bgr()[top + self.top : bottom + self.top, left + self.left : right + self.left]
        return self.colour.mask(reduced(bgr, self.step))

    def fitted(self, frames: Sequence[Frame], moving: Sequence[Flags]) -> WorkingView:
        """The same view with the colour fitted to the pixels that move in some frames."""
        if self.colour is None:
            return self
        region = slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)
        pixels = [self.small(frame.bgr()[region])[where] for frame, where in zip(frames, moving, strict=True)]
        return replace(self, colour=self.colour.fitted(np.concatenate(pixels)))

    def in_search(self, x_px: float, y_px: float) -> tuple[float, float]:
        """A position in px of the frame, in px of the image of the search."""
        return (x_px - self.left + 0.5) / self.step - 0.5, (y_px - self.top + 0.5) / self.step - 0.5

    def in_frame(self, x: float, y: float) -> tuple[float, float]:
        """A position in px of the image of the search, in px of the frame."""
        return (x + 0.5) * self.step - 0.5 + self.left, (y + 0.5) * self.step - 0.5 + self.top

    def with_chroma(self) -> WorkingView:
        """The same view with colour counted."""
        return replace(self, chroma=True)


def view_of(video: FrameSource, options: TrackOptions) -> WorkingView:
    """The view that the options ask for; DataError when they cannot be met."""
    if options.bodies < 1:
        raise DataError(f"bodies = {options.bodies}: there must be at least one body to follow")
    left, top, width, height = options.roi or (0, 0, video.width, video.height)
    inside = left >= 0 and top >= 0 and left + width <= video.width and top + height <= video.height
    if width < 1 or height < 1 or not inside:
        raise DataError(
            f"the region x={left}, y={top}, width={width}, height={height} does not lie in the image, "
            f"which is {video.width} px wide and {video.height} px high"
        )
    colour = read_colour(options.colour) if options.colour else None
    return WorkingView(left, top, width, height, chroma=colour is not None, colour=colour)
