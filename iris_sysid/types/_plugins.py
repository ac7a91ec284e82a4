"""A tracker, and a row of the benchmark that says how everything goes together."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from iris_sysid.types._clip import FrameSource, Track, TrackOptions
from iris_sysid.types._display import text_of
from iris_sysid.types._motion import MotionKind, Trajectory
from iris_sysid.types._numbers import Estimate
from iris_sysid.types._pickling import Portable
from iris_sysid.types._result import FitResult


@dataclass(frozen=True, eq=False, slots=True)
class TrackerExample:
    """What a tracker follows in the contract tests: a drawn scene, the options that it needs there, and how well.

    ``tolerance_px`` is the largest RMS error in px of the position in that scene.
    """

    scene: Literal["moving-disc", "fading-lamp", "turning-arm", "draining-vessel"] = "moving-disc"
    options: TrackOptions = field(default_factory=TrackOptions)
    tolerance_px: float = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class Tracker:
    """A tracking algorithm: frames in, one Track a body out. One file in ``trackers`` holds one.

    ``suits(video, options, moving)`` says whether ``auto`` is to try it on a clip; None: never. ``moving`` says whether
    anything moves before a still background.
    """

    name: str
    summary: str
    track: Callable[[FrameSource, TrackOptions], list[Track]]
    example: TrackerExample = field(default_factory=TrackerExample)
    suits: Callable[[FrameSource, TrackOptions, bool], bool] | None = None

    def __repr__(self) -> str:
        return text_of(f"Tracker {self.name}: {self.summary}")


@dataclass(frozen=True, eq=False, slots=True)
class BenchmarkClass:
    """A class of a published data set: the folder of its clips, ``<folder>/<setting>/<clip>``.

    ``settings`` and the number of ``trials`` of each are what was published. ``parameters`` gives the name that an
    estimate of ours has in ``parameters.json``, where angles are in degrees. ``dataset`` is the name of the published
    data set, ``iris`` or ``delfys75``; empty for a class of no published one.
    """

    folder: str
    settings: tuple[str, ...]
    trials: int
    parameters: Mapping[str, str]
    dataset: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Phenomenon(Portable):
    """One row of the benchmark: which tracker, how positions become the observable, which model.

    ``observe(world, settings)`` turns trajectories of x and z (one a body, segmented) into the one
    the model observes; ``settings`` holds what the user stated (ball radius, board angle, pivot).
    ``motion`` is the kind of motion that the segmentation looks for. ``free`` names constants of the
    model that a video leaves open, e.g. the direction of the vertical. ``refine(fit, trajectory)``
    returns settings that the fit knows better than the geometry did, for another pass. ``settings``
    names what ``observe`` may be told beside the parameters of the model. ``measures`` says what of a track the
    trajectories hold: x and z, z alone (``height``), or one of its other columns. ``classes`` are the folders of
    published data sets that show it.
    """

    name: str
    summary: str
    tracker: str
    model: str
    observe: Callable[[Sequence[Trajectory], Mapping[str, Estimate]], Trajectory]
    motion: MotionKind = "any"
    bodies: int = 1
    free: tuple[str, ...] = ()
    refine: Callable[[FitResult, Trajectory], Mapping[str, Estimate]] | None = None
    settings: tuple[str, ...] = ()
    measures: Literal["position", "height", "radius", "angle", "intensity"] = "position"
    classes: tuple[BenchmarkClass, ...] = ()

    @property
    def free_flight(self) -> bool:
        """Whether positions of a free flight are measured: gravity gives their scale."""
        return (self.motion, self.measures) == ("flight", "position")

    def __repr__(self) -> str:
        return text_of(f"Phenomenon {self.name}: {self.summary}", f"tracker {self.tracker}, model {self.model}")
