"""Given segmentation masks instead of the detector."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import FrameSource, TrackOptions
from trackers._detection.detect_frames import DetectionSetup, detection_setup
from trackers._detection.detection import FrameDetections
from trackers._detection.foreground import SQUARE
from trackers._frames.arrays import Bytes
from trackers._frames.working_image import WorkingView
from trackers._multi_body.appearance_classes import MIN_SAMPLES, AppearanceClass
from trackers._multi_body.pixel_assignment import CoveredPixels
from trackers._multi_body.predict_and_assign import FrameAssignment, follow_bodies
from trackers._multi_body.track_together import measure_bodies
from trackers._tracklets.frame_to_frame import Tracklet

MAX_LABELS = 64  # in one mask: more are the grey levels of a lossy video
MIN_AREA = 6  # px of a label in a frame, at the size of the search


def track_with_masks(
    video: FrameSource, view: WorkingView, options: TrackOptions, mask: FrameSource
) -> tuple[list[FrameDetections], list[Tracklet], WorkingView]:
    """What each frame shows and the tracklet of each body, where a mask says which pixels are bodies.

    Masks with several values name the bodies by their values; in masks with one value the bodies are distinguished as
    elsewhere, by assignment to where they are predicted. Centres come from the brightness about the masks.

    Parameters
    ----------
    video
        The clip.
    view
        Its region and size.
    options
        How many bodies; progress.
    mask
        One image for each frame of the clip, of its size; 0 is background.

    Raises
    ------
    DataError
        When the masks do not fit the clip in number or size, or hold another number of bodies than requested.
    TrackingError
        When the masks are empty, or bodies of one value are never seen apart.
    """
    if (mask.width, mask.height) != (video.width, video.height):
        raise DataError(
            f"the masks are {mask.width}x{mask.height} px, but the clip is {video.width}x{video.height} px; "
            f"they must be of one size"
        )
    view = view.with_chroma()
    times, images = _paired(video, view, mask)
    values = _values(images)
    if options.bodies > 1 and len(values) not in (1, options.bodies):
        raise DataError(f"{options.bodies} bodies were requested, but the masks hold {len(values)} different values")
    small = (view.search_size[0], view.search_size[1])
    frames = [_shown(mask, values, *when, small) for mask, when in zip(images, times, strict=True)]
    setup = _without_bodies(
        detection_setup(video, view), {number: mask for (number, _), mask in zip(times, images, strict=True)}
    )
    if options.bodies > 1 and len(values) == 1:
        area = float(np.median([len(pixels.xy) for pixels in frames if len(pixels.xy)])) / options.bodies
        placed = follow_bodies(frames, [AppearanceClass(np.zeros(3, dtype=np.float32), area, options.bodies)])
    else:
        placed = [_labelled(pixels, len(values)) for pixels in frames]
    return *measure_bodies(video, setup, frames, placed, options), view


def _paired(video: FrameSource, view: WorkingView, mask: FrameSource) -> tuple[list[tuple[int, float]], list[Bytes]]:
    """Number and time of each frame, and its mask at the size of the search; the numbers must agree."""
    times, images = [], []
    clip_times = {frame.index: frame.t_s for frame in video.frames()}
    count = 0
    for frame in mask.frames():
        count = frame.index + 1
        if frame.index in clip_times:
            times.append((frame.index, clip_times[frame.index]))
            images.append(_small(frame.luma, view))
    last = max(clip_times, default=-1)
    if len(images) != len(clip_times) or (count > last + 1 and min(clip_times) == 0):
        raise DataError(
            f"there are {count} masks, but the clip has {last + 1} frames; there must be one for each frame"
        )
    return times, images


def _small(luma: Bytes, view: WorkingView) -> Bytes:
    """The region of a mask at the size of the search, each value one that is there."""
    width, height = view.search_size
    region = luma[view.top : view.top + view.height, view.left : view.left + view.width]
    return region[view.step // 2 :: view.step, view.step // 2 :: view.step][:height, :width].copy()


def _values(images: Sequence[Bytes]) -> list[int]:
    """The values that stand for bodies, in order; images of many grey levels are made two-valued, in place."""
    levels = np.unique(np.concatenate([np.unique(mask) for mask in images]))
    values = [int(value) for value in levels if value]
    if not values:
        raise TrackingError("the masks are empty: every pixel of every mask is 0")
    if len(values) <= MAX_LABELS:
        return values
    for mask in images:
        mask[:] = np.where(mask > max(values) // 2, 255, 0)
    return [255]


def _shown(image: Bytes, values: Sequence[int], frame: int, t_s: float, size: tuple[int, int]) -> CoveredPixels:
    """Pixels that a mask covers, with the index of each pixel's value as its class."""
    rows, columns = np.nonzero(image)
    class_index: NDArray[np.int8] = np.searchsorted(values, image[rows, columns]).astype(np.int8)
    xy = np.stack([columns, rows], axis=-1).astype(np.int16)
    return CoveredPixels(frame, t_s, xy, np.ones(len(xy), dtype=np.float16), class_index, size)


def _labelled(pixels: CoveredPixels, count: int) -> FrameAssignment:
    """The bodies of a frame where the values of the mask name them."""
    filled = np.bincount(pixels.class_index, minlength=count)
    sums = [np.bincount(pixels.class_index, weights=pixels.xy[:, axis], minlength=count) for axis in range(2)]
    centres = np.stack(sums, axis=-1) / np.maximum(filled, 1)[:, np.newaxis]
    return FrameAssignment(pixels.class_index.astype(np.int64), centres, (filled >= MIN_AREA).astype(np.float64))


def _without_bodies(setup: DetectionSetup, images: dict[int, Bytes]) -> DetectionSetup:
    """The setup with the background seen where the masks say that no body is."""
    usable = np.stack(
        [
            cv2.dilate((images[number] > 0).astype(np.uint8), SQUARE, iterations=2) == 0
            if number in images
            else np.ones(setup.search_images.shape[1:3], dtype=np.bool_)
            for number in setup.numbers
        ]
    )
    return setup.with_background_from(usable | (usable.sum(axis=0) < MIN_SAMPLES))
