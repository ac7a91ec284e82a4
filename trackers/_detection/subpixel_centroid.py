"""Sub-pixel centroid of one body, weighted by the coverage of each pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import reduce

import cv2
import numpy as np

from iris_sysid.types import Array
from trackers._detection.coverage_kernels import NARROWEST, reach_of, shares, strength_of
from trackers._detection.depth import depth_of
from trackers._frames.arrays import MAD_TO_SD, Bytes, Flags, Image
from trackers._uncertainty.error_correlation import outline_lobes

FINER_SMALL, FINER_LARGE = 4, 2  # how much finer than the pixels the half-way contour is drawn
SMALL_WINDOW = 64  # px
SHARP, REFINED = 1.5, 2  # px: half the width of an outline from which on it is found again, and how often
CLEAR = 1.5  # of half the width of a streak's outline: so far inside of it is the body alone
WHOLE = 0.85  # of the thickness: an outline that leaves less of it is not that of a streak
DEEPEST = 0.6  # of the depth: the body's brightness is taken from there at least
SHALLOW = 0.7  # of the depth of the mask: an outline that leaves less of it is not that of the whole body
SHADINGS, FEWEST_A_TERM, MOST_SHADED = (3, 6), 60, 1500  # terms of a polynomial; pixels to which it is fitted
EXPLAINED = 0.15  # of the variance that fewer terms leave
RIDGE = 1e-9  # of the mean square of the constant term, added to each: pixels in one line do not tell all terms apart
OUTSKIRTS, FAINT, LEAST_FREE = 4.0, 0.45, 0.02  # px outside of the outline; coverage and share of pixels there
RIM_PX, RIM_SHARE = 1.4, 0.45  # px and share of the depth: pixels nearer to the outline are blurred
OUTLINE_DEPTH = 4.0  # px within which the body's brightness must fit that of its outline
FEWEST_OUTSIDE = 12  # px from which the noise outside of a body is judged
FARTHER = 2.0  # px beyond the widest outline up to which its coverage is looked at
CORD_SHARE = 0.2  # of the inscribed radius: a thinner part is a cord
AXES, SMALLEST_STREAK = 4, 5.0  # directions in which an outline may be wide; px, half the thickness of the body
COARSE = 3.0  # px of the reduced image: the standard deviation of a blur that is made at a reduced size
WIDEST = 0.6  # of half the thickness of a body: half the width of the most blurred outline


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


def coverage_centre(window: Window) -> Centre:
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
    """
    depth = depth_of(window.mask, outside=False)
    heart, persistence = depth > 0.5 * depth.max(), max(1.5, float(depth.max()) / 2)
    rim = min(RIM_PX, RIM_SHARE * float(depth.max()))
    share, distance, half_width, axes = _first_look(window, depth, rim, persistence)
    blurred = bool(half_width.max() > SHARP)
    for _ in range(REFINED if blurred and axes == 1 else 1):
        level = _level_outside(window, share, distance + half_width)
        levelled = replace(window, background=window.background + level)
        clear = distance - np.minimum(half_width * (1.0 if axes == 1 else CLEAR), DEEPEST * distance.max())
        if distance.max() < SHALLOW * depth.max():  # a notch, as in a small ball both darker and brighter
            clear = np.maximum(clear, depth - rim)
        share, variance = _share(levelled, *_continued(levelled, clear, persistence))
        if blurred:
            distance, half_width = _outline(share, heart, axes)
    edge = np.abs(distance) <= half_width
    variance = variance * _liveliness(share, variance, distance + half_width)
    texture = _texture_variance(share, variance, distance - half_width) * persistence
    variance = np.where(edge, window.inflation * variance + texture * share**2, 0.0)
    return _moments(window, np.where(edge, share, distance > 0).astype(np.float64), variance)


