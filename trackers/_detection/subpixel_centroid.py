"""Sub-pixel centroid of one body, weighted by the coverage of each pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import cv2
import numpy as np

from trackers._detection.coverage_kernels import (
    beyond_shade,
    levelled,
    liveliness,
    moments,
    off_background,
    own_brightness,
    seen_inside,
    shares,
    texture_variance,
)
from trackers._detection.depth import depth_of
from trackers._detection.outline import outline
from trackers._detection.shading import shading
from trackers._frames.arrays import Bytes, Image
from trackers._uncertainty.error_correlation import outline_lobes

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
COARSE = 3.0  # px of the reduced image: the standard deviation of a blur that is made at a reduced size
NEAR = np.ones((5, 5), np.uint8)  # px about a mask, right to two pixels, in which the body may be


@dataclass(frozen=True, slots=True)
class Centre:
    """Centre of a body in its window (px), area (px), contrast and intensity (grey levels), with standard errors.

    ``cut`` says that the body reaches the border of the window; ``lobes`` are amplitudes of the outline's lobes, px.
    """

    x: float
    y: float
    sigma_x: float
    sigma_y: float
    area: float
    sigma_area: float
    contrast: float
    intensity: float
    sigma_intensity: float
    cut: bool
    lobes: tuple[float, ...] = ()


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
    def planes(self) -> tuple[Image, Image, Image]:
        """Frame, background and noise (h, w, channels), each in one piece, as the kernels take them."""
        planes = [np.ascontiguousarray(plane, dtype=np.float32) for plane in (self.image, self.background, self.noise)]
        return planes[0], planes[1], planes[2]


def coverage_centre(window: Window, *, refined: bool = True) -> Centre:
    """Centre of the body in a window, weighted by how much of each pixel it covers.

    A pixel that the body covers by the share a shows I = a F + (1 - a) B. Let i = (I - B)/noise and
    f = (F - B)/noise, vectors over the channels, with F continued outwards from the inside of the
    body, and s the strength |i| continued likewise. In a band about the outline

        a = i.f / |f|^2           where the body is all brighter or all darker, |f| near s,
        a = |i| / s               where it is both, as a steel ball is, |f| well below s,
        var a = (1 + (1 - m)^2) / s^2,

    mixed as m to 1 - m in between. a is 1 inside of the band and 0 outside, so that texture,
    highlights and noise away from the outline do not count. Then, with A = sum(a),

        x = sum(a x) / A,   var x = sum((x_i - x)^2 v_i) / A^2,

    over the pixels i of the band, where v = inflation * q * var a + e^2 a^2 d. Here q >= 1 is how much
    noisier than the still background the pixels just outside of the band are: compression keeps the
    noise of the moving body. e^2 is the variance of a just inside of the band beyond its noise, that is how
    badly F is known on a textured body, and d the distance in px over which such an error persists.

    Parameters
    ----------
    window
        The pixels round the body.
    refined
        Whether outline and background are looked at again by the first result; if not, the centre is a good guess.
    """
    depth = depth_of(window.mask, outside=False)
    near = (cv2.dilate(window.mask, NEAR) > window.other).view(np.uint8)
    heart, persistence = depth > 0.5 * depth.max(), max(1.5, float(depth.max()) / 2)
    rim = min(RIM_PX, RIM_SHARE * float(depth.max()))
    (share, variance), distance, half_width, axes = _first_look(window, near, depth, rim, persistence)
    blurred = bool(half_width.max() > SHARP)
    rounds = REFINED if blurred and axes == 1 else 1
    for _ in range(rounds if refined else 0):
        level = _with_level_outside(window, share, distance + half_width)
        clear = distance - np.minimum(half_width * (1.0 if axes == 1 else CLEAR), DEEPEST * distance.max())
        if distance.max() < SHALLOW * depth.max():  # a notch, as in a small ball both darker and brighter
            clear = np.maximum(clear, depth - rim)
        share, variance = _share(level, near, clear, persistence)
        if blurred:
            distance, half_width = outline(share, heart, axes)
    edge = np.abs(distance) <= half_width
    variance = variance * np.float32(liveliness(share, variance, distance + half_width, FEWEST_OUTSIDE))
    texture = texture_variance(share, variance, distance - half_width, OUTLINE_DEPTH) * persistence
    variance = np.where(edge, window.inflation * variance + texture * share**2, 0.0)
    return _moments(window, np.where(edge, share, distance > 0), variance)


def _first_look(
    window: Window, near: Bytes, depth: Image, rim: float, persistence: float
) -> tuple[tuple[Image, Image], Image, Image, int]:
    """Coverage and its variance, distance to the outline, half its width, and in how many directions that is found.

    Where the outline is wide, the body's brightness is taken from deep inside instead of from the rim inwards. A
    streak is as thick then; a body whose rim is of another brightness is not, and stays as it is by its rim.
    """
    heart = depth > 0.5 * depth.max()
    share = _share(window, near, depth - rim, persistence)
    distance, half_width = outline(share[0], heart)
    if half_width.max() >= SHARP:
        by_depth = _share(window, near, depth - DEEPEST * float(depth.max()), persistence)
        inner, reach = outline(by_depth[0], heart, AXES)
        if inner.max() > WHOLE * distance.max():
            return by_depth, inner, reach, AXES
    return share, distance, half_width, 1


def _moments(window: Window, share: Image, variance: Image) -> Centre:
    """Centre and standard error from coverage and its variance."""
    area, x, y, sigma_area, sigma_x, sigma_y, border = (
        float(value) for value in moments(share.astype(np.float64), variance.astype(np.float64))
    )
    contrast, intensity, noise, count = seen_inside(window.planes, window.mask)
    return Centre(
        x=x,
        y=y,
        sigma_x=sigma_x,
        sigma_y=sigma_y,
        area=area,
        sigma_area=sigma_area,
        contrast=contrast,
        intensity=intensity,
        sigma_intensity=float(noise * np.sqrt(window.inflation / count)),
        cut=border > 0.5,
        lobes=outline_lobes(share, x, y, area),
    )


def largest(image: Image) -> Image:
    """The largest of the channels of an image (h, w, channels), pixel by pixel: faster than by np.max."""
    planes = [image[..., channel] for channel in range(image.shape[-1])]
    return np.asarray(reduce(np.maximum, planes))


def _share(window: Window, near: Bytes, depth: Image, blur: float) -> tuple[Image, Image]:
    """Share (h, w) of each pixel that the body covers, and its variance; by the mask where brightness does not tell.

    The body's own brightness, and the strength of its difference in units of noise, are continued outwards from where
    ``depth`` (h, w), px, is above 0: a pixel is of the body alone. Its shading is followed by a polynomial, what is
    left is replaced by the mean of the near pixels.
    """
    planes, depth = window.planes, np.asarray(depth, dtype=np.float32)
    shade = shading(planes[0], depth, near)
    soft = _blurred(beyond_shade(planes[0], shade, depth), blur)
    own, strength, missed = own_brightness(planes, shade, soft, depth, near)
    strength += _blurred(missed, blur) / np.maximum(soft[..., -1], np.float32(1e-6))
    return shares(planes, own, strength, window.mask, near)


def _with_level_outside(window: Window, share: Image, beyond: Image) -> Window:
    """The window with the background as it is about the body now, e.g. in a soft shadow, continued inwards.

    ``beyond`` is negative outside of the outline; a cord that covers much of a pixel there does not count.
    """
    free = (beyond < 0) & (beyond > -OUTSKIRTS) & (np.abs(share) < FAINT) & (window.other == 0)
    image, background, _ = window.planes
    soft = _blurred(off_background(image, background, free.view(np.uint8)), OUTSKIRTS)
    return replace(window, background=levelled(background, soft, LEAST_FREE))


def _blurred(image: Image, blur: float) -> Image:
    """Image (h, w, channels) after a Gaussian blur of that standard deviation, px; a wide one at a reduced size."""
    height, width = image.shape[:2]
    size = (-(-width // max(1, int(blur / COARSE))), -(-height // max(1, int(blur / COARSE))))
    if size == (width, height):
        return np.asarray(cv2.GaussianBlur(image, (0, 0), blur), dtype=np.float32).reshape(image.shape)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(small, (0, 0), blur * size[0] / width, sigmaY=blur * size[1] / height)
    return np.asarray(cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR)).reshape(image.shape)
