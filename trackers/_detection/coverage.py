"""Coverage of the pixels of a window by the body in it, and what its outline shows."""

from __future__ import annotations

import cv2
import numpy as np

from trackers._detection.coverage_kernels import Planes, own_brightness, shares, unexplained
from trackers._detection.depth import depth_of
from trackers._detection.image_operations import blurred, dilated
from trackers._detection.outline import outline
from trackers._detection.shading import shading
from trackers._frames.arrays import MAD_TO_SD, Bytes, Flags, Image

SHARP, REFINED = 1.5, 2  # px: an outline whose half width exceeds this is found again; number of repetitions
CLEAR = 1.5  # half widths of a streak's outline: pixels deeper than this show the body alone
MIN_THICKNESS = 0.85  # of the thickness: an outline that leaves less is not that of a streak
OWN_DEPTH = 0.6  # of the depth: pixels deeper than this give the body's brightness in any case
MIN_DEPTH = 0.7  # of the depth of the mask: an outline that leaves less of it is not that of the whole body
OUTSKIRTS, FAINT, MIN_FREE = 4.0, 0.45, 0.02  # px outside of the outline; coverage and share of pixels there
RIM_PX, RIM_SHARE = 1.4, 0.45  # px and share of the depth: pixels nearer to the outline are blurred
OUTLINE_DEPTH = 4.0  # px within which the body's brightness must fit that of its outline
MIN_OUTSIDE = 12  # px from which the noise outside of a body is judged
AXES = 4  # directions in which an outline may be wide
NEAR = 2  # px about a mask, right to two pixels, in which the body may be


def coverage(planes: Planes, mask: Bytes, other: Bytes, inflation: float, refined: bool) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that a body covers, 1 or 0 off its outline, and its variance; see ``coverage_centre``.

    Parameters
    ----------
    planes
        Frame, background and noise (channels, h, w), grey levels.
    mask, other
        1 where the body is (h, w), right to about two pixels, and where something else is.
    inflation
        Variance of sums of noise over that of white noise.
    refined
        Whether outline and background are estimated again from the first result.
    """
    depth = depth_of(mask, outside=False)
    deepest = float(depth.max())
    near, heart = dilated(mask, NEAR) > other, depth > 0.5 * deepest
    persistence, rim = max(1.5, deepest / 2), min(RIM_PX, RIM_SHARE * deepest)
    share, variance, distance, half_width, axes = _first_look(planes, mask, near, depth, rim)
    is_blurred = half_width.max() > SHARP
    for _ in range((REFINED if is_blurred and axes == 1 else 1) if refined else 0):
        levelled = _with_level_outside(planes, share, distance + half_width, other)
        own_depth = OWN_DEPTH * distance.max()  # at most
        clear = distance - np.minimum(half_width * (1.0 if axes == 1 else CLEAR), own_depth)
        if distance.max() < MIN_DEPTH * deepest:  # a notch, as in a small ball both darker and brighter
            clear = np.maximum(clear, depth - rim)
        share, variance = _share(levelled, mask, near, clear, persistence)
        if is_blurred:
            distance, half_width = outline(share, heart, axes)
    variance *= _liveliness(share, variance, distance + half_width < 0)
    within = distance - half_width
    rim_shown = (within > 0) & (within < OUTLINE_DEPTH)
    texture = max(0.0, float(((share - 1) ** 2 - variance)[rim_shown].sum()) / max(int(np.count_nonzero(rim_shown)), 1))
    at_outline = np.abs(distance) <= half_width
    settled = np.where(at_outline, share, distance > 0).astype(np.float32)
    sure = np.where(at_outline, inflation * variance + texture * persistence * share**2, 0).astype(np.float32)
    return settled, sure


def _first_look(
    planes: Planes, mask: Bytes, near: Flags, depth: Image, rim: float
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
        by_depth, its_variance = _share(planes, mask, near, depth - np.float32(OWN_DEPTH * deepest), persistence)
        inner, reach = outline(by_depth, heart, AXES)
        if inner.max() > MIN_THICKNESS * distance.max():
            return by_depth, its_variance, inner, reach, AXES
    return share, variance, distance, half_width, 1


def _share(planes: Planes, mask: Bytes, near: Flags, depth: Image, blur: float) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that the body covers, and its variance; by the mask where brightness leaves it open.

    The body's own brightness, and the strength of its difference in units of noise, are continued outwards from where
    ``depth`` (h, w), px, is above 0: a pixel is of the body alone. A polynomial follows its shading; the
    residual is replaced by its mean over the near pixels.
    """
    shade = shading(planes[0], depth)
    rest = unexplained(planes[0], shade, depth)
    soft = blurred(rest, blur)
    sums, missed = own_brightness(planes, shade, soft, rest, near)
    share, variance = shares(sums, blurred(missed, blur), soft, mask, near)
    return share, variance


def _with_level_outside(planes: Planes, share: Image, beyond: Image, other: Bytes) -> Planes:
    """The background as it is about the body now, e.g. in a soft shadow, continued inwards.

    ``beyond`` is negative outside of the outline; a cord that covers much of a pixel there does not count.
    """
    image, background, noise = planes
    free = (beyond > -OUTSKIRTS) & (beyond < 0) & (np.abs(share) < FAINT) & (other == 0)
    weight = free.astype(np.float32)
    *off, soft = cv2.split(blurred(cv2.merge([*(image - background) * weight, weight]), OUTSKIRTS))
    return image, background + np.array(off) / np.maximum(soft, np.float32(MIN_FREE)), noise


def _liveliness(share: Image, variance: Image, outside: Flags) -> np.float32:
    """Variance of the coverage just ``outside`` of the band, where it should be 0, over that expected; at least 1.

    The median keeps out the cord or whatever else is there.
    """
    judged = outside & (variance > 0)
    if np.count_nonzero(judged) < MIN_OUTSIDE:
        return np.float32(1)
    typical = float(np.median(np.abs(share[judged]) / np.sqrt(variance[judged])))
    return np.float32(max(1.0, (MAD_TO_SD * typical) ** 2))
