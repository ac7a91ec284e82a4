"""Follow the bodies of a clip by the tracker of some name; loads nothing that fits or reports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from iris_sysid.files import origin_of
from iris_sysid.registry import TRACKERS
from iris_sysid.types import FrameSource, Track, TrackOptions


def track(video: FrameSource, tracker: str = "median-background", options: TrackOptions | None = None) -> list[Track]:
    """Follow the bodies of a clip with the tracker of that name.

    Parameters
    ----------
    video
        Frames with their times, from :func:`iris_sysid.open_video`.
    tracker
        Registered name; ``iris-sysid list`` shows them.
    options
        Region, colour, number of bodies, progress.

    Returns
    -------
    list of Track
        One a body, in px and s; a frame without the body is NaN and not valid.

    Raises
    ------
    UnknownNameError
        When no tracker has that name.
    TrackingError
        When nothing moves, or nothing that moves can be followed.
    """
    return TRACKERS[tracker].track(video, options or TrackOptions())


def from_source(tracks: Sequence[Track], source: str | Path, options: Mapping[str, Any]) -> list[Track]:
    """The tracks with the file they come from, its sha256, the options and the versions of packages as their origin."""
    origin = origin_of(Path(source), options)
    return [replace(one, origin={**one.origin, **origin}) for one in tracks]