def _first_look(window: Window, depth: Image, rim: float, persistence: float) -> tuple[Image, Image, Image, int]:
    """Coverage, distance to the outline, half its width, and the number of directions in which they are determined.

    Where the outline is wide, the body's brightness is taken from deep inside instead of from the rim inwards. A
    streak is as thick then; a body whose rim is of another brightness is not, and stays as it is by its rim.
    """
    heart = depth > 0.5 * depth.max()
    share, _ = _share(window, *_continued(window, depth - rim, persistence))
    distance, half_width = _outline(share, heart)
    if half_width.max() >= SHARP:
        by_depth, _ = _share(window, *_continued(window, depth - DEEPEST * float(depth.max()), persistence))
        inner, reach = _outline(by_depth, heart, AXES)
        if inner.max() > WHOLE * distance.max():
            return by_depth, inner, reach, AXES
    return share, distance, half_width, 1


def _moments(window: Window, share: Image, variance: Image) -> Centre:
    """Centre and standard error from coverage and its variance."""
    area = max(float(share.sum()), 1e-9)
    columns, rows = (np.arange(size, dtype=np.float64) for size in share.shape[::-1])
    x, y = float(share.sum(axis=0) @ columns) / area, float(share.sum(axis=1) @ rows) / area
    inside = window.mask > 0
    border = np.concatenate([share[0], share[-1], share[:, 0], share[:, -1]])
    return Centre(
        x=x,
        y=y,
        sigma_x=float(np.sqrt(variance.sum(axis=0, dtype=np.float64) @ (columns - x) ** 2)) / area,
        sigma_y=float(np.sqrt(variance.sum(axis=1, dtype=np.float64) @ (rows - y) ** 2)) / area,
        area=area,
        sigma_area=float(np.sqrt(variance.sum())),
        contrast=float(largest(np.abs(window.image - window.background))[inside].mean()),
        intensity=float(window.image[..., 0][inside].mean()),
        sigma_intensity=float(window.noise[..., 0][inside].mean() * np.sqrt(window.inflation / inside.sum())),
        cut=bool(border.max() > 0.5),
        lobes=outline_lobes(share, x, y, area),
    )


def largest(image: Image) -> Image:
    """The largest of the channels of an image (h, w, channels), pixel by pixel: faster than by np.max."""
    planes = [image[..., channel] for channel in range(image.shape[-1])]
    return np.asarray(reduce(np.maximum, planes))


def _continued(window: Window, depth: Image, blur: float) -> tuple[Image, Image]:
    """The body's own brightness, and the strength of its difference in units of noise, continued outwards.

    ``depth`` (h, w), px, is above 0 where a pixel is of the body alone. Its shading is followed by a polynomial, what
    is replaced by the mean of the near pixels.
    """
    inner = np.clip(depth, 0.0, 1.0).astype(np.float32)
    weight = np.maximum(_blurred(inner, blur), np.float32(1e-6))
    shade = _shading(window.image, inner > 0.5)
    own: Image = shade + _blurred((window.image - shade) * _like(inner, shade), blur) / _like(weight, shade)
    strength, seen = (_strength(image, window) for image in (own, window.image))
    return own, np.add(strength, _blurred((seen - strength) * inner, blur) / weight, dtype=np.float32)


def _like(plane: Image, image: Image) -> Image:
    """A plane (h, w) once for each channel of an image; products are several times as fast so as by broadcasting."""
    return np.asarray(cv2.merge([plane] * image.shape[-1])).reshape(image.shape)


def _strength(image: Image, window: Window) -> Image:
    """How far an image (h, w, channels) is off the background, in units of the noise (h, w)."""
    planes = [np.ascontiguousarray(plane) for plane in (image, window.background, window.noise)]
    return strength_of(*planes)


