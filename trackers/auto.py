"""The tracker that suits a clip, chosen by itself: the background tracker where no evidence is against its tracks.

The tracks are judged by evidence that needs no truth: the same colours throughout, a body and no shadow, no leaps, a
steady size, nothing else that looks more like a body, and the body nowhere else in view. Where the evidence is bad,
the objects that move in sampled frames are sorted by colour and size, followed by appearance, and judged likewise.
``quality`` states how far the track can be trusted.
"""

from __future__ import annotations

from dataclasses import replace

from iris_sysid.types import FrameSource, Track, Tracker, TrackOptions
from trackers._auto.choose import choose


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the bodies that are meant, one Track each, in the way that suits the clip.

    Parameters
    ----------
    video
        The clip.
    options
        ``bodies`` is the number to follow, ``roi`` limits the image, ``colour`` limits the bodies to one colour,
        ``marks`` say where a body is in some frames, ``mask`` says which pixels are bodies, ``progress`` is called
        every ten frames, ``explain`` with every way that was tried.

    Returns
    -------
    list of Track
        Every frame has a row; a frame in which the body is not seen is a gap. ``quality`` says how far the track can
        be trusted; ``origin`` which way was taken.

    Raises
    ------
    TrackingError
        When no tracker follows the bodies.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    best, tried = choose(video, options)
    names = [candidate.name for candidate in tried]
    return [
        replace(body, origin={**body.origin, "tracker": TRACKER.name, "chosen": best.name, "tried": names})
        for body in best.tracks
    ]


TRACKER = Tracker(
    name="auto",
    summary="chooses the tracker that suits the clip, and says how far the track can be trusted",
    track=track,
)
