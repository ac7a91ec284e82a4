"""A body by its colour alone: no background is needed, so that the camera may move and the body may rest.

Pixels of the given colour (``--colour``) are joined into compact bodies. Each is measured to a fraction of a
pixel by how far the pixels at its outline lie between its own colour and that just outside of it.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Frame, FrameSource, Track, Tracker, TrackerExample, TrackOptions, with_progress
from trackers._detection.detect_frames import REPORT_EVERY
from trackers._detection.detection import FrameDetections
from trackers._detection.foreground import blobs_of
from trackers._detection.local_background import GAP, components_of, local_detector
from trackers._frames.working_image import WorkingView, view_of
from trackers._linking.select_bodies import with_fragments
from trackers._linking.to_track import track_of
from trackers._tracklets.frame_to_frame import Tracklet, link

FIRST_REACH, MIN_REACH = 0.25, 0.1  # of the image's diagonal: distance of a body from its prediction
MIN_DETECTIONS = 3
MIN_OVERLAP = 0.3  # of the shorter tracklet: two tracklets seen together as long are two bodies


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the largest bodies of one colour, one Track each.

    Parameters
    ----------
    video
        The clip; its camera may move.
    options
        ``colour`` is the colour of the bodies, ``bodies`` the number to follow, ``roi`` limits the image,
        ``progress`` is called every ten frames.

    Returns
    -------
    list of Track
        Every frame has a row; a frame in which the body is not seen, or is cut by the edge of the image, is a gap.
        The standard error allows for how uneven the surroundings are.

    Raises
    ------
    TrackingError
        When no colour is given, or fewer bodies than requested have it.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    view = view_of(video, options)
    if view.colour is None:
        raise TrackingError("this tracker follows a colour: name it with --colour, e.g. --colour red or '#c8e61e'")
    all_detections = []
    for frame in with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY):
        all_detections.append(_detections_of(view, frame))
    diagonal = float(np.hypot(video.width, video.height))
    tracklets = _largest(link(all_detections, FIRST_REACH * diagonal, MIN_REACH * diagonal), options)
    origin = {"tracker": TRACKER.name, "bodies": options.bodies, "roi": options.roi, "colour": options.colour}
    return [
        track_of(tracklet, all_detections, str(number), origin) for number, tracklet in enumerate(tracklets, start=1)
    ]


def _detections_of(view: WorkingView, frame: Frame) -> FrameDetections:
    """The candidates of one frame, each measured against its surroundings."""
    image, colour_mask = view.search_image(frame), np.asarray(view.colour_mask(frame))
    bodies = blobs_of(components_of(colour_mask.astype(np.uint8)), colour_mask.shape)
    covered = cv2.dilate(colour_mask.astype(np.uint8), np.ones((GAP, GAP), np.uint8))
    detected = FrameDetections(frame.index, frame.t_s, (), ())
    for blob in bodies:
        detector = local_detector(view, frame, image, covered, blob)
        if detector is not None:
            seen = detector.detect(frame, [blob], [blob])
            detected = replace(detected, detections=detected.detections + seen.detections)
    return detected


def _largest(tracklets: list[Tracklet], options: TrackOptions) -> list[Tracklet]:
    """The bodies that are largest and seen longest, seen together, each with the pieces that can only be more of it."""
    seen = [tracklet for tracklet in tracklets if len(tracklet.detections) >= MIN_DETECTIONS]
    chosen: list[Tracklet] = []
    for tracklet in sorted(seen, key=lambda tracklet: -sum(detection.area for detection in tracklet.detections)):
        with_all = all(
            len(tracklet.frames & other.frames) >= MIN_OVERLAP * min(len(tracklet.frames), len(other.frames))
            for other in chosen
        )
        if len(chosen) < options.bodies and with_all:
            chosen.append(tracklet)
    if len(chosen) < options.bodies:
        raise TrackingError(
            f"{options.bodies} bodies of the colour {options.colour} were requested, but {len(chosen)} can be seen at "
            "the same time; give the colour as it is in the image, e.g. '#c8e61e', or restrict the region with --roi"
        )
    return with_fragments(chosen, [tracklet for tracklet in tracklets if not any(tracklet is body for body in chosen)])


def _suits(video: FrameSource, options: TrackOptions, moving: bool) -> bool:
    """Whether a colour is given."""
    return options.colour is not None


TRACKER = Tracker(
    name="colour",
    summary="bodies of one colour, also before a camera that moves, or at rest",
    track=track,
    example=TrackerExample(options=TrackOptions(colour="#b4b4b4")),
    suits=_suits,
)
