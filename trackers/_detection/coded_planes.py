"""Where a frame may differ strongly, by its planes as coded: colour need not be made as fine as luma for that."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.types import Frame
from trackers._detection.foreground import BackgroundRange, outside_of
from trackers._detection.strong_windows import TILE, boxes_of_tiles, tiles_of
from trackers._frames.arrays import Box, Bytes
from trackers._frames.working_image import WorkingView

Limits = tuple[Bytes, Bytes]  # lowest and highest level (h, w) that does not differ strongly


@dataclass(frozen=True, eq=False, slots=True)
class PlaneLimits:
    """Limits of luma, and of the planes cr and cb as coded, each of ``fold`` px of luma a side.

    A pixel of colour is a mean of the nearest coded ones, and can only be beyond its own limits where one of these is
    beyond the narrowest limits of the pixels that it contributes to.
    """

    view: WorkingView
    luma: Limits
    colours: tuple[Limits, ...]
    fold: int

    def windows(self, frame: Frame) -> list[Box]:
        """Boxes that hold every pixel of the search image that differs strongly, and perhaps others."""
        view, fold = self.view, self.fold
        rows, columns = slice(view.top, view.top + view.height), slice(view.left, view.left + view.width)
        tiles = tiles_of(outside_of(frame.luma[rows, columns], *self.luma), TILE)
        if self.colours:
            planes = frame.chroma()
            if planes is None:
                return [(0, 0, view.width, view.height)]
            for plane, limits in zip(planes[::-1], self.colours, strict=True):
                height, width = limits[0].shape
                part = plane[view.top // fold :, view.left // fold :][:height, :width]
                tiles |= tiles_of(outside_of(part, *limits), TILE // fold)
        return boxes_of_tiles(tiles, (view.width, view.height))


def plane_limits_of(view: WorkingView, frame: Frame, background_range: BackgroundRange) -> PlaneLimits | None:
    """The limits for images searched at full size; None where others are, or where colour is coded in another way.

    ``frame`` is one of the clip.
    """
    planes = frame.chroma() if view.chroma else ()
    if view.step > 1 or view.colour is not None or planes is None:
        return None
    lowest, highest = background_range.limits[2:]
    if not view.chroma:
        return PlaneLimits(view, (lowest, highest), (), 1)
    folds = {-(-frame.luma.shape[k] // plane.shape[k]) for plane in planes for k in (0, 1)}
    fold = folds.pop()
    if folds or fold > 2 or view.left % fold or view.top % fold:
        return None
    (low, *lows), (high, *highs) = cv2.split(lowest), cv2.split(highest)
    colours = [
        (_narrowed(a, fold, cv2.dilate), _narrowed(b, fold, cv2.erode)) for a, b in zip(lows, highs, strict=True)
    ]
    return PlaneLimits(view, (low, high), tuple(colours), fold)


def _narrowed(limit: Bytes, fold: int, narrow: Callable[..., object]) -> Bytes:
    """For each coded pixel the narrowest limit of the finer ones to which it contributes."""
    if fold == 1:
        return limit
    square = np.ones((2 * fold, 2 * fold), np.uint8)  # two coded pixels wide: from the middle of the one before
    return np.ascontiguousarray(np.asarray(narrow(limit, square, anchor=(1, 1)), dtype=np.uint8)[::fold, ::fold])
