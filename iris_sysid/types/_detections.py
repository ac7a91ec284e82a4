"""What may be a body in each frame, how detections are linked, and the three stages of a tracker as plugins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.types._arrays import Array, frozen_array, increasing_times
from iris_sysid.types._clip import FrameSource, Track, TrackOptions
from iris_sysid.types._display import text_of
from iris_sysid.types._pickling import Portable


@dataclass(frozen=True, eq=False, slots=True)
class Detections(Portable):
    """What may be a body, in every frame of a clip: the result of a detector, the input of a linker.

    ``frames`` (m,) are the numbers of all frames, ``t_s`` (m,) their times in s, ``size`` width and height of the image
    in px. Each of the n detections has its ``frame`` (n,), one of ``frames``; ``xy_px`` (n, 2), px; ``sigma_px`` (n,),
    standard error of each coordinate, px; ``radius_px`` (n,); and ``probability`` (n,) that it is of a body that is
    meant. ``looks`` (n, k) are numbers that differ by about 1 between two detections of one body. ``evidence`` (n,) by
    name is what the probability was computed from.
    """

    frames: NDArray[np.int64]
    t_s: Array
    size: tuple[int, int]
    frame: NDArray[np.int64]
    xy_px: Array
    sigma_px: Array
    radius_px: Array
    probability: Array
    looks: Array
    evidence: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times, number = increasing_times(self.t_s), len(self.frame)
        shapes = {"sigma_px": (number,), "radius_px": (number,), "probability": (number,), "xy_px": (number, 2)}
        arrays = {name: frozen_array(getattr(self, name), shape, name) for name, shape in shapes.items()}
        arrays |= {"t_s": times, "looks": frozen_array(self.looks, (number, None), "looks")}
        for name, values in arrays.items():
            object.__setattr__(self, name, values)
        for name in ("frames", "frame"):
            numbers = np.array(getattr(self, name), dtype=np.int64)
            numbers.flags.writeable = False
            object.__setattr__(self, name, numbers)
        if self.frames.shape != times.shape:
            raise DataError(f"there are {times.size} times of {self.frames.size} frames; give one a frame")
        if not np.isin(self.frame, self.frames).all():
            raise DataError("a detection is in a frame that is not among the frames; give its number as in frames")
        outside = ~((self.probability >= 0) & (self.probability <= 1))
        if outside.any():
            raise DataError(f"a probability is {self.probability[outside][0]:g}; it must be between 0 and 1")
        evidence = {name: frozen_array(values, (number,), name) for name, values in self.evidence.items()}
        object.__setattr__(self, "evidence", MappingProxyType(evidence))

    def __len__(self) -> int:
        return int(self.frame.size)

    def __repr__(self) -> str:
        return text_of(f"Detections: {len(self)} in {self.t_s.size} frames of {self.size[0]} x {self.size[1]} px")


@dataclass(frozen=True, slots=True)
class LinkOptions:
    """How detections are linked to tracks.

    ``bodies`` is the number of tracks. ``search_range_px`` is how far a body may be from where it is predicted, px a
    frame; None: a quarter of the image's diagonal. ``memory`` is for how many frames in a row a body may be unseen.
    ``gap_odds`` are those that a body is unseen from one frame to the next, for any time up to the memory;
    ``birth_odds`` and ``death_odds`` those that, in a frame, something comes into view, or leaves it for good.
    """

    bodies: int = 1
    search_range_px: float | None = None
    memory: int = 30
    gap_odds: float = 0.05
    birth_odds: float = 1e-3
    death_odds: float = 1e-3

    def __post_init__(self) -> None:
        if self.bodies < 1:
            raise DataError(f"bodies = {self.bodies}: there must be at least one body to follow")
        if self.memory < 0:
            raise DataError(f"memory = {self.memory}: it is a number of frames, 0 or more")
        if self.search_range_px is not None and not self.search_range_px > 0:
            raise DataError(f"search_range_px = {self.search_range_px:g}: it must be above 0 px")
        for name in ("gap_odds", "birth_odds", "death_odds"):
            if not 0 < getattr(self, name) < 1:
                raise DataError(f"{name} = {getattr(self, name):g}: odds a frame lie between 0 and 1")


@dataclass(frozen=True, eq=False, slots=True)
class Detector:
    """The first stage of a tracker: frames in, what may be a body out. One file in ``trackers/detectors`` holds one."""

    name: str
    summary: str
    detect: Callable[[FrameSource, TrackOptions], Detections]

    def __repr__(self) -> str:
        return text_of(f"Detector {self.name}: {self.summary}")


@dataclass(frozen=True, eq=False, slots=True)
class Linker:
    """The second stage of a tracker: detections in, tracks out. One file in ``trackers/linkers`` holds one."""

    name: str
    summary: str
    link: Callable[[Detections, LinkOptions], list[Track]]

    def __repr__(self) -> str:
        return text_of(f"Linker {self.name}: {self.summary}")


@dataclass(frozen=True, eq=False, slots=True)
class Measurer:
    """The third stage of a tracker: tracks in, sub-pixel ones out. One file in ``trackers/measurers`` holds one."""

    name: str
    summary: str
    measure: Callable[[FrameSource, Sequence[Track], TrackOptions], list[Track]]

    def __repr__(self) -> str:
        return text_of(f"Measurer {self.name}: {self.summary}")
