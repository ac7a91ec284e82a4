"""Coverage of the pixels of a window by the body in it, and what its outline shows (numba: one call a body)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np

from iris_sysid.io.kernels import kernel
from trackers._detection.coverage_kernels import (
    Planes,
    beyond_shade,
    levelled,
    liveliness,
    off_background,
    own_brightness,
    shares,
    texture_variance,
)
from trackers._detection.depth import exact_depth
from trackers._detection.outline import outline
from trackers._detection.shading import shading
from trackers._detection.small_images import blurred, dilated
from trackers._frames.arrays import Bytes, Flags, Image

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


@kernel(nogil=True)
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
        Whether outline and background are estimated again from the first result.
    """
    depth = exact_depth(mask, False)
    deepest = float(depth.max())
    near, heart = _without(dilated(mask, NEAR), other), _above(depth, 0.5 * deepest)
    persistence, rim = max(1.5, deepest / 2), min(RIM_PX, RIM_SHARE * deepest)
    share, variance, distance, half_width, axes = _first_look(planes, mask, near, depth, rim)
    is_blurred = half_width.max() > SHARP
    for _ in range((REFINED if is_blurred and axes == 1 else 1) if refined else 0):
        level = _with_level_outside(planes, share, _plus(distance, half_width, 1.0), other)
        clear = _clear(distance, half_width, 1.0 if axes == 1 else CLEAR)
        if distance.max() < MIN_DEPTH * deepest:  # a notch, as in a small ball both darker and brighter
            clear = _larger(clear, _less(depth, rim))
        share, variance = _share((planes[0], level, planes[2]), mask, near, clear, persistence)
        if is_blurred:
            distance, half_width = outline(share, heart, axes)
    lively = np.float32(liveliness(share, variance, _plus(distance, half_width, 1.0), MIN_OUTSIDE))
    for y in range(variance.shape[0]):
        for x in range(variance.shape[1]):
            variance[y, x] *= lively
    texture = texture_variance(share, variance, _plus(distance, half_width, -1.0), OUTLINE_DEPTH) * persistence
    return _at_outline(share, variance, distance, half_width, inflation, texture)


@kernel(nogil=True)
def _first_look(
    planes: Planes, mask: Bytes, near: Bytes, depth: Image, rim: float
) -> tuple[Image, Image, Image, Image, int]:
    """Coverage and its variance, distance to the outline, half its width, and in how many directions that is found.

    Where the outline is wide, the body's brightness is taken from deep inside instead of from the rim inwards. A
    streak is as thick then; a body whose rim is of another brightness is not, and stays as it is by its rim.
    """
    deepest = float(depth.max())
    heart, persistence = _above(depth, 0.5 * deepest), max(1.5, deepest / 2)
    share, variance = _share(planes, mask, near, _less(depth, rim), persistence)
    distance, half_width = outline(share, heart, 1)
    if half_width.max() >= SHARP:
        by_depth, its_variance = _share(planes, mask, near, _less(depth, OWN_DEPTH * deepest), persistence)
        inner, reach = outline(by_depth, heart, AXES)
        if inner.max() > MIN_THICKNESS * distance.max():
            return by_depth, its_variance, inner, reach, AXES
    return share, variance, distance, half_width, 1


@kernel(nogil=True)
def _share(planes: Planes, mask: Bytes, near: Bytes, depth: Image, blur: float) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that the body covers, and its variance; by the mask where brightness leaves it open.

    The body's own brightness, and the strength of its difference in units of noise, are continued outwards from where
    ``depth`` (h, w), px, is above 0: a pixel is of the body alone. A polynomial follows its shading; the
    residual is replaced by its mean over the near pixels.
    """
    height, width = mask.shape
    shade = shading(planes[0], depth, near)
    soft = blurred(beyond_shade(planes[0], shade, depth), blur)
    own, strength, missed = own_brightness(planes, shade, soft, depth, near)
    spread = blurred(missed.reshape((height, width, 1)), blur)
    for y in range(height):
        for x in range(width):
            strength[y, x] += spread[y, x, 0] / max(soft[y, x, -1], np.float32(1e-6))
    return shares(planes, own, strength, mask, near)


@kernel(nogil=True)
def _with_level_outside(planes: Planes, share: Image, beyond: Image, other: Bytes) -> Image:
    """The background as it is about the body now, e.g. in a soft shadow, continued inwards.

    ``beyond`` is negative outside of the outline; a cord that covers much of a pixel there does not count.
    """
    free = np.zeros(share.shape, dtype=np.uint8)
    for y in range(share.shape[0]):
        for x in range(share.shape[1]):
            free[y, x] = -OUTSKIRTS < beyond[y, x] < 0 and abs(share[y, x]) < FAINT and other[y, x] == 0
    soft = blurred(off_background(planes[0], planes[1], free), OUTSKIRTS)
    return levelled(planes[1], soft, MIN_FREE)


@kernel(nogil=True)
def _clear(distance: Image, half_width: Image, times: float) -> Image:
    """Depth of each pixel, px, less ``times`` the half width of the outline, but at most less a share of the depth."""
    deepest, clear = np.float32(OWN_DEPTH) * distance.max(), np.empty_like(distance)
    for y in range(distance.shape[0]):
        for x in range(distance.shape[1]):
            clear[y, x] = distance[y, x] - min(half_width[y, x] * np.float32(times), deepest)
    return clear


# loops, because numba takes seconds to compile each expression of whole images


@kernel(nogil=True)
def _less(image: Image, by: float) -> Image:
    less = np.empty_like(image)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            less[y, x] = image[y, x] - np.float32(by)
    return less


@kernel(nogil=True)
def _plus(image: Image, other: Image, times: float) -> Image:
    plus = np.empty_like(image)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            plus[y, x] = image[y, x] + np.float32(times) * other[y, x]
    return plus


@kernel(nogil=True)
def _larger(image: Image, other: Image) -> Image:
    larger = np.empty_like(image)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            larger[y, x] = max(image[y, x], other[y, x])
    return larger


@kernel(nogil=True)
def _above(image: Image, level: float) -> Flags:
    above = np.empty(image.shape, dtype=np.bool_)
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            above[y, x] = image[y, x] > level
    return above


@kernel(nogil=True)
def _without(mask: Bytes, other: Bytes) -> Bytes:
    without = np.empty(mask.shape, dtype=np.uint8)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            without[y, x] = mask[y, x] > other[y, x]
    return without


@kernel(nogil=True)
def _at_outline(
    share: Image, variance: Image, distance: Image, half_width: Image, inflation: float, texture: float
) -> tuple[Image, Image]:
    """Share and variance (h, w) with the pixels off the outline set to a share of 1 or 0 and a variance of 0."""
    settled = np.zeros(share.shape, dtype=np.float32)
    sure = np.zeros(share.shape, dtype=np.float32)
    for y in range(share.shape[0]):
        for x in range(share.shape[1]):
            if abs(distance[y, x]) <= half_width[y, x]:
                settled[y, x] = share[y, x]
                sure[y, x] = inflation * variance[y, x] + texture * share[y, x] ** 2
            else:
                settled[y, x] = distance[y, x] > 0
    return settled, sure
