"""Search windows: where bodies were in the frame before, where a sparse pixel grid shows a change, or the whole frame.

An image that is searched at full size is searched everywhere. In a larger one every frame is checked at a sparse grid
of pixels, which costs little; the windows round changes there, and round what was there in the frame before, are
searched, and every few frames the whole image.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import TypeVar

import cv2
import numpy as np

from iris_sysid.types import Frame
from trackers._background.median import estimate_background
from trackers._detection.coded_planes import PlaneLimits
from trackers._detection.detection import MIN_INSCRIBED, BlobDetector, FrameCandidates
from trackers._detection.foreground import (
    BackgroundRange,
    Blob,
    ConnectedComponent,
    any_channel,
    blobs_of,
    components,
    parts_of,
    rounded,
    stout,
    whole_parts,
)
from trackers._detection.strong_windows import merged, overlap
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Box, Bytes, Flags
from trackers._frames.sampled_frames import SampledFrames
from trackers._frames.working_image import WorkingView

WHOLE_EVERY, WATCH_EVERY = 12, 3  # frames
SPACING = 4  # pixels of the search between those of the sparse grid
WATCH_SIGMAS, WATCH_FLOOR = 5.0, 8.0  # floor in grey levels: surely something
Result = TypeVar("Result")
PAIR = np.ones((2, 2), np.uint8)  # pixels of the sparse grid: the search of the whole image finds smaller bodies
GROWN_SHARE, GROWN_PX = 0.2, 6  # of its size, and px of the search: how far an object may go in a frame
MAX_CHANGES = 16  # a frame: more are flicker, or a camera that was pushed
GROWTHS = 3  # times a part of the image is made larger until it holds what is in it


@dataclass(eq=False, slots=True)
class SearchWindows:
    """Looks for bodies frame by frame, in order.

    ``background_range`` holds the grey levels of the background at the size of the search, ``sparse_range`` those at
    the pixels of the sparse grid; None to search the whole of every frame. ``plane_limits`` show in the planes as coded
    where a frame may differ, if they are known.
    """

    view: WorkingView
    background_range: BackgroundRange
    sparse_range: BackgroundRange | None
    plane_limits: PlaneLimits | None = None
    _boxes: list[Box] = field(default_factory=list)
    _count: int = 0
    _until_whole: int = 0

    def blobs(self, frame: Frame) -> tuple[list[Blob], list[Blob]]:
        """The blobs of the bodies in a frame, and those of all foreground, which are more where a colour is given."""
        parts, foreground = self._found(frame, self._where(frame))
        if len(_followed(foreground)) < self._count and self._whole not in parts:
            parts, foreground = self._found(frame, [self._whole])
        followed = _followed(foreground)
        self._count = len(followed)
        boxes = [part.box for ones in parts.values() for part in ones]
        self._boxes = [box for box in boxes if any(overlap(box, blob_box) for blob_box in followed)]
        self._until_whole = WHOLE_EVERY if self._whole in parts else self._until_whole - 1
        if self.view.colour is None:
            return foreground, foreground
        chosen = [part for box in parts for part in self._components(frame, box, self.view.colour_mask(frame, box))]
        return blobs_of(chosen, self._shape), foreground

    def each(
        self, work: Callable[[Frame, list[Blob], list[Blob]], Result], frames: Iterable[Frame]
    ) -> Iterator[Result]:
        """Some work on every frame and its :meth:`blobs`, on several frames at once; the results are in order.

        Where a search does not follow from the one before, the frames are searched at once too.
        """
        if self.sparse_range is None:
            yield from ahead(lambda frame: work(frame, *self.blobs(frame)), frames)
        else:
            yield from ahead(lambda found: work(*found), self.in_order(frames))

    def in_order(self, frames: Iterable[Frame]) -> Iterator[tuple[Frame, list[Blob], list[Blob]]]:
        """Every frame with its :meth:`blobs`, one after the other."""
        return ((frame, *self.blobs(frame)) for frame in frames)

    def candidates(self, detector: BlobDetector, frames: Iterable[Frame]) -> Iterator[FrameCandidates]:
        """What may be a body in every frame, in order."""
        if self.sparse_range is None:
            yield from self.each(detector.candidates, frames)
        else:  # the search takes less time than the measurement of its results in the other threads
            yield from (detector.candidates(*found) for found in self.in_order(frames))

    def _found(self, frame: Frame, boxes: list[Box]) -> tuple[dict[Box, list[ConnectedComponent]], list[Blob]]:
        """The components in some boxes, which grow until none cuts one, and their blobs."""
        parts = {box: self._components(frame, box) for box in boxes}
        for _ in range(GROWTHS):
            cut = {
                box
                for box, found_components in parts.items()
                if any(self._leaves(part.box, box) for part in found_components)
            }
            if not cut:
                break
            boxes = merged([self._grown(box) if box in cut else box for box in parts])
            parts = {box: parts[box] if box in parts else self._components(frame, box) for box in boxes}
        else:
            parts = {self._whole: self._components(frame, self._whole)}
        return parts, blobs_of((part for found_components in parts.values() for part in found_components), self._shape)

    def _components(self, frame: Frame, box: Box, colour_mask: Flags | None = None) -> list[ConnectedComponent]:
        if box == self._whole and colour_mask is None and self.plane_limits is not None:
            return list(whole_parts(partial(self._parts_in, frame), self.plane_limits.windows(frame), box[2:]))
        image = self.view.part(frame, box, self.view.step)
        moved = (
            component.moved(box[0], box[1])
            for component in components(self.background_range.part(box), image, colour_mask)
        )
        return list(moved if self.sparse_range is None else map(stout, moved))

    def _parts_in(self, frame: Frame, box: Box) -> list[ConnectedComponent]:
        return parts_of(self.background_range, self.view.part(frame, box, self.view.step), box)

    @property
    def _shape(self) -> tuple[int, ...]:
        return self.background_range.lowest.shape[:2]

    @property
    def _whole(self) -> Box:
        return (0, 0, self._shape[1], self._shape[0])

    def _where(self, frame: Frame) -> list[Box]:
        """The boxes to search, which do not overlap."""
        if self.sparse_range is None or self._until_whole <= 0:
            return [self._whole]
        known = [self._grown(box) for box in self._boxes]
        if self._until_whole % WATCH_EVERY:
            return merged(known)
        changes = self._changes(self.sparse_range, self.view.sparse_image(frame, SPACING), known)
        return merged(known + changes) if len(changes) <= MAX_CHANGES else [self._whole]

    def _changes(self, sparse_range: BackgroundRange, image: Bytes, known: list[Box]) -> list[Box]:
        """Boxes round the pixels of the sparse grid that show a compact object outside of the known boxes."""
        shown = any_channel(sparse_range.excess(image) > sparse_range.strong).astype(np.uint8)
        for left, top, right, bottom in known:
            shown[top // SPACING : -(-bottom // SPACING), left // SPACING : -(-right // SPACING)] = 0
        shown = cv2.erode(shown, PAIR, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        if not shown.any():
            return []
        contours, _ = cv2.findContours(shown, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        boxes = [cv2.boundingRect(contour) for contour in contours]
        boxes = [(x * SPACING, y * SPACING, (x + w) * SPACING, (y + h) * SPACING) for x, y, w, h in boxes]
        return [self._grown(box) for box in boxes]

    def _grown(self, box: Box) -> Box:
        """A box made larger on every side, within the image."""
        across, down = (GROWN_PX + int(GROWN_SHARE * size) for size in (box[2] - box[0], box[3] - box[1]))
        _, _, width, height = self._whole
        return (max(0, box[0] - across), max(0, box[1] - down), min(width, box[2] + across), min(height, box[3] + down))

    def _leaves(self, part: Box, box: Box) -> bool:
        """Whether a part reaches a side of its box that is inside the image."""
        return any(end == limit != edge for end, limit, edge in zip(part, box, self._whole, strict=True))


def _followed(foreground: list[Blob]) -> list[Box]:
    """The boxes of those blobs of the foreground that are thick enough for a body."""
    return [blob.box for blob in foreground if blob.inscribed > MIN_INSCRIBED]


def sparse_range_of(
    samples: SampledFrames, background_range: BackgroundRange, usable: Flags | None
) -> BackgroundRange | None:
    """What the background shows at the pixels of the sparse grid; None where images are searched at full size.

    ``usable`` (k, h', w') says at the size of the search which samples show the background.
    """
    view = samples.view
    if view.step == 1 or (view.chroma and samples.frames[0].chroma() is None):
        return None
    stack = np.stack([view.sparse_image(frame, SPACING) for frame in samples.frames])
    rows, columns = (slice(SPACING // 2, None, SPACING),) * 2
    estimate = estimate_background(
        stack, None if usable is None else usable[:, rows, columns][:, : stack.shape[1], : stack.shape[2]]
    )
    lowest, highest = (
        limit[rows, columns][: stack.shape[1], : stack.shape[2]]
        for limit in (background_range.lowest, background_range.highest)
    )
    noticed = rounded(np.maximum(WATCH_SIGMAS * estimate.noise, WATCH_FLOOR))
    background = rounded(estimate.background)
    return BackgroundRange(cv2.min(lowest, background), cv2.max(highest, background), noticed, noticed)
