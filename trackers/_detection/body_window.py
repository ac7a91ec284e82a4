"""The window of one body made ready for measuring: the background's level about it, its mask to the pixel, no shadow.

Planes are (h, w, channels), grey levels.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.types import Array
from trackers._detection.coverage import largest
from trackers._detection.coverage_kernels import Planes
from trackers._detection.foreground import CONTRAST_SHARES, WEAK_SIGMAS
from trackers._detection.masks import SQUARE, as_bytes, depth_of, dilated, filled, quantile
from trackers._frames.arrays import Bytes, Flags, Image

RING = 4  # px from the body to the ring in which the background's level is compared
DARKEST_SHADE = 0.6  # of the light remains in a shadow
GREY = 128.0  # grey level of a colour plane where there is no colour
COLOUR_SIGMAS, COLOUR_FLOOR = 3.0, 3.0  # floor in grey levels: largest error of a shadow's colour
MOSTLY_BODY = 0.5  # of the inscribed radius: deeper than that lies the body
ROUNDER = 1.15  # times: least gain in roundness when a possible shadow is removed
STEEP = 0.9  # of the pixels of an outline are less steep


@dataclass(frozen=True, eq=False, slots=True)
class Window:
    """Pixels round a body: grey levels (h, w, channels) of frame, background and noise.

    ``mask`` (h, w) is 1 where the body is, right to about two pixels; ``other`` (h, w) is 1 where
    something else is. ``inflation`` is the variance of sums of noise over that of white noise.
    """

    image: Image
    background: Image
    noise: Image
    mask: Bytes
    other: Bytes
    inflation: float = 1.0

    @property
    def planes(self) -> Planes:
        """Frame, background and noise (h, w, channels)."""
        return self.image, self.background, self.noise


def ready_window(planes: Planes, mask: Bytes, other: Bytes, finer: int, inflation: float) -> Window:
    """The window with the background at its level about a body, the body's mask, and that of other things.

    Parameters
    ----------
    planes
        Frame, background and noise (h, w, channels), grey levels.
    mask, other
        1 where the body was found (h, w), and where other things are.
    finer
        How much larger the pixels were in which they were found.
    inflation
        Variance of sums of noise over that of white noise.
    """
    image, background, noise = planes
    ring = dilated(mask | other, RING) == 0
    level = background + np.array([quantile(plane[ring], 0.5) for plane in cv2.split(image - background)], np.float32)
    if finer > 1:
        mask = _sharpened(mask, largest(np.abs(image - level)), largest(noise), finer)
    shaded = _shaded(image, level, noise)
    mask = _without(mask, shaded)
    left_over = as_bytes((other > mask) & ~shaded)
    return Window(image, level, noise, mask, left_over, inflation)


def _sharpened(mask: Bytes, level: Image, noise: Image, step: int) -> Bytes:
    """A mask found at reduced size, made right to the pixel by the difference (h, w) from the background."""
    faint = CONTRAST_SHARES[0] * quantile(level[mask > 0], 0.9)
    near = (dilated(mask, step) > 0) & (level > np.maximum(np.float32(faint), WEAK_SIGMAS * noise))
    return filled(near, mask)


def _shaded(image: Image, background: Image, noise: Image) -> Flags:
    """Where an image (h, w, channels) shows the background with less light: all its colours scaled by one factor.

    Without colour a shadow cannot be distinguished from a dark body: nowhere.
    """
    if image.shape[2] < 3:
        return np.zeros(image.shape[:2], dtype=np.bool_)
    (luma, *colours), (bright, *still), (_, *noisy) = (cv2.split(one) for one in (image, background, noise))
    light = cv2.blur(luma, (3, 3)) / np.maximum(bright, np.float32(1))
    dark = (light > DARKEST_SHADE) & (light < 1)
    for plane, its, sigma in zip(colours, still, noisy, strict=True):
        off = np.abs(cv2.blur(plane, (3, 3)) - (GREY + (its - GREY) * light))
        dark &= off <= np.maximum(COLOUR_SIGMAS * sigma, COLOUR_FLOOR)
    return np.asarray(dark)


def _without(mask: Bytes, shaded: Flags) -> Bytes:
    """A mask without the shadow that hangs on the body; as it is where that makes it no rounder: a grey body."""
    body = np.asarray(cv2.morphologyEx(as_bytes(mask > shaded), cv2.MORPH_OPEN, SQUARE), dtype=np.uint8)
    depth = depth_of(body)
    body = filled(body, depth > MOSTLY_BODY * float(depth.max()))
    return body if _roundness(body) > ROUNDER * _roundness(mask) else mask


def _roundness(mask: Bytes) -> float:
    """Share of a mask that its largest inscribed disc covers; 0 when it is empty."""
    return float(np.pi * depth_of(mask).max() ** 2 / max(1, cv2.countNonZero(mask)))


def looks_of(window: Window) -> tuple[float, float]:
    """Mean difference in luma within the mask, grey levels, and steepness of its outline, grey levels a px.

    That is the 90th percentile of the gradient (Sobel) of the difference.
    """
    inside, near = window.mask > 0, dilated(window.mask, 1) > 0
    level = largest(np.abs(window.image - window.background))
    across, down = (cv2.Sobel(level, cv2.CV_32F, *along, scale=1 / 8)[near] for along in ((1, 0), (0, 1)))
    brightening = (window.image[..., 0] - window.background[..., 0])[inside]
    return float(brightening.mean()) if brightening.size else 0.0, quantile(np.hypot(across, down), STEEP)


def moments_of_difference(window: Window, reach: int) -> Array:
    """Mean column and row of a body, px, their variances and covariance, px^2: (5,).

    Pixels within ``reach`` px of the mask, where nothing other is, weigh as their largest difference from the
    background in units of the noise, at most the median of it within the mask.
    """
    level = largest(np.abs(window.image - window.background) / window.noise)
    usual = max(quantile(level[window.mask > 0], 0.5), 1e-6)
    near = (dilated(window.mask, reach) > 0) & (window.other == 0)
    weights = np.where(near, np.minimum(level / usual, 1.0), 0.0)
    total = weights.sum()
    columns, rows = (np.arange(size) - (size - 1) / 2 for size in weights.shape[::-1])
    by_column, by_row = weights.sum(axis=0), weights.sum(axis=1)
    x, y = by_column @ columns / total, by_row @ rows / total
    free = total - (weights**2).sum() / total  # weighted, unbiased
    across, down = by_column @ (columns - x) ** 2, by_row @ (rows - y) ** 2
    shared = (rows - y) @ weights @ (columns - x)
    middle = (np.array(weights.shape[::-1]) - 1) / 2
    return np.array([x + middle[0], y + middle[1], across / free, down / free, shared / free])
