"""Bodies that move before a background that changes slowly: nearest samples [1]_, blobs, sub-pixel centres, linking.

The background is learned from the clip as it goes; a body that rests becomes background. The centres are measured,
and the bodies linked, as by ``median-background``.
A pixel is background when enough of the grey levels kept of it lie near the one that it shows: no
distribution is assumed, so that leaves or water that move to and fro can be background.

.. [1] Z. Zivkovic and F. van der Heijden, Efficient adaptive density estimation per image pixel for the task of
   background subtraction, Pattern Recognition Letters 27 (2006) 773-780, section 4.
"""

from __future__ import annotations

import cv2

from iris_sysid.types import FrameSource, Track, Tracker, TrackOptions
from trackers._linking.adaptive_background import Subtractor, track_with

THRESHOLD = 400.0  # squared distance in grey levels within which a kept sample is near, as OpenCV has it


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the bodies that differ from the samples kept of the background, one Track each.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    options
        ``bodies`` is the number to follow, ``roi`` limits the image, ``colour`` limits the bodies to
        one colour, ``progress`` is called every ten frames.

    Returns
    -------
    list of Track
        Every frame has a row; a frame in which the body is not seen, or is cut by the edge of the image, is a gap.

    Raises
    ------
    TrackingError
        When nothing moves, or when fewer bodies move than requested.
    VideoError
        When there are fewer than three frames.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    return track_with(_subtractor, TRACKER.name, video, options)


def _subtractor(history: int) -> Subtractor:
    return cv2.createBackgroundSubtractorKNN(history, THRESHOLD, detectShadows=False)


TRACKER = Tracker(
    name="knn",
    summary="bodies that move before a background that changes slowly, by the samples nearest in grey level",
    track=track,
)
