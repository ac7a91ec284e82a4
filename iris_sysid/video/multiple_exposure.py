"""A few frames of a clip laid over each other: a body shows at several times."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Frame, FrameSource, Track
from iris_sysid.video.camera_motion.reference import seen_from_first

FRAMES, PHASES = 60, 9  # sampled for a page; of them in a multiple exposure
CHANGED = 24  # grey levels, well above the noise of a sensor: only moving parts are superposed


def sampled_views(
    video: FrameSource, body: Track | None, largest_px: float, count: int = FRAMES
) -> list[tuple[float, NDArray[np.uint8]]]:
    """Time, s, and image (h, w, 3) uint8 BGR of sampled frames.

    Where the camera moves, as the track of a body states, each is laid where the first frame shows the scene.

    Parameters
    ----------
    video
        The clip.
    body
        Fewer frames than are sampled are those in which it is farthest apart; None: they are even in time.
    largest_px
        Longest side of the images, px.
    count
        Largest number of them.
    """
    scale = min(1.0, largest_px / max(video.width, video.height))
    size = round(scale * video.width), round(scale * video.height)
    frames = video.sample(FRAMES)  # the same number for all pictures: they are decoded once
    views = []
    for k in phases_of(_places(frames, body), count):
        image = frames[k].bgr() if body is None else seen_from_first(frames[k], body)
        views.append((frames[k].t_s, np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)))
    return views


def _places(frames: Sequence[Frame], body: Track | None) -> Array:
    """Where a body is in some frames (n, 2), px; NaN where that is not known."""
    if body is None:
        return np.full((len(frames), 2), np.nan)
    row_of = {int(number): row for row, number in enumerate(body.frame)}
    unknown = np.full(2, np.nan)
    return np.array([body.xy_px[row_of[frame.index]] if frame.index in row_of else unknown for frame in frames])


def phases_of(xy_px: Array, count: int = PHASES) -> list[int]:
    """Numbers of the places (n, 2) px that are farthest from each other, at most ``count``, in order.

    Of a body that swings frames even in time may all show it at one place. Where too few are known (NaN), they are even
    in time.
    """
    known = np.flatnonzero(np.isfinite(xy_px).all(axis=1))
    if len(xy_px) <= count or known.size < count:
        return np.unique(np.linspace(0, len(xy_px) - 1, count).round().astype(int)).tolist()
    chosen, away = [int(known[0])], np.full(known.size, np.inf)
    while len(chosen) < count:
        away = np.minimum(away, np.hypot(*(xy_px[known] - xy_px[chosen[-1]]).T))
        chosen.append(int(known[away.argmax()]))
    return sorted(chosen)


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
