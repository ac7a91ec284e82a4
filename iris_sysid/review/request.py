"""What a review fits and how it tracks: the options of a run, from the command line or from the files of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from iris_sysid.calibration.pixel_scale import scale
from iris_sysid.errors import DataError, IrisError
from iris_sysid.pipeline.one_clip import AUTO, RunRequest, request_origin
from iris_sysid.registry import PHENOMENA, TRACKERS
from iris_sysid.types import (
    Calibration,
    ClipOptions,
    Estimate,
    GeometryOptions,
    TrackMark,
    TrackOptions,
)


@dataclass(frozen=True, eq=False, slots=True)
class ReviewRequest(RunRequest):
    """The options of a run; ``phenomenon`` is None until it is chosen, and nothing is fitted before.

    ``ignored`` are marks on objects that are not bodies, such as a hand.
    """

    ignored: tuple[TrackMark, ...] = ()

    @property
    def tracker(self) -> str:
        """The tracker that follows the bodies: the phenomenon's; ``auto`` where marks or no phenomenon are given."""
        return AUTO if self.phenomenon is None or self.tracking.marks else self.phenomenon.tracker

    @property
    def track_options(self) -> TrackOptions:
        """The options of the tracker, for as many bodies as the phenomenon has."""
        bodies = self.tracking.bodies if self.phenomenon is None else self.phenomenon.bodies
        return replace(self.tracking, bodies=max(bodies, len({mark.body for mark in self.tracking.marks})))

    def recorded(self) -> dict[str, Any]:
        """The request as a track's origin holds it."""
        ignored = {"ignored": [[mark.x_px, mark.y_px, mark.frame] for mark in self.ignored]} if self.ignored else {}
        if self.phenomenon is None:
            return {"tracker": self.tracker, "fps": self.clip.fps, **ignored}
        return {**request_origin(replace(self, tracking=self.track_options)), **ignored}


def request_of(options: Mapping[str, Any], calibration: Calibration | None = None) -> ReviewRequest:
    """The request that the origin of a track records, ``origin["options"]``; a calibration replaces the recorded scale.

    DataError when they are damaged, or record a camera whose file has to be given again; UnknownNameError when the
    phenomenon or the tracker is not installed.
    """
    try:
        name = options.get("phenomenon")
        phenomenon = PHENOMENA[str(name)] if name else None
        tracker = options.get("tracker")
        if phenomenon is not None and tracker:
            phenomenon = replace(phenomenon, tracker=TRACKERS[str(tracker)].name)  # [], which runs no file named there
        return ReviewRequest(
            phenomenon=phenomenon,
            calibration=calibration or _scale_of(options.get("scale")),
            settings={
                str(key): Estimate(float(one["value"]), float(one["stderr"]), str(one["unit"]), "direct", "given")
                for key, one in (options.get("settings") or {}).items()
            },
            free=tuple(map(str, options.get("free") or ())),
            clip=ClipOptions(
                options.get("fps"),
                float(options.get("clock_stderr") or 0.0),
                options.get("start_s"),
                options.get("stop_s"),
                bool(options.get("keep_partial")),
            ),
            geometry=_geometry_of(options),
            tracking=_tracking_of(options),
            ignored=tuple(TrackMark("", float(x), float(y), int(n)) for x, y, n in options.get("ignored") or ()),
        )
    except (TypeError, ValueError, KeyError, AttributeError, IndexError) as error:
        if isinstance(error, IrisError):
            raise
        raise DataError(f"the request recorded in the track's origin file is damaged: {error}") from error


def _scale_of(recorded: Mapping[str, Any] | None) -> Calibration | None:
    if recorded is None:
        return None
    if not recorded["plain"]:
        raise DataError("the run used a camera or a plane from a file: give it again with --calibration")
    value, stderr = float(recorded["px_per_unit"]), float(recorded["stderr"])
    return scale(value, 1.0, px_stderr=stderr, source=str(recorded["source"]))


def _geometry_of(options: Mapping[str, Any]) -> GeometryOptions:
    gravity, plumb = options.get("scale_from_gravity"), options.get("plumb_px")
    stderr = float(options.get("scale_from_gravity_stderr") or 0.0)
    return GeometryOptions(
        marks_px={str(name): (float(at[0]), float(at[1])) for name, at in (options.get("marks_px") or {}).items()},
        plumb_px=None if plumb is None else (float(plumb[0]), float(plumb[1]), float(plumb[2]), float(plumb[3])),
        vertical="motion" if options.get("vertical") == "motion" else "assumed",
        scale_from_gravity=None
        if gravity is None
        else Estimate(float(gravity), stderr, "m/s^2", "direct", f"given: gravity={gravity}"),
    )


def _tracking_of(options: Mapping[str, Any]) -> TrackOptions:
    roi = options.get("roi")
    return TrackOptions(
        bodies=int(options.get("bodies") or 1),
        roi=None if roi is None else (int(roi[0]), int(roi[1]), int(roi[2]), int(roi[3])),
        colour=options.get("colour"),
        marks=tuple(
            TrackMark(str(body), float(x), float(y), int(frame))
            for body, x, y, frame in options.get("body_marks") or ()
        ),
    )
