"""Trackers whose background adapts frame by frame, by one of the background subtractors of OpenCV."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import cv2
import numpy as np

from iris_sysid.types import Frame, FrameSource, Track, TrackOptions, with_progress
from trackers._background.median import Background, BackgroundEstimate
from trackers._detection.detect_frames import REPORT_EVERY, DetectionSetup, detection_setup
from trackers._detection.detection import BlobDetector, FrameDetections
from trackers._detection.foreground import MIN_AREA, SQUARE, ConnectedComponent, blobs_of, most_of_channels
from trackers._frames.arrays import Bytes, Flags
from trackers._frames.working_image import view_of
from trackers._linking.select_bodies import link_bodies
from trackers._linking.to_track import track_of

HISTORY = 500  # frames after which an observation has little weight, as in OpenCV
OPENED = np.ones((2, 2), np.uint8)  # single pixels of the foreground are noise


class Subtractor(Protocol):
    """One of OpenCV's background subtractors."""

    def apply(self, image: Bytes, fgmask: None = None, learningRate: float = -1) -> Bytes:
        """The foreground of the next ``image``, not 0 where it is; ``fgmask`` and ``learningRate`` as OpenCV's."""

    def getBackgroundImage(self) -> Bytes:
        """The background image."""


@dataclass(frozen=True, eq=False, slots=True)
class _Adaptive:
    """The subtractor at work on the frames of a clip, in order."""

    setup: DetectionSetup
    subtractor: Subtractor

    def detect(self, frame: Frame) -> FrameDetections:
        """The candidates of the next frame."""
        image = self.setup.view.search_image(frame)
        shown = np.asarray(self.subtractor.apply(image, None, 1 / HISTORY)) > 0
        learned = np.asarray(self.subtractor.getBackgroundImage()).reshape(image.shape)
        level = most_of_channels(cv2.absdiff(image, learned))
        foreground = blobs_of(_components(shown, level), shown.shape)
        colour_mask = self.setup.view.colour_mask(frame)
        bodies = foreground if colour_mask is None else blobs_of(_components(shown & colour_mask, level), shown.shape)
        return self._detector(learned).detect(frame, bodies, foreground)

    def _detector(self, learned: Bytes) -> BlobDetector:
        """The detector before the background as it is now, where it is known pixel by pixel."""
        detector = self.setup.detector
        if detector.background.whole is None:
            return detector
        estimate = BackgroundEstimate(learned.astype(np.float32), detector.background.whole.noise)
        return replace(detector, background=Background(self.setup.stack, None, estimate))


def track_with(make: Callable[[int], Subtractor], name: str, video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow bodies before a background that a subtractor learns, at first from sampled frames, then frame by frame.

    In an image wider than the search the bodies are measured against the background by sampled frames.

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
    setup = detection_setup(video, view_of(video, options))
    cv2.setRNGSeed(0)  # KNN draws at random which frames it keeps
    subtractor = make(HISTORY)
    for count, image in enumerate(setup.search_images, start=1):
        subtractor.apply(image, None, 1 / count)
    adaptive, all_detections = _Adaptive(setup, subtractor), []
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        all_detections.append(adaptive.detect(frame))
    tracklets = link_bodies(all_detections, options.bodies, float(np.hypot(video.width, video.height)))
    stated = {"tracker": name, "bodies": options.bodies, "roi": options.roi, "colour": options.colour}
    origin = {**stated, "colour_used": setup.view.chroma, "history": HISTORY}
    return [
        track_of(tracklet, all_detections, str(number), origin) for number, tracklet in enumerate(tracklets, start=1)
    ]


def _components(shown: Flags, level: Bytes) -> Iterator[ConnectedComponent]:
    """The connected parts of a foreground, each with how much it differs from the background."""
    opened = cv2.morphologyEx(shown.astype(np.uint8), cv2.MORPH_OPEN, OPENED)
    closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, SQUARE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    for label in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[label])
        if area >= MIN_AREA:
            window = (slice(top, top + height), slice(left, left + width))
            yield ConnectedComponent((labels[window] == label).astype(np.uint8), level[window], left, top)