def _shading(image: Image, inside: Flags) -> Image:
    """The polynomial in x and y (h, w, channels), constant to quadratic, that the pixels inside speak for.

    More terms must explain a good part of the residual of fewer: shading does, texture does not.
    """
    rows, columns = np.nonzero(inside)
    if rows.size == 0:
        return np.zeros_like(image)
    thin = slice(None, None, -(-rows.size // MOST_SHADED))
    rows, columns = rows[thin], columns[thin]
    x0, y0, scale = columns.mean(), rows.mean(), max(1.0, float(np.ptp(columns)) / 2)
    terms = _terms((columns - x0) / scale, (rows - y0) / scale)
    values = np.ascontiguousarray(image[rows, columns].T, dtype=np.float64)  # (channels, n): quick to sum over n
    best = values.mean(axis=1)[np.newaxis]
    residual = _mean_square(values - best.T)
    gram = terms @ terms.T + RIDGE * rows.size * np.eye(len(terms))
    moments = terms @ values.T
    for count in SHADINGS:
        if rows.size < FEWEST_A_TERM * count:
            break
        solved = np.linalg.solve(gram[:count, :count], moments[:count])
        spread = _mean_square(values - solved.T @ terms[:count])
        if spread < (1 - EXPLAINED) * residual:
            best, residual = solved, spread
    across, down = ((np.arange(n) - middle) / scale for n, middle in zip(image.shape[1::-1], (x0, y0), strict=True))
    limits = (np.tile(limit.astype(np.float32), image.shape[1]) for limit in (values.min(axis=1), values.max(axis=1)))
    return np.clip(_polynomial(best, across, down), *limits).reshape(image.shape)


def _mean_square(values: Array) -> float:
    """Of values (channels, n), summed over the channels."""
    return float(np.einsum("cn,cn->", values, values)) / values.shape[1]


def _terms(u: Array, v: Array) -> Array:
    return np.stack([np.ones_like(u), u, v, u * u, u * v, v * v])


def _polynomial(best: Array, u: Array, v: Array) -> Image:
    """The sum (h, w * channels) of the first of :func:`_terms` times their coefficients (terms, channels)."""
    full = np.zeros((6, best.shape[1]))
    full[: len(best)] = best
    level, right, below, across, both, down = full
    u = u[:, np.newaxis]
    of_powers = np.stack([level + u * right + u * u * across, below + u * both, down + 0 * u])
    powers = np.stack([np.ones_like(v), v, v * v], axis=1)
    return powers.astype(np.float32) @ of_powers.reshape(3, -1).astype(np.float32)


def _level_outside(window: Window, share: Image, beyond: Image) -> Image:
    """By how much the background about the body differs from the still one, e.g. in a soft shadow: continued inwards.

    ``beyond`` is negative outside of the outline; a cord that covers much of a pixel there does not count.
    """
    free = (beyond < 0) & (beyond > -OUTSKIRTS) & (np.abs(share) < FAINT) & (window.other == 0)
    weight = free.astype(np.float32)
    blurred = np.maximum(_blurred(weight, OUTSKIRTS), np.float32(LEAST_FREE))
    off = window.image - window.background
    return _blurred(off * _like(weight, off), OUTSKIRTS) / _like(blurred, off)


def _blurred(image: Image, blur: float) -> Image:
    """Image (h, w, channels) after a Gaussian blur of that standard deviation, px; a wide one at a reduced size."""
    height, width = image.shape[:2]
    size = (-(-width // max(1, int(blur / COARSE))), -(-height // max(1, int(blur / COARSE))))
    if size == (width, height):
        return np.asarray(cv2.GaussianBlur(image, (0, 0), blur), dtype=np.float32).reshape(image.shape)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    soft = cv2.GaussianBlur(small, (0, 0), blur * size[0] / width, sigmaY=blur * size[1] / height)
    return np.asarray(cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR)).reshape(image.shape)


def _share(window: Window, foreground: Image, strength: Image) -> tuple[Image, Image]:
    """Share of each pixel that the body covers, and its variance; by the mask where brightness does not tell."""
    near = (cv2.dilate(window.mask, np.ones((5, 5), np.uint8)) > window.other).view(np.uint8)
    planes = [np.ascontiguousarray(plane) for plane in (foreground, window.image, window.background, window.noise)]
    return shares((planes[0], planes[1], planes[2], planes[3]), strength, window.mask, near)


def _outline(share: Image, heart: Flags, axes: int = 1) -> tuple[Image, Image]:
    """Distance of each pixel to the outline, px, positive inside, and half the width of the outline there, px."""
    distance = _signed_distance(share, heart)
    return distance, _half_width(share, distance, axes)


def _signed_distance(share: Image, heart: Flags) -> Image:
    """Distance in px of each pixel's centre to the half-way contour round the heart, positive inside."""
    height, width = share.shape
    finer = FINER_SMALL if max(height, width) < SMALL_WINDOW else FINER_LARGE
    size = (width * finer, height * finer)
    solid = np.maximum(share, heart.astype(np.float32))
    fine = (cv2.resize(solid, size, interpolation=cv2.INTER_LINEAR) > 0.5).astype(np.uint8)
    seed = cv2.resize(heart.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    fine, inside = _without_cords(filled_round(fine, seed))
    outside = cv2.distanceTransform(1 - fine, cv2.DIST_L2, cv2.DIST_MASK_5)
    signed = np.where(fine > 0, inside - 0.5, 0.5 - outside) / finer
    return np.asarray(cv2.resize(signed.astype(np.float32), (width, height), interpolation=cv2.INTER_AREA))


def _without_cords(mask: Bytes) -> tuple[Bytes, Image]:
    """The mask without parts thinner than a share of its thickness, its outline elsewhere as it was; its depth, px."""
    depth = np.asarray(cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_5))
    cord = CORD_SHARE * float(depth.max())
    away = cv2.distanceTransform((depth < cord).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
    stout = mask * (away < cord + 1.0).astype(np.uint8)
    if np.array_equal(stout, mask):
        return mask, depth
    return stout, np.asarray(cv2.distanceTransform(stout, cv2.DIST_L2, cv2.DIST_MASK_5))


def filled_round(mask: Bytes, seed: Bytes) -> Bytes:
    """The parts of ``mask`` that overlap ``seed``, their holes filled."""
    count, labels = cv2.connectedComponents(mask, connectivity=4)
    both = (seed > 0) & (mask > 0)
    kept = mask  # of one part
    if count > 2 or not both.any():
        kept = (np.bincount(labels[both], minlength=count) > 0).astype(np.uint8)[labels]
    contours, _ = cv2.findContours(kept, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros_like(mask), contours, -1, 1, cv2.FILLED), dtype=np.uint8)


def _half_width(share: Image, distance: Image, axes: int) -> Image:
    """Half the width (h, w) of the outline, px: the distance outside of it at which the mean coverage falls no more.

    What it has fallen to is not the outline: a soft shadow, or nothing. A body that moves during the exposure has a
    wide outline before and behind and a sharp one on its sides: with several ``axes`` it is a number for each
    direction, opposite directions taken together.
    """
    if axes == 1 or distance.max() < SMALLEST_STREAK:
        alike = _reach(share, distance, np.ones(share.shape, dtype=np.bool_), trimmed=True)
        return np.full(share.shape, alike, dtype=np.float32)
    row, column = (float(indices.mean()) for indices in np.nonzero(distance > 0))
    y, x = np.indices(share.shape, dtype=np.float64)
    turns = np.arctan2(y - row, x - column) / np.pi * axes
    near = np.rint(turns).astype(int) % axes
    reaches = [_reach(share, distance, near == axis, trimmed=False) for axis in range(axes)]
    return np.asarray(np.interp(turns % axes, np.arange(axes + 1), [*reaches, reaches[0]]), dtype=np.float32)


def _reach(share: Image, distance: Image, part: Flags, *, trimmed: bool) -> float:
    """The distance, px, outside of a part of the outline at which the mean coverage falls no more."""
    widest = max(1.0, WIDEST * float(distance.max()))
    outside = part & (distance < -NARROWEST) & (distance > -widest - FARTHER)
    return float(reach_of(-distance[outside], share[outside], widest, trimmed))


def _liveliness(share: Image, variance: Image, beyond: Image) -> float:
    """Variance of the coverage just outside of the band, where it should be 0, over that expected; at least 1.

    The median keeps out the cord or whatever else is there. ``beyond`` is negative outside of the band.
    """
    outside = (beyond < 0) & (variance > 0)
    if np.count_nonzero(outside) < FEWEST_OUTSIDE:
        return 1.0
    spread = MAD_TO_SD * float(np.median(np.abs(share[outside]) / np.sqrt(variance[outside])))
    return max(1.0, spread**2)


def _texture_variance(share: Image, variance: Image, within: Image) -> float:
    """Variance of the coverage just inside of the band, where it should be 1, beyond its noise."""
    inside = (within > 0) & (within < OUTLINE_DEPTH)
    if not inside.any():
        return 0.0
    return max(0.0, float(((share[inside] - 1.0) ** 2 - variance[inside]).mean()))
