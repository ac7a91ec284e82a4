"""A few frames of a clip laid over each other: a body shows at several times."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import FrameSource, Track
from iris_sysid.video.camera_motion.reference import seen_from_first

FRAMES, PHASES = 60, 9  # sampled for a page; of them in a multiple exposure
CHANGED = 24  # grey levels, well above the noise of a sensor: only moving parts are superposed


def sampled_views(
    video: FrameSource, body: Track | None, largest_px: float, count: int = FRAMES
) -> list[tuple[float, NDArray[np.uint8]]]:
    """Time, s, and image (h, w, 3) uint8 BGR of sampled frames.

    Parameters
    ----------
    video
        The clip.
    body
        A track that follows the motion of the camera: each image is laid where the first frame shows the scene. None
        for a camera at rest.
    largest_px
        Longest side of an image, px.
    count
        Most frames.
    """
    scale = min(1.0, largest_px / max(video.width, video.height))
    size = round(scale * video.width), round(scale * video.height)
    frames = video.sample(FRAMES)  # the same number for all pictures: they are decoded once
    views = []
    for k in np.unique(np.linspace(0, len(frames) - 1, count).round().astype(int)):
        image = frames[k].bgr() if body is None else seen_from_first(frames[k], body)
        views.append((frames[k].t_s, np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)))
    return views


def multiple_exposure(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Lay images (h, w, 3) uint8 over their median so that a body shows at several times; (h, w, 3) uint8."""
    background = _median(images)
    picture, strongest = background.copy(), np.full(background.shape[:2], CHANGED, dtype=np.uint8)
    for image in images:
        blue, green, red = cv2.split(cv2.absdiff(image, background))
        change = cv2.max(cv2.max(blue, green), red)
        cv2.copyTo(image, (change > strongest).view(np.uint8), picture)
        strongest = cv2.max(strongest, change)
    return picture


def _median(images: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """The upper median of images at each pixel, by odd-even transposition.

    Whole images are exchanged: a tenth of the time of sorting pixel by pixel.
    """
    ordered = list(images)
    for k in range(len(ordered)):
        for i in range(k % 2, len(ordered) - 1, 2):
            low, high = (exchanged(ordered[i], ordered[i + 1]) for exchanged in (cv2.min, cv2.max))
            ordered[i], ordered[i + 1] = low, high
    return ordered[len(ordered) // 2]
