"""Bodies measured against the ring of pixels round them in the same frame: no background image is needed."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from iris_sysid.types import Frame
from trackers._background.median import Background, BackgroundEstimate
from trackers._detection.detection import BlobDetector
from trackers._detection.foreground import MIN_AREA, Blob, ConnectedComponent
from trackers._frames.arrays import MAD_TO_SD, QUANTISATION_SD, Bytes, Image
from trackers._frames.sampled_frames import SampledFrames
from trackers._frames.working_image import WorkingView

RING, GAP = 9, 3  # px of the search image: width of the ring round a body, and the gap between body and ring
MIN_RING = 12  # px that show the surroundings


def components_of(mask: Bytes) -> list[ConnectedComponent]:
    """The connected parts of a mask, all of one strength."""
    closed = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    components = []
    for label in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[label])
        if area >= MIN_AREA:
            body = (labels[top : top + height, left : left + width] == label).astype(np.uint8)
            components.append(ConnectedComponent(body, 255 * body, left, top))
    return components


def local_detector(view: WorkingView, frame: Frame, image: Bytes, covered: Bytes, blob: Blob) -> BlobDetector | None:
    """The measurement of one body against the colour just outside of it; None where nothing is visible outside.

    Parameters
    ----------
    view
        Region of interest and size of the search image.
    frame
        The frame.
    image
        Its search image (h, w, 3).
    covered
        Pixels (h, w) of that image that are not background.
    blob
        The body.
    """
    left, top, right, bottom = blob.box
    reach = GAP + RING
    window = (slice(max(0, top - reach), bottom + reach), slice(max(0, left - reach), right + reach))
    outside = image[window][covered[window] == 0].astype(np.float32)
    if len(outside) < MIN_RING:
        return None
    middle = np.median(outside, axis=0)
    noise = np.maximum(MAD_TO_SD * np.median(np.abs(outside - middle), axis=0), QUANTISATION_SD)
    samples = SampledFrames([frame], view)
    sizes = [size for size in range(1, view.step + 1) if view.step % size == 0]
    coarser = {
        size: Background(samples, None, _even(middle, noise, (view.height // size, view.width // size)))
        for size in sizes
    }
    return BlobDetector(replace(coarser[1], coarser=coarser), view, 1.0)


def _even(middle: Image, noise: Image, size: tuple[int, int]) -> BackgroundEstimate:
    """The same colour and noise everywhere in an image of that height and width."""
    return BackgroundEstimate(*(np.broadcast_to(level.astype(np.float32), (*size, 3)) for level in (middle, noise)))
