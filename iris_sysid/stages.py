"""The three stages of a tracker: detect, link, measure. Each can be called alone, and replaced."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.registry import DETECTORS, LINKERS, MEASURERS
from iris_sysid.types import (
    Detections,
    Detector,
    FrameSource,
    Linker,
    LinkOptions,
    Measurer,
    Track,
    TrackOptions,
)
from iris_sysid.video.reader import open_video


def detect(
    video: str | Path | FrameSource, by: str | Detector = "motion", options: TrackOptions | None = None
) -> Detections:
    """Detect in every frame what may be a body, each with the probability that it is one.

    Parameters
    ----------
    video
        A clip's file, or frames, from :func:`iris_sysid.open_video` or :func:`iris_sysid.frames_from_array`. The camera
        stands still.
    by
        The detector, or its name: ``motion`` (what differs from the still background), ``disc`` (circular outlines),
        ``appearance`` (what looks like the objects that move), or ``FILE.py:NAME``.
    options
        ``roi`` limits the image, ``colour`` the bodies; ``bodies`` is how many are meant, ``progress`` is called.

    Returns
    -------
    Detections
        Rough positions, to a fraction of the radius.

    Raises
    ------
    VideoError, TrackingError
        When the clip has fewer than three frames, or does not show what the detector needs.
    UnknownNameError
        When no detector has that name.
    """
    return DETECTORS.resolved(by).detect(_opened(video), options or TrackOptions())


def link(detections: Detections, options: LinkOptions | None = None, by: str | Linker = "assignment") -> list[Track]:
    """Link detections to one track for each body.

    Parameters
    ----------
    detections
        From :func:`detect`, or your own.
    options
        Number of bodies, search range, memory and odds.
    by
        The linker, its name, or ``FILE.py:NAME``.

    Returns
    -------
    list of Track
        The likeliest first, with the rough positions and errors of the detections.

    Raises
    ------
    TrackingError
        When there are fewer tracks than bodies.
    UnknownNameError
        When no linker has that name.
    """
    return LINKERS.resolved(by).link(detections, options or LinkOptions())


def measure(
    video: str | Path | FrameSource,
    tracks: Sequence[Track],
    by: str | Measurer = "coverage",
    options: TrackOptions | None = None,
) -> list[Track]:
    """Measure the position of each body to a fraction of a pixel where its track says that it is.

    Parameters
    ----------
    video
        As of :func:`detect`.
    tracks
        From :func:`link`, or any other: px and s, with radii.
    by
        The measurer, its name, or ``FILE.py:NAME``.
    options
        ``roi`` and ``colour`` as of :func:`detect`.

    Returns
    -------
    list of Track
        In the order of ``tracks``; a frame in which a body is not seen at its place is a gap.

    Raises
    ------
    DataError
        When there is no track.
    UnknownNameError
        When no measurer has that name.
    """
    if not tracks:
        raise DataError("there are no tracks to measure; give those of link(detect(video))")
    return MEASURERS.resolved(by).measure(_opened(video), tracks, options or TrackOptions())


def _opened(video: str | Path | FrameSource) -> FrameSource:
    return open_video(video) if isinstance(video, str | Path) else video
