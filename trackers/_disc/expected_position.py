"""Expected position and radius of a disc in each frame, from a tracklet or from detected circles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from iris_sysid.types import Array
from trackers._detection.detection import FrameDetections
from trackers._disc.model import Disc, Motion
from trackers._tracklets.frame_to_frame import Tracklet

NEIGHBOURS = 2  # detections on either side whose median gives the radius
MAX_BREAK_S = 0.3  # no velocity is estimated across a longer gap
LESS_BENT = 0.5  # of the bend of the discs on both sides: where one side bends less, it alone gives the motion


@dataclass(eq=False, slots=True)
class ExpectedPath:
    """Discs by the number of the frame, with the time of each frame in s."""

    times: dict[int, float]
    discs: dict[int, Disc] = field(default_factory=dict)
    frame_time: float = field(init=False)

    def __post_init__(self) -> None:
        """Work out the time between two frames, s, by the median; 0 for a single frame."""
        self.frame_time = float(np.median(np.diff(list(self.times.values())))) if len(self.times) > 1 else 0.0

    def motion(self, frame: int, exposure_share: float) -> Motion:
        """Motion within an exposure that takes that share of the time between frames.

        Velocity and acceleration are those of the parabola through three discs: that before and that after it if
        there are both. Before and after an impact they are those of one side, where these bend much less (Harten,
        Engquist, Osher and Chakravarthy 1987, J. Comput. Phys. 71, 231).
        """
        near = self._near(frame)
        elapsed = self.times[near[-1]] - self.times[near[0]] if near else 0.0
        if exposure_share == 0 or not 0 < elapsed <= MAX_BREAK_S or not near[0] <= frame <= near[-1]:
            return Motion()
        t_s = (np.array([self.times[number] for number in near]) - self.times[frame]) / elapsed
        positions = np.array(
            [(self.discs[number].x, self.discs[number].y, self.discs[number].radius) for number in near]
        )
        slope = np.linalg.solve(np.vander(t_s, increasing=True), positions)
        share = exposure_share * self.frame_time / elapsed
        bend = 2 * share**2 * slope[2, :2] if len(near) == 3 else np.zeros(2)
        return Motion(*(share * slope[1]), *bend)

    def _near(self, frame: int) -> list[int]:
        """The frames of the three discs that give the motion at a frame."""
        frames = sorted(self.discs)
        last = max(0, len(frames) - 3)
        middle = int(np.clip(np.searchsorted(frames, frame) - 1, 0, last))
        beside = [first for first in (middle - 1, middle + 1) if 0 <= first <= last]
        threes = [frames[first : first + 3] for first in (middle, *beside)]
        bends = [self._bend(three) for three in threes]
        best = int(np.argmin(bends))
        return threes[best if bends[best] < LESS_BENT * bends[0] else 0]

    def _bend(self, frames: Sequence[int]) -> float:
        """How far the middle one of three discs lies off the line through the others, px; infinite if far apart."""
        if len(frames) < 3 or self.times[frames[-1]] - self.times[frames[0]] > MAX_BREAK_S:
            return np.inf
        (first, middle, last), (a, b, c) = (self.discs[k] for k in frames), (self.times[k] for k in frames)
        share = (b - a) / (c - a)
        return float(
            np.hypot(middle.x - first.x - share * (last.x - first.x), middle.y - first.y - share * (last.y - first.y))
        )

    def extrapolated(self, frame: int, frames: Sequence[int]) -> Disc:
        """The disc at a frame from those at some others, by a straight line through them."""
        known = [self.discs[number] for number in frames]
        if len(known) == 1:
            return known[0]
        t_s = np.array([self.times[number] for number in frames])
        values = np.array([(disc.x, disc.y, disc.radius) for disc in known])
        slope, level = np.polyfit(t_s - self.times[frame], values, 1)
        del slope
        return Disc(float(level[0]), float(level[1]), max(1.0, float(level[2])), blur=known[-1].blur)


def expected_path_of(tracklet: Tracklet, all_detections: Sequence[FrameDetections]) -> ExpectedPath:
    """The path along a tracklet; the radius is that of the area, by the median of a few detections."""
    radii = np.array([detection.radius for detection in tracklet.detections])
    expected_path = ExpectedPath({frame_detections.frame: frame_detections.t_s for frame_detections in all_detections})
    for k, detection in enumerate(tracklet.detections):
        near: Array = radii[max(0, k - NEIGHBOURS) : k + NEIGHBOURS + 1]
        expected_path.discs[detection.frame] = Disc(detection.x, detection.y, float(np.median(near)))
    return expected_path
