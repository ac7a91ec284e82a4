"""Coverage of the pixels of a window by the body in it, and the centroid that it gives.

Planes are (h, w, channels), grey levels; the windows are small.
"""

from __future__ import annotations

from functools import reduce

import cv2
import numpy as np

from trackers._detection.coverage_kernels import Planes, beyond_shade, own_brightness, shares
from trackers._detection.masks import depth_of, dilated, quantile
from trackers._detection.outline import outline
from trackers._detection.shading import shading
from trackers._frames.arrays import MAD_TO_SD, Bytes, Image

SHARP, REFINED = 1.5, 2  # px: half the width of an outline from which on it is found again, and how often
CLEAR = 1.5  # of half the width of a streak's outline: so far inside of it is the body alone
WHOLE = 0.85  # of the thickness: an outline that leaves less of it is not that of a streak
DEEPEST = 0.6  # of the depth: the body's brightness is taken from there at least
SHALLOW = 0.7  # of the depth of the mask: an outline that leaves less of it is not that of the whole body
OUTSKIRTS, FAINT, LEAST_FREE = 4.0, 0.45, 0.02  # px outside of the outline; coverage and share of pixels there
RIM_PX, RIM_SHARE = 1.4, 0.45  # px and share of the depth: pixels nearer to the outline are blurred
OUTLINE_DEPTH = 4.0  # px within which the body's brightness must fit that of its outline
FEWEST_OUTSIDE = 12  # px from which the noise outside of a body is judged
AXES = 4  # directions in which an outline may be wide
NEAR = 2  # px about a mask, right to two pixels, in which the body may be
COARSE = 3.0  # px of the reduced image: the standard deviation of a blur that is made at a reduced size


def coverage(planes: Planes, mask: Bytes, other: Bytes, inflation: float, refined: bool) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that a body covers, 1 or 0 off its outline, and its variance; see ``coverage_centre``.

    Parameters
    ----------
    planes
        Frame, background and noise (h, w, channels), grey levels.
    mask, other
        1 where the body is (h, w), right to about two pixels, and where something else is.
    inflation
        Variance of sums of noise over that of white noise.
    refined
        Whether outline and background are looked at again by the first result.
    """
    depth = depth_of(mask, outside=False, exact=True)
    deepest = float(depth.max())
    near, heart = (dilated(mask, NEAR) > other).view(np.uint8), depth > 0.5 * deepest
    persistence, rim = max(1.5, deepest / 2), min(RIM_PX, RIM_SHARE * deepest)
    share, variance, distance, half_width, axes = _first_look(planes, mask, near, depth, rim)
    is_blurred = half_width.max() > SHARP
    for _ in range((REFINED if is_blurred and axes == 1 else 1) if refined else 0):
        level = _with_level_outside(planes, share, distance + half_width, other)
        clear = distance - np.minimum(half_width * (1.0 if axes == 1 else CLEAR), DEEPEST * float(distance.max()))
        if distance.max() < SHALLOW * deepest:  # a notch, as in a small ball both darker and brighter
            clear = np.maximum(clear, depth - rim)
        share, variance = _share((planes[0], level, planes[2]), mask, near, clear, persistence)
        if is_blurred:
            distance, half_width = outline(share, heart, axes)
    variance *= _liveliness(share, variance, distance + half_width)
    texture = _texture_variance(share, variance, distance - half_width) * persistence
    band = np.abs(distance) <= half_width
    settled = np.where(band, share, (distance > 0).astype(np.float32))
    return settled, np.where(band, inflation * variance + texture * share**2, np.float32(0))


def blurred(image: Image, sigma: float) -> Image:
    """Image (h, w[, channels]) after a Gaussian blur of that standard deviation, px; a wide one at a reduced size."""
    factor = max(1, int(sigma / COARSE))
    if factor == 1:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma), dtype=np.float32)
    height, width = image.shape[:2]
    rows, columns = -(-height // factor), -(-width // factor)
    small = cv2.resize(image, (columns, rows), interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(small, (0, 0), sigma * columns / width, sigmaY=sigma * rows / height)
    return np.asarray(cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def largest(image: Image) -> Image:
    """The largest of the channels of an image (h, w, channels), pixel by pixel: faster than by np.max."""
    return reduce(np.maximum, cv2.split(image))


def _first_look(
    planes: Planes, mask: Bytes, near: Bytes, depth: Image, rim: float
) -> tuple[Image, Image, Image, Image, int]:
    """Coverage and its variance, distance to the outline, half its width, and in how many directions that is found.

    Where the outline is wide, the body's brightness is taken from deep inside instead of from the rim inwards. A
    streak is as thick then; a body whose rim is of another brightness is not, and stays as it is by its rim.
    """
    deepest = float(depth.max())
    heart, persistence = depth > 0.5 * deepest, max(1.5, deepest / 2)
    share, variance = _share(planes, mask, near, depth - np.float32(rim), persistence)
    distance, half_width = outline(share, heart, 1)
    if half_width.max() >= SHARP:
        by_depth, its_variance = _share(planes, mask, near, depth - np.float32(DEEPEST * deepest), persistence)
        inner, reach = outline(by_depth, heart, AXES)
        if inner.max() > WHOLE * distance.max():
            return by_depth, its_variance, inner, reach, AXES
    return share, variance, distance, half_width, 1


def _share(planes: Planes, mask: Bytes, near: Bytes, depth: Image, blur: float) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that the body covers, and its variance; by the mask where brightness does not tell.

    The body's own brightness, and the strength of its difference in units of noise, are continued outwards from where
    ``depth`` (h, w), px, is above 0: a pixel is of the body alone. Its shading is followed by a polynomial, what is
    left is replaced by the mean of the near pixels.
    """
    shade = shading(planes[0], depth, near)
    soft = blurred(beyond_shade(planes[0], shade, depth), blur)
    own, strength, missed = own_brightness(planes, shade, soft, depth, near)
    strength += blurred(missed, blur) / np.maximum(soft[..., -1], np.float32(1e-6))
    share, variance = shares(planes, own, strength, mask, near)
    return share, variance


