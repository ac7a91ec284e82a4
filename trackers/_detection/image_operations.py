"""Operations on small images by OpenCV."""

from __future__ import annotations

import cv2
import numpy as np

from iris_sysid.types import Array
from trackers._frames.arrays import Bytes, Flags, Image

COARSE = 3.0  # px of the reduced image: the standard deviation of a blur that is made at a reduced size


def as_bytes(flags: Bytes | Flags) -> Bytes:
    """Flags as OpenCV takes them: the same memory, 1 for True."""
    return np.ascontiguousarray(flags).view(np.uint8)


def dilated(mask: Bytes | Flags, by: int) -> Bytes:
    """Dilation of a mask (h, w) by a square that reaches ``by`` px on every side; outside the mask is 0."""
    return np.asarray(cv2.dilate(as_bytes(mask), np.ones((2 * by + 1, 2 * by + 1), np.uint8)), dtype=np.uint8)


def rough_depth(mask: Bytes | Flags, *, outside: bool = True) -> Image:
    """Distance (h, w), px, of each pixel of a mask to the nearest that is 0, within 2 %; 0 there.

    By steps to the next pixels (G. Borgefors 1986, Comput. Vis. Graph. Image Process. 34, 344). ``outside`` says that
    pixels outside of the mask are 0; if not, they do not count.
    """
    free = as_bytes(mask)
    if not outside:
        return np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5), dtype=np.float32)
    free = cv2.copyMakeBorder(free, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0)
    return np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1], dtype=np.float32)


def blurred(image: Image, sigma: float) -> Image:
    """Image (h, w[, channels]) after a Gaussian blur of that standard deviation, px; a wide one at a reduced size."""
    height, width = image.shape[:2]
    factor = max(1, int(sigma / COARSE))
    if factor == 1:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma))
    columns, rows = -(-width // factor), -(-height // factor)
    small = cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(small, (0, 0), sigma * columns / width, sigmaY=sigma * rows / height)
    return np.asarray(cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR))


def quantile(values: Array | Image, share: float) -> float:
    """The value (of n) that such a share of them is below, linear between two; 0 of none. np.quantile is slower."""
    if values.size < 2:
        return float(values.sum())
    place = share * (values.size - 1)
    below = min(int(place), values.size - 2)
    ordered = np.partition(values, (below, below + 1))
    return float(ordered[below] + (place - below) * (ordered[below + 1] - ordered[below]))
