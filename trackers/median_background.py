"""Moving bodies in front of a still background: median background, blobs, sub-pixel centroids, tracklets.

Frames sampled over the clip give the background and its noise. In each frame the foreground is cut into compact blobs
without cords and hands, the centroid of each is measured to a fraction of a pixel, and the detections are linked over
the frames. The clip is read once beside the sampling, twice where a body stays so near to one position that
samples show no hole there; frames are not kept. More than two bodies, and two that are not both seen throughout, are
tracked together, also where they touch: the clip is then read twice more.
"""

from __future__ import annotations

from iris_sysid.types import FrameSource, Track, Tracker, TrackOptions
from trackers._linking.moving_bodies import follow


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the bodies that move farthest before a still background, one Track each.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    options
        ``bodies`` is the number to follow, ``roi`` limits the image, ``colour`` limits the bodies to
        one colour, ``progress`` is called every ten frames; ``mask`` says which pixels are bodies.

    Returns
    -------
    list of Track
        Every frame has a row; a frame in which the body is not seen, or is cut by the edge of the
        image, is a gap. ``hand`` is true where something that reaches in from the edge touches it.

    Raises
    ------
    TrackingError
        When nothing moves, or when fewer bodies move than requested.
    VideoError
        When there are fewer than three frames.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    return follow(video, options).tracks(TRACKER.name, options)


TRACKER = Tracker(
    name="median-background",
    summary="bodies that move before a still background, by the temporal median",
    track=track,
)
