"""The options of a run on one clip, and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from iris_sysid.types._calibration import Calibration
from iris_sysid.types._clip import FrameSource, Track
from iris_sysid.types._display import Shown
from iris_sysid.types._motion import Trajectory
from iris_sysid.types._numbers import Estimate
from iris_sysid.types._plugins import Phenomenon
from iris_sysid.types._result import FitResult


@dataclass(frozen=True, slots=True)
class ClipOptions:
    """The part of a clip to read, and the timing of its frames.

    ``fps`` is the true frame rate in 1/s, where that of the file is the one of slow-motion playback; ``fps_stderr`` its
    relative standard error, common to all times. ``start_s`` and ``stop_s`` limit the part that is read, s.
    ``keep_partial`` uses what can be read of a damaged file.
    """

    fps: float | None = None
    fps_stderr: float = 0.0
    start_s: float | None = None
    stop_s: float | None = None
    keep_partial: bool = False


@dataclass(frozen=True, slots=True)
class GeometryOptions:
    """Known geometry of the scene, in addition to the calibration.

    ``marks_px`` are points marked in the image, (x, y) px by name: ``pivot`` of a pendulum, ``launch`` of a throw.
    ``plumb_px`` holds two points of a plumb line (x1, y1, x2, y2), px, upper end first. ``vertical``: ``motion`` takes
    the direction of gravity from the flight, ``assumed`` as the calibration has it. ``scale_from_gravity`` is a known
    gravity in m/s^2, from which the scale of a free flight is computed.
    """

    marks_px: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    plumb_px: tuple[float, float, float, float] | None = None
    vertical: Literal["assumed", "motion"] = "assumed"
    scale_from_gravity: Estimate | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Run(Shown):
    """All results of one clip, from the track to the fit; :func:`iris_sysid.write_report` draws them.

    ``tracks`` in px and ``world``, x and z, have one entry per body; ``trajectory`` is the observable that the model
    was fitted to. ``notes`` say what a user should know.
    """

    source: Path
    video: FrameSource
    phenomenon: Phenomenon
    calibration: Calibration
    tracks: Sequence[Track]
    world: Sequence[Trajectory]
    trajectory: Trajectory
    fit: FitResult
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return "\n  ".join([f"Run of {self.source.name} as {self.phenomenon.name}", *repr(self.fit).splitlines()[:2]])
