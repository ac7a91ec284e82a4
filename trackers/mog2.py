"""Moving bodies in front of a slowly changing background: mixture of Gaussians [1]_, blobs, sub-pixel centroids.

The background is learned from the clip as it goes, so that light which drifts does not matter; a body that rests
becomes background. The centres are measured, and the bodies linked, as by ``median-background``.

.. [1] Z. Zivkovic and F. van der Heijden, Efficient adaptive density estimation per image pixel for the task of
   background subtraction, Pattern Recognition Letters 27 (2006) 773-780.
"""

from __future__ import annotations

import cv2

from iris_sysid.types import FrameSource, Track, Tracker, TrackOptions
from trackers._linking.adaptive_background import Subtractor, track_with

THRESHOLD = 16.0  # squared distance in standard deviations: 4 sigma, as OpenCV has it


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Follow the bodies that a mixture of Gaussians tells from the background, one Track each.

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
    return cv2.createBackgroundSubtractorMOG2(history, THRESHOLD, detectShadows=False)


TRACKER = Tracker(
    name="mog2",
    summary="bodies that move before a background that changes slowly, by a mixture of Gaussians",
    track=track,
)
