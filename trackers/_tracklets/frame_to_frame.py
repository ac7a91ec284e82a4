"""Detections of successive frames linked into tracklets by assignment to predicted positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from iris_sysid.types import Array
from trackers._detection.detection import Detection, FrameDetections
from trackers._tracklets.least_cost import least_cost_pairs

SPEED_CHANGE = 0.8  # of the distance that the body goes in the time
MAX_GAP = 5  # frames over which a tracklet is predicted
APPEARANCE_WEIGHT = 1.0  # cost of looking different by a factor e, beside 1 for a miss as large as the reach
MAX_COST = 2.0  # cost above which a detection is not joined
FORBIDDEN = 1e6


class Brightness(NamedTuple):
    """Mean luma of a body, its signed mean difference from the background, and its contrast, grey levels."""

    intensity: float
    brightening: float
    contrast: float

    def is_steady(self, other: Brightness, share: float) -> bool:
        """Whether its own brightness changed by less than a ``share`` of the change of the background behind it."""
        behind = self.intensity - self.brightening, other.intensity - other.brightening
        return abs(self.intensity - other.intensity) < share * abs(behind[0] - behind[1])

    def opposition(self, other: Brightness) -> float:
        """How far two bodies are on opposite sides of their background: 0 not at all, 2 as far as can be.

        A body darker than its background is on side -1, a brighter one on side 1. Two balls that strike each other may
        differ in nothing else. One that keeps its own brightness and comes before another background is the same body:
        what counts is the change of its brightness over the sum of the contrasts.
        """
        apart = abs(self.brightening / self.contrast - other.brightening / other.contrast)
        return apart * min(1.0, abs(self.intensity - other.intensity) / (self.contrast + other.contrast))


@dataclass(eq=False)
class Tracklet:
    """Detections believed to be of one body, in time order."""

    detections: list[Detection] = field(default_factory=list)

    @property
    def first(self) -> Detection:
        """The earliest detection."""
        return self.detections[0]

    @property
    def last(self) -> Detection:
        """The latest detection."""
        return self.detections[-1]

    @property
    def xy(self) -> Array:
        """Positions (n, 2), px."""
        return np.array([(detection.x, detection.y) for detection in self.detections])

    @property
    def frames(self) -> set[int]:
        """Numbers of the frames in which the body was seen."""
        return {detection.frame for detection in self.detections}

    def typical(self, name: str) -> float:
        """Median over the tracklet of a property of its detections."""
        if len(self.detections) == 1:
            return float(getattr(self.last, name))
        return float(np.median([getattr(detection, name) for detection in self.detections]))

    @property
    def brightness(self) -> Brightness:
        """Median brightness."""
        if len(self.detections) == 1:
            return brightness_of(self.last)
        each = [brightness_of(detection) for detection in self.detections]
        return Brightness(*np.median(each, axis=0).tolist())

    def velocity(self) -> Array:
        """Velocity (2,) between the last two detections, px/s; zero when there is one."""
        if len(self.detections) < 2:
            return np.zeros(2)
        before, last = self.detections[-2:]
        return np.array([last.x - before.x, last.y - before.y]) / (last.t_s - before.t_s)

    def predicted(self, t_s: float) -> Array:
        """Position (2,) in px at time ``t_s`` in s if the velocity stays."""
        return np.array([self.last.x, self.last.y]) + self.velocity() * (t_s - self.last.t_s)

    def reach(self, t_s: float) -> float:
        """How far from the prediction the body may be at ``t_s``, px, judged by its speed and size."""
        return max(3.0 * self.last.radius, self.speed_change(t_s))

    def speed_change(self, t_s: float) -> float:
        """How far from the prediction a change of its speed may bring the body until ``t_s``, px."""
        return SPEED_CHANGE * float(np.hypot(*self.velocity())) * abs(t_s - self.last.t_s)


def brightness_of(detection: Detection) -> Brightness:
    """Brightness of one detection."""
    return Brightness(detection.centre.intensity, detection.brightening, detection.contrast)


def dissimilarity(detection: Detection, other: Detection) -> float:
    """How different two detections look: log ratios of area, contrast and, weighing half, compactness; and the side."""
    return float(
        abs(np.log(detection.area / other.area))
        + abs(np.log(detection.contrast / other.contrast))
        + 0.5 * abs(np.log(detection.compactness / other.compactness))
        + 0.5 * brightness_of(detection).opposition(brightness_of(other))
    )


@dataclass(eq=False, slots=True)
class Linking:
    """Joins the detections of frames, as they come, into tracklets; a tracklet ends when it is not seen for some.

    Each frame's detections go to the tracklets at the least total cost (Kuhn-Munkres): the miss from the
    prediction over the reach, plus the difference in appearance.

    ``first_reach`` is how far a body may go between its first two detections, px, ``least_reach`` how far from its
    prediction a body may be whatever its speed and size, px. ``live`` are the tracklets that may go on.
    """

    first_reach: float
    least_reach: float
    live: list[Tracklet] = field(default_factory=list)
    done: list[Tracklet] = field(default_factory=list)

    def add(self, seen: FrameDetections) -> list[Tracklet]:
        """The tracklet of each detection of the next frame."""
        self.done += [tracklet for tracklet in self.live if seen.frame - tracklet.last.frame > MAX_GAP]
        self.live = [tracklet for tracklet in self.live if seen.frame - tracklet.last.frame <= MAX_GAP]
        joined = {column: row for row, column in _assign(self.live, seen, self.first_reach, self.least_reach).items()}
        new = [k for k in range(len(seen.detections)) if k not in joined]
        for column, row in joined.items():
            self.live[row].detections.append(seen.detections[column])
        joined |= {k: len(self.live) + number for number, k in enumerate(new)}
        self.live += [Tracklet([seen.detections[k]]) for k in new]
        return [self.live[joined[k]] for k in range(len(seen.detections))]


def link(all_detections: Sequence[FrameDetections], first_reach: float, least_reach: float) -> list[Tracklet]:
    """Join the detections of all frames into tracklets; see :class:`Linking`.

    Parameters
    ----------
    all_detections
        The detections of each frame, in order.
    first_reach, least_reach
        As of :class:`Linking`, px.
    """
    linking = Linking(first_reach, least_reach)
    for frame_detections in all_detections:
        linking.add(frame_detections)
    return linking.done + linking.live


def _assign(
    live: list[Tracklet], frame_detections: FrameDetections, first_reach: float, least_reach: float
) -> dict[int, int]:
    """Which live tracklet (row) takes which detection (column)."""
    if not live or not frame_detections.detections:
        return {}
    seen = np.array([(detection.x, detection.y) for detection in frame_detections.detections])
    cost = np.full((len(live), len(seen)), FORBIDDEN)
    for row, tracklet in enumerate(live):
        reach = max(tracklet.reach(frame_detections.t_s), first_reach if len(tracklet.detections) < 2 else least_reach)
        miss = np.hypot(*(seen - tracklet.predicted(frame_detections.t_s)).T) / reach
        for column in np.flatnonzero(miss < 1.0):
            appearance = dissimilarity(tracklet.last, frame_detections.detections[column])
            cost[row, column] = miss[column] + APPEARANCE_WEIGHT * appearance
    rows, columns = least_cost_pairs(cost)
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if cost[r, c] < MAX_COST}