def _with_level_outside(planes: Planes, share: Image, beyond: Image, other: Bytes) -> Image:
    """The background as it is about the body now, e.g. in a soft shadow, continued inwards.

    ``beyond`` is negative outside of the outline; a cord that covers much of a pixel there does not count.
    """
    image, background, _ = planes
    free = ((beyond < 0) & (beyond > -OUTSKIRTS) & (np.abs(share) < FAINT) & (other == 0)).astype(np.float32)
    off = (image - background) * free[..., np.newaxis]
    soft = blurred(np.dstack((off, free)), OUTSKIRTS)
    return np.asarray(
        background + soft[..., :-1] / np.maximum(soft[..., -1:], np.float32(LEAST_FREE)), dtype=np.float32
    )


def _liveliness(share: Image, variance: Image, beyond: Image) -> np.float32:
    """Variance of the coverage just outside of the band, where it should be 0, over that expected; at least 1.

    The median keeps out the cord or whatever else is there. ``beyond`` (h, w), px, is negative outside of the band.
    """
    outside = (beyond < 0) & (variance > 0)
    ratio = np.abs(share[outside]) / np.sqrt(variance[outside])
    if ratio.size < FEWEST_OUTSIDE:
        return np.float32(1)
    return np.float32(max(1.0, (MAD_TO_SD * quantile(ratio, 0.5)) ** 2))


def _texture_variance(share: Image, variance: Image, within: Image) -> float:
    """Variance of the coverage just inside of the band, where it should be 1, beyond its noise.

    ``within`` (h, w), px, is above 0 inside of the band.
    """
    inside = (within > 0) & (within < OUTLINE_DEPTH)
    excess = (share[inside] - 1) ** 2 - variance[inside]
    return max(0.0, float(excess.mean(dtype=np.float64))) if excess.size else 0.0
