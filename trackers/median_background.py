"""Moving bodies in front of a still background: median background, blobs, sub-pixel centroids, tracklets.

Frames sampled over the clip give the background and its noise. In each frame the foreground is cut into compact blobs
without cords and hands, the centroid of each is measured to a fraction of a pixel, and the detections are linked over
the frames. The clip is read once beside the sampling, twice where a body stayed so long in one position that it became
background; frames are not kept. More than two bodies, and two that are not both seen throughout, are tracked together,
also where they touch: the clip is then read twice more.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import FrameSource, Track, Tracker, TrackOptions
from trackers._detection.detect_frames import DetectionSetup, detection_setup, observe
from trackers._detection.detection import FrameDetections
from trackers._frames.working_image import View, view_of
from trackers._linking.frame_to_frame import Tracklet
from trackers._linking.refined_background import refined_setup
from trackers._linking.select_bodies import link_bodies
from trackers._linking.to_track import track_of
from trackers._multi_body.given_masks import track_with_masks
from trackers._multi_body.track_together import track_together

FEW = 2  # bodies: more than these are followed all at once


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the bodies that move farthest before a still background, one Track each.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    options
        ``bodies`` is the number to follow, ``roi`` limits the image, ``colour`` limits the bodies to
        one colour, ``progress`` is called now and then; ``mask`` says which pixels are bodies.

    Returns
    -------
    list of Track
        Every frame has a row; a frame in which the body is not seen, or is cut by the edge of the
        image, is a gap. ``hand`` is true where something that reaches in from the edge touches it.

    Raises
    ------
    TrackingError
        When nothing moves, when fewer bodies move than asked for, or when there are fewer than three frames.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    if options.mask is not None:
        all_detections, tracklets, view = track_with_masks(video, view_of(video, options), options, options.mask)
    else:
        all_detections, tracklets, view = _bodies(video, view_of(video, options), options)
    origin = {
        "tracker": TRACKER.name,
        "bodies": options.bodies,
        "roi": options.roi,
        "colour": options.colour,
        "colour_used": view.chroma,
        "mask": options.mask is not None,
    }
    return [
        track_of(tracklet, all_detections, str(number), origin) for number, tracklet in enumerate(tracklets, start=1)
    ]


def _bodies(
    video: FrameSource, view: View, options: TrackOptions
) -> tuple[list[FrameDetections], list[Tracklet], View]:
    """What each frame shows and the tracklets of the bodies: each for itself, and if that misses some, all at once."""
    if options.bodies > FEW and options.colour is None:
        return track_together(video, view, options)
    setup = detection_setup(video, view, coarse=True)
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
            return track_together(video, view, options)
        raise
    if options.bodies > 1 and options.colour is None and _seen(tracklets) < options.bodies * len(all_detections):
        with suppress(TrackingError):
            joint = track_together(video, view, options)
            if _seen(joint[1]) > _seen(tracklets):
                return joint
    return all_detections, tracklets, setup.view


def _seen(tracklets: Sequence[Tracklet]) -> int:
    """Number of detections of all bodies."""
    return sum(len(tracklet.detections) for tracklet in tracklets)


def _track_once(
    video: FrameSource, setup: DetectionSetup, options: TrackOptions
) -> tuple[list[FrameDetections], list[Tracklet]]:
    """Read the clip once: what each frame shows, and the tracklets of the bodies."""
    all_detections = observe(video, setup, options)
    if not all_detections:
        raise TrackingError("the clip gave no frames; is the part between --start and --stop empty?")
    return all_detections, link_bodies(all_detections, options.bodies, float(np.hypot(video.width, video.height)))


TRACKER = Tracker(
    name="median-background",
    summary="bodies that move before a still background, by the temporal median",
    track=track,
)
