"""Trackers whose background is learnt as the clip goes, by one of OpenCV's subtractors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Frame, FrameSource, Track, TrackOptions, with_progress
from trackers._background.median import Background, Bytes, Flags, Still
from trackers._detection.detect_frames import REPORT_EVERY, Stage, stage_of
from trackers._detection.detection import Glimpse, Lens
from trackers._detection.foreground import SMALLEST_AREA, SQUARE, Component, cores_of, most_of_channels
from trackers._frames.working_image import view_of
from trackers._linking.select_bodies import follow
from trackers._linking.to_track import track_of

HISTORY = 500  # frames after which what was seen counts little, as OpenCV has it
OPENED = np.ones((2, 2), np.uint8)  # single pixels of the foreground are noise


class Subtractor(Protocol):
    """One of OpenCV's background subtractors."""

    def apply(self, image: Bytes, fgmask: None = None, learningRate: float = -1) -> Bytes:
        """The foreground of the next ``image``, not 0 where it is; ``fgmask`` and ``learningRate`` as OpenCV's."""

    def getBackgroundImage(self) -> Bytes:
        """What the background shows."""


@dataclass(frozen=True, eq=False, slots=True)
class _Adaptive:
    """The subtractor at work on the frames of a clip, in order."""

    stage: Stage
    subtractor: Subtractor

    def glimpse(self, frame: Frame) -> Glimpse:
        """The candidates of the next frame."""
        picture = self.stage.view.searched(frame)
        shown = np.asarray(self.subtractor.apply(picture, None, 1 / HISTORY)) > 0
        behind = np.asarray(self.subtractor.getBackgroundImage()).reshape(picture.shape)
        level = most_of_channels(cv2.absdiff(picture, behind))
        things = cores_of(_components(shown, level), shown.shape)
        wanted = self.stage.view.wanted(frame)
        bodies = things if wanted is None else cores_of(_components(shown & wanted, level), shown.shape)
        return self._lens(behind).glimpse(frame, bodies, things)

    def _lens(self, behind: Bytes) -> Lens:
        """The lens before the background as it is now, where it is known pixel by pixel."""
        lens = self.stage.lens
        if lens.background.whole is None:
            return lens
        still = Still(behind.astype(np.float32), lens.background.whole.noise)
        return replace(lens, background=Background(self.stage.stack, None, still))


def track_with(make: Callable[[int], Subtractor], name: str, video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow bodies before a background that a subtractor learns, at first from sampled frames, then frame by frame.

    In a picture wider than the search the bodies are measured against the background by sampled frames.

    Parameters
    ----------
    make
        Makes the subtractor, given the number of frames that it remembers.
    name
        Of the tracker.
    video
        The clip.
    options
        As any tracker's.
    """
    stage = stage_of(video, view_of(video, options))
    cv2.setRNGSeed(0)  # KNN draws at random which frames it keeps
    subtractor = make(HISTORY)
    for count, picture in enumerate(stage.smalls, start=1):
        subtractor.apply(picture, None, 1 / count)
    adaptive, glimpses = _Adaptive(stage, subtractor), []
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        glimpses.append(adaptive.glimpse(frame))
    if not glimpses:
        raise TrackingError("the clip gave no frames; is the part between --start and --stop empty?")
    paths = follow(glimpses, options.bodies, float(np.hypot(video.width, video.height)))
    asked = {"tracker": name, "bodies": options.bodies, "roi": options.roi, "colour": options.colour}
    origin = {**asked, "colour_used": stage.view.chroma, "history": HISTORY}
    return [track_of(path, glimpses, str(number), origin) for number, path in enumerate(paths, start=1)]


def _components(shown: Flags, level: Bytes) -> Iterator[Component]:
    """The connected parts of a foreground, each with how much it differs from the background."""
    opened = cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_OPEN, OPENED)
    closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, SQUARE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    for label in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[label])
        if area >= SMALLEST_AREA:
            window = (slice(top, top + height), slice(left, left + width))
            yield Component((labels[window] == label).astype(np.uint8), level[window], left, top)
