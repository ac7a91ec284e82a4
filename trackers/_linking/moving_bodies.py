"""The bodies that move before a still background: what each frame shows, and the tracklets of the bodies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import FrameSource, Track, TrackMark, TrackOptions
from trackers._detection.detect_frames import DetectionSetup, detection_setup, observe
from trackers._detection.detection import FrameDetections
from trackers._frames.working_image import WorkingView, view_of
from trackers._linking.at_edge import with_frames_at_edge
from trackers._linking.likely_bodies import LikelyBodies, all_measured
from trackers._linking.refined_background import behind_resting_body, refined_setup
from trackers._linking.select_bodies import link_bodies
from trackers._linking.to_track import track_of
from trackers._multi_body.given_masks import track_with_masks
from trackers._multi_body.track_together import track_together
from trackers._tracklets.frame_to_frame import Tracklet

MAX_SEPARATE = 2  # bodies: more of them are followed all at once
MAX_NEAR = 0.3  # share of its frames in which another path may be near a body


@dataclass(frozen=True, eq=False, slots=True)
class MovingBodies:
    """What each frame shows and the tracklets of the bodies that are meant.

    ``setup`` holds background and sampled frames; None where all bodies were followed at once, or by given masks.
    """

    all_detections: list[FrameDetections]
    tracklets: list[Tracklet]
    view: WorkingView
    setup: DetectionSetup | None = None

    def tracks(self, tracker: str, options: TrackOptions) -> list[Track]:
        """One Track a body, under the name of the requested tracker."""
        origin = {
            "tracker": tracker,
            "bodies": options.bodies,
            "roi": options.roi,
            "colour": options.colour,
            "colour_used": self.view.chroma,
            "mask": options.mask is not None,
        }
        return [
            track_of(tracklet, self.all_detections, str(number), origin, alone=len(self.tracklets) == 1)
            for number, tracklet in enumerate(self.tracklets, start=1)
        ]

    def among(self, video: FrameSource, options: TrackOptions, meant: Callable[[Tracklet], bool]) -> MovingBodies:
        """The bodies whose paths are ``meant``, from the same pass over the clip, even if others go farther.

        Raises
        ------
        TrackingError
            When fewer such paths are found than bodies requested, or all bodies were followed at once.
        """
        if self.setup is None:
            raise TrackingError("all bodies were followed at once: there are no other paths")
        diagonal = float(np.hypot(video.width, video.height))
        tracklets = link_bodies(self.all_detections, options.bodies, diagonal, meant)
        return replace(self, tracklets=_measured(video, self.setup, self.all_detections, tracklets))


def is_apart(tracks: Sequence[Track], tracklet: Tracklet) -> bool:
    """Whether a path is rarely within two radii of one of the tracks."""
    at = [dict(zip(track.frame.tolist(), track.xy_px, strict=True)) for track in tracks]
    near = [
        any(np.hypot(*(places[seen.frame] - (seen.x, seen.y))) < 2 * seen.radius for places in at)
        for seen in tracklet.detections
    ]
    return float(np.mean(near)) < MAX_NEAR


def is_marked(marks: Sequence[TrackMark], tracklet: Tracklet) -> bool:
    """Whether a path passes a mark within the radius of the body."""
    shown = {detection.frame: detection for detection in tracklet.detections}
    return any(
        np.hypot(shown[mark.frame].x - mark.x_px, shown[mark.frame].y - mark.y_px) < max(shown[mark.frame].radius, 3.0)
        for mark in marks
        if mark.frame in shown
    )


def follow(video: FrameSource, options: TrackOptions) -> MovingBodies:
    """Follow the bodies that move farthest before a still background, or those of the masks given.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    options
        As any tracker's.

    Raises
    ------
    TrackingError
        When nothing moves, or when fewer bodies move than requested.
    VideoError
        When there are fewer than three frames.
    """
    view = view_of(video, options)
    if options.mask is not None:
        return MovingBodies(*track_with_masks(video, view, options, options.mask))
    if options.bodies > MAX_SEPARATE and options.colour is None:
        return MovingBodies(*track_together(video, view, options))
    return _each_or_together(video, view, options)


def _each_or_together(video: FrameSource, view: WorkingView, options: TrackOptions) -> MovingBodies:
    """Each body for itself, and if that misses some, all at once."""
    setup = detection_setup(video, view, coarse=True)
    if options.bodies == 1:
        setup = behind_resting_body(setup)
    try:
        all_detections, tracklets = _track_once(video, setup, options)
        again = refined_setup(setup, tracklets)
        if again is not None:
            setup = again
            del all_detections, tracklets, again  # a long clip's are held once only
            all_detections, tracklets = _track_once(video, setup, options)
    except TrackingError:
        if options.bodies == 1 or options.colour is not None:
            raise
        with suppress(TrackingError):
            return MovingBodies(*track_together(video, view, options))
        raise
    if options.bodies > 1 and options.colour is None and _seen(tracklets) < options.bodies * len(all_detections):
        with suppress(TrackingError):
            joint = track_together(video, view, options)
            if _seen(joint[1]) > _seen(tracklets):
                return MovingBodies(*joint)
    return MovingBodies(all_detections, _measured(video, setup, all_detections, tracklets), setup.view, setup)


def _measured(
    video: FrameSource, setup: DetectionSetup, all_detections: Sequence[FrameDetections], tracklets: list[Tracklet]
) -> list[Tracklet]:
    """The tracklets with all detections measured, and what the edge of the image leaves of the bodies."""
    measured = all_measured(video, setup, tracklets)
    view = setup.view
    return [with_frames_at_edge(tracklet, all_detections, view.box, view.step) for tracklet in measured]


def _seen(tracklets: Sequence[Tracklet]) -> int:
    """Number of detections of all bodies."""
    return sum(len(tracklet.detections) for tracklet in tracklets)


def _track_once(
    video: FrameSource, setup: DetectionSetup, options: TrackOptions
) -> tuple[list[FrameDetections], list[Tracklet]]:
    """Read the clip once: what each frame shows, and the tracklets of the bodies."""
    diagonal = float(np.hypot(video.width, video.height))
    all_detections = observe(video, setup, options, LikelyBodies(options.bodies, diagonal).among)
    return all_detections, link_bodies(all_detections, options.bodies, diagonal)
