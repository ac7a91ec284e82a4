"""Which detections are likely to be of the requested bodies, frame by frame: only these are measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from iris_sysid.types import FrameSource
from trackers._detection.detect_frames import DetectionSetup, measure_rough
from trackers._detection.detection import Detection, FrameDetections
from trackers._linking.select_bodies import CAUTIOUS_REACH, FIRST_REACH, MIN_DETECTIONS
from trackers._tracklets.frame_to_frame import Linking, Tracklet

# likely tracklets for each body, as a hand may go as far as the body; least worth of one more, over the last body's
SPARE, MIN_WORTH = 2, 0.3


@dataclass(eq=False, slots=True)
class LikelyBodies:
    """Links rough detections as they come; those on the tracklets that went farthest, and on new ones, are likely.

    ``count`` bodies are requested, in an image of that ``diagonal``, px.
    """

    count: int
    diagonal: float
    _linking: Linking = field(init=False)
    _paths: dict[int, _Path] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._linking = Linking(FIRST_REACH * self.diagonal, CAUTIOUS_REACH * self.diagonal)

    def among(self, seen: FrameDetections) -> list[bool]:
        """Which of the detections of the next frame are likely."""
        tracklets = self._linking.add(seen)
        self._paths = {id(tracklet): self._path(tracklet) for tracklet in self._linking.live}
        worth = [
            self._paths[id(tracklet)].extent * len(tracklet.detections) * looks(tracklet) for tracklet in tracklets
        ]
        young = [looks(tracklet) * (len(tracklet.detections) <= MIN_DETECTIONS) for tracklet in tracklets]
        likely = self._best(worth, MIN_WORTH) | self._best(young, 0.0)
        return [k in likely for k in range(len(tracklets))]

    def _best(self, worth: Sequence[float], nearly: float) -> set[int]:
        """The ``count`` that are worth most, and as many more whose worth is at least a share ``nearly`` of theirs."""
        order = np.argsort(np.negative(worth), kind="stable")[: SPARE * self.count].tolist()
        least = nearly * worth[order[min(self.count, len(order)) - 1]] if order else 0.0
        return {k for place, k in enumerate(order) if worth[k] > least or (nearly and place < self.count)}

    def _path(self, tracklet: Tracklet) -> _Path:
        return self._paths.get(id(tracklet), _Path()).extended(tracklet.last)


@dataclass(slots=True)
class _Path:
    """The box that holds a tracklet so far, px."""

    left: float = np.inf
    top: float = np.inf
    right: float = -np.inf
    bottom: float = -np.inf

    def extended(self, detection: Detection) -> _Path:
        x, y = detection.x, detection.y
        return _Path(min(self.left, x), min(self.top, y), max(self.right, x), max(self.bottom, y))

    @property
    def extent(self) -> float:
        """Diagonal of the box, px."""
        return float(np.hypot(self.right - self.left, self.bottom - self.top))


def looks(tracklet: Tracklet) -> float:
    """How much a tracklet looks like a body by its latest detection: large, sharp, compact; see ``score``."""
    return tracklet.last.radius * tracklet.last.sharpness * tracklet.last.compactness


def all_measured(video: FrameSource, setup: DetectionSetup, tracklets: Sequence[Tracklet]) -> list[Tracklet]:
    """The tracklets with those detections measured that were rough, without those that the edge of the image cuts."""
    rough = {detection for tracklet in tracklets for detection in tracklet.detections if not detection.measured}
    if not rough:
        return list(tracklets)
    known = measure_rough(video, setup, rough)
    seen = [[known.get(detection, detection) for detection in tracklet.detections] for tracklet in tracklets]
    return [Tracklet([detection for detection in path if detection is not None]) for path in seen]
