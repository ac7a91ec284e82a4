"""The window of one body made ready: the background's level about it, its mask to the pixel, its shadow off."""

from __future__ import annotations

import cv2
import numpy as np

from iris_sysid.types import Array
from trackers._detection.connected import filled_round
from trackers._detection.coverage_kernels import Planes
from trackers._detection.foreground import CONTRAST_SHARES, SQUARE, WEAK_SIGMAS
from trackers._detection.image_operations import dilated, quantile, rough_depth
from trackers._frames.arrays import Bytes, Flags, Image

RING = 4  # px from the body to the ring in which the background's level is compared
MIN_SHADE = 0.6  # of the light remains in a shadow
GREY = 128.0  # level of a colour plane where the image is grey
COLOUR_SIGMAS, COLOUR_FLOOR = 3.0, 3.0  # floor in grey levels: largest change of colour in a shadow
CORE_DEPTH = 0.5  # of the inscribed radius: deeper pixels are of the body
ROUNDER = 1.15  # times: least gain in roundness when a possible shadow is removed
STEEP = 0.9  # of the pixels of an outline are less steep


def made_ready(planes: Planes, mask: Bytes, other: Bytes, finer: int) -> tuple[Image, Bytes, Bytes]:
    """The background (channels, h, w) at its level about a body, the body's mask, and that of other objects (h, w).

    Parameters
    ----------
    planes
        Frame, background and noise (channels, h, w), grey levels.
    mask, other
        1 where the body was found (h, w), and where other objects are.
    finer
        How much larger the pixels were in which they were found.
    """
    image, background, noise = planes
    level = _at_level(image, background, mask | other)
    if finer > 1:
        mask = _sharpened(mask, np.abs(image - level).max(axis=0), noise, finer)
    shaded = _shaded(image, level, noise) & ((mask | other) > 0)
    mask = _without(mask, shaded)
    return level, mask, np.asarray((other > mask) & ~shaded, dtype=np.uint8)


def _at_level(image: Image, background: Image, covered: Bytes) -> Image:
    """The background as bright as it is now round what is covered: flicker, soft shade."""
    free = dilated(covered, RING) == 0
    off = np.array([plane[free] for plane in image - background])
    return background + np.median(off, axis=1)[:, np.newaxis, np.newaxis] if off.size else background


def _sharpened(mask: Bytes, level: Image, noise: Image, step: int) -> Bytes:
    """A mask found at reduced size, made right to the pixel by the difference (h, w) from the background."""
    faint = CONTRAST_SHARES[0] * quantile(level[mask > 0], 0.9)
    differs = level > np.maximum(faint, WEAK_SIGMAS * noise.max(axis=0))
    return filled_round(differs & (dilated(mask, step) > 0), mask)


def _shaded(image: Image, background: Image, noise: Image) -> Flags:
    """Where an image (channels, h, w) shows the background with less light: all its colours scaled by one factor.

    Without colour a shadow cannot be distinguished from a dark body.
    """
    if len(image) < 3:
        return np.zeros(image.shape[1:], dtype=bool)
    luma, *colours = (cv2.blur(channel, (3, 3)) for channel in image)
    light = luma / np.maximum(background[0], 1)
    shaded = (light > MIN_SHADE) & (light < 1)
    for colour, behind, noisy in zip(colours, background[1:], noise[1:], strict=True):
        off = np.abs(colour - (GREY + (behind - GREY) * light))
        shaded &= off <= np.maximum(COLOUR_SIGMAS * noisy, COLOUR_FLOOR)
    return shaded


def _without(mask: Bytes, shaded: Flags) -> Bytes:
    """A mask without shadow and thin parts on the body; as it is where that makes it no rounder: a grey body."""
    body = cv2.morphologyEx(mask * ~shaded, cv2.MORPH_OPEN, SQUARE)
    depth = rough_depth(body)
    body = filled_round(body, depth > CORE_DEPTH * depth.max())
    return body if _roundness(body) > ROUNDER * _roundness(mask) else mask


def _roundness(mask: Bytes) -> float:
    """Share of a mask that its largest inscribed disc covers; 0 when it is empty."""
    return float(np.pi * rough_depth(mask).max() ** 2 / max(1, np.count_nonzero(mask)))


def looks_of(planes: Planes, mask: Bytes) -> tuple[float, float]:
    """Mean difference in luma within a mask (h, w), grey levels, and steepness of its outline, grey levels a px.

    That is the 90th percentile of the gradient (Sobel) of the difference.
    """
    image, background, _ = planes
    level = np.abs(image - background).max(axis=0)
    slopes = cv2.magnitude(cv2.Sobel(level, cv2.CV_32F, 1, 0), cv2.Sobel(level, cv2.CV_32F, 0, 1)) / 8
    brightening = (image[0] - background[0])[mask > 0]
    return float(brightening.sum()) / max(1, brightening.size), quantile(slopes[dilated(mask, 1) > 0], STEEP)


def seen_roughly(image: Image, background: Image, mask: Bytes) -> tuple[float, ...]:
    """Area, column and row of the middle of a mask (h, w), px, and what its pixels show.

    That are means of the largest difference of the channels, of the difference and the level of the first, grey
    levels, and the steepness of that difference which a tenth of the pixels have or exceed, grey levels a px.
    """
    rows, columns = np.nonzero(mask)
    level = np.abs(image - background).max(axis=0)
    about = cv2.copyMakeBorder(level, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    slopes = np.hypot(about[1:-1, 2:] - about[1:-1, :-2], about[2:, 1:-1] - about[:-2, 1:-1])[rows, columns] / 2
    steepest = int(0.9 * rows.size)
    steep = np.partition(slopes, steepest)[steepest]
    luma = image[0, rows, columns]
    brightening = luma - background[0, rows, columns]
    means = (columns, rows, level[rows, columns], brightening, luma)
    return float(rows.size), *(float(each.mean(dtype=np.float64)) for each in means), float(steep)


def moments_of_difference(planes: Planes, mask: Bytes, other: Bytes, reach: int) -> Array:
    """Mean column and row of a body, px, their variances and covariance, px^2: (5,).

    Pixels within ``reach`` px of the mask (h, w), where nothing ``other`` is, weigh as their largest difference from
    the background in units of the noise, at most the median of it within the mask.
    """
    image, background, noise = planes
    level = np.abs(image / noise - background / noise).max(axis=0)
    rows, columns = np.nonzero(dilated(mask, reach) > other)
    weights = np.minimum(level[rows, columns].astype(np.float64) / max(quantile(level[mask > 0], 0.5), 1e-6), 1.0)
    covariance = np.cov(columns, rows, aweights=weights)
    middle = np.average([columns, rows], axis=1, weights=weights)
    return np.array([*middle, covariance[0, 0], covariance[1, 1], covariance[0, 1]])
