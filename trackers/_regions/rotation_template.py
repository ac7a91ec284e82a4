"""Template of a rotating body learned from some frames, and the angle at which it matches a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array
from trackers._frames.arrays import MAD_TO_SD, Bytes, Image
from trackers._regions.rotation_axis import Axis

MAX_RADIAL_POINTS = 120  # points from the axis to the end of the body, at most
MAX_POINTS = 6000  # that are compared in every frame: those that change most with the angle
BLOCK = 0.5  # of the reach: side of the blocks whose errors are taken to be independent: light and detector vary slowly
TUKEY = 5.0  # standard deviations from which a residual does not count
MIN_NOISE = 1.0  # grey levels
STEPS = 8  # of Gauss and Newton, at most
SETTLED = 1e-5  # rad
MAX_STEP = 0.2  # rad, and of the reach
ROUNDS = 2  # in which brightness and appearance are found in turn
RIDGE = 1e-9  # of the diagonal


@dataclass(frozen=True, eq=False, slots=True)
class Pattern:
    """Grey levels of a body about its ``axis``, at angle zero, px of the image of the search.

    ``offset`` (n, 2) are points from the axis, x right and y down; ``level`` (n,) their grey level, ``slope`` (n, 2)
    its derivatives, ``spread`` (n,) by how much they differ from frame to frame beside the body's turning.
    """

    axis: Axis
    offset: Array
    level: Array
    slope: Array
    spread: Array

    @property
    def block(self) -> NDArray[np.int64]:
        """Number (n,) of the block in which each point lies. They are indices."""
        cells = np.floor(self.offset / (BLOCK * self.axis.reach)).astype(np.int64)
        return np.asarray(np.unique(cells, axis=0, return_inverse=True)[1].ravel(), dtype=np.int64)

    @property
    def by_angle(self) -> Array:
        """Derivative (n,) of the grey level, at a fixed position of the body, by the angle."""
        return np.asarray(self.slope[:, 0] * self.offset[:, 1] - self.slope[:, 1] * self.offset[:, 0])

    def telling(self) -> Pattern:
        """The same pattern with the points that change most with the angle, as many as are compared in every frame."""
        worth = self.by_angle**2 / (self.spread**2 + MIN_NOISE**2)
        best = np.sort(np.argsort(-worth)[:MAX_POINTS])
        return replace(
            self, offset=self.offset[best], level=self.level[best], slope=self.slope[best], spread=self.spread[best]
        )


@dataclass(frozen=True, slots=True)
class RotationMatch:
    """How a frame shows a pattern: angle and its standard error, rad; shift of the axis, px; share of points used."""

    angle: float
    sigma: float
    shift: tuple[float, float]
    share: float


def rotation(angle: float) -> Array:
    """Rotation (2, 2) by an angle, anticlockwise as seen, of positions with y down.

    The angle is in rad; the matrix is dimensionless.
    """
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine, sine], [-sine, cosine]])


def learn_pattern(images: Sequence[Image], angles: Array, axis: Axis) -> Pattern:
    """The appearance of a body at angle zero from images (h, w) in which it is turned by known angles (k,).

    Angles are in rad.

    It is the median over the images, each with its own brightness, so that static parts leave no trace.
    """
    side = min(MAX_RADIAL_POINTS, int(axis.reach))
    step = axis.reach / side
    grid = step * np.arange(-side, side + 1, dtype=np.float64)
    x, y = np.meshgrid(grid, grid)
    offsets = np.column_stack([x.ravel(), y.ravel()])
    rotated = [offsets @ rotation(angle).T for angle in angles]
    values = np.stack([_seen(image, axis, (0.0, 0.0), where) for image, where in zip(images, rotated, strict=True)])
    level = np.median(values, axis=0)
    for _ in range(ROUNDS):
        even = np.stack([_evened(*pair, level) for pair in zip(values, rotated, strict=True)])
        level = np.median(even, axis=0)
    spread = MAD_TO_SD * np.median(np.abs(even - level), axis=0)
    slopes = np.gradient(level.reshape(x.shape), step)
    slope = np.column_stack([slopes[1].ravel(), slopes[0].ravel()])
    inside = np.hypot(*offsets.T) < axis.reach
    return Pattern(axis, offsets[inside], level[inside], slope[inside], spread[inside])


def _seen(image: Image, axis: Axis, shift: tuple[float, float], offsets: Array) -> Array:
    """Grey levels (n,) of an image at positions (n, 2) from the axis."""
    where = (offsets + np.array([axis.x + shift[0], axis.y + shift[1]])).astype(np.float32)
    columns = -(-len(where) // 256)  # a map must not be longer than 32767 pixels
    padded = np.resize(where, (256 * columns, 2)).reshape(256, columns, 2)
    seen = cv2.remap(image, padded, None, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(seen.ravel()[: len(where)], dtype=np.float64)


def _lighting(level: Array, offsets: Array) -> Array:
    """Contributions of brightness, its slopes and an offset to the grey levels (n, 4)."""
    return np.column_stack([level, level * offsets[:, 0], level * offsets[:, 1], np.ones_like(level)])


def _evened(values: Array, offsets: Array, level: Array) -> Array:
    """Grey levels (n,) seen at positions (n, 2), brought to the brightness of the pattern."""
    terms = _lighting(level, offsets)
    use = np.ones(values.size, dtype=np.bool_)
    for _ in range(2):
        gain = _solved(*_normal(terms, values, use.astype(np.float64)))
        off = np.abs(values - terms @ gain)
        use = off <= TUKEY * MAD_TO_SD * np.median(off) + MIN_NOISE
    light = np.maximum(gain[0] + offsets @ gain[1:3], 0.2)
    return np.asarray((values - gain[3]) / light)


def match_rotation(pattern: Pattern, image: Image, start: float, *, loose: bool = False) -> RotationMatch:
    """The angle at which an image (h, w) shows a pattern, by weighted least squares from a start within a step of it.

    Every point is predicted by the pattern's grey level times the brightness of the frame, which may slope, plus an
    offset. The standard error is the jackknife's over blocks of points (Efron and Tibshirani 1993, ch. 11), so that
    noise which is alike within a block, and parts of the image that differ from the pattern, count as they should.

    Parameters
    ----------
    pattern
        Parameters of the fit.
    image
        Where.
    start
        Angle to begin with, rad.
    loose
        Whether the axis may be elsewhere in this image; no standard error is worked out then.
    """
    angle, shift = start, np.zeros(2)
    for _ in range(STEPS):
        linear = _linear(pattern, image, angle, shift, loose=loose)
        step = np.clip(linear.solution[0], -MAX_STEP, MAX_STEP)
        angle += float(step)
        if loose:
            longest = MAX_STEP * pattern.axis.reach
            shift += np.clip(linear.solution[-2:], -longest, longest)
        if abs(step) < SETTLED:
            break
    sigma = float("nan") if loose else _jackknifed(linear, pattern.block)
    return RotationMatch(angle, sigma, (float(shift[0]), float(shift[1])), float(np.mean(linear.weight > 0)))


@dataclass(frozen=True, eq=False, slots=True)
class _LinearStep:
    """One step: corrections (p,) of angle, brightness (4) and perhaps shift (2); and what they were found from.

    ``terms`` (n, p), ``values`` (n,) and ``weight`` (n,) of the points.
    """

    solution: Array
    terms: Array
    values: Array
    weight: Array


def _linear(pattern: Pattern, image: Image, angle: float, shift: Array, *, loose: bool) -> _LinearStep:
    turn = rotation(angle)
    offsets = pattern.offset @ turn.T
    values = _seen(image, pattern.axis, (float(shift[0]), float(shift[1])), offsets)
    terms = np.column_stack([-pattern.by_angle, _lighting(pattern.level, offsets)])
    if loose:
        terms = np.column_stack([terms, -pattern.slope @ turn.T])
    noise = np.sqrt(pattern.spread**2 + MIN_NOISE**2)
    weight = 1 / noise**2
    for _ in range(2):
        solution = _solved(*_normal(terms, values, weight))
        ratio = (values - terms @ solution) / noise
        cut = TUKEY * max(MAD_TO_SD * float(np.median(np.abs(ratio))), 1e-9)
        weight = np.maximum(0.0, 1 - (ratio / cut) ** 2) ** 2 / noise**2
    information, projected = _normal(terms, values, weight)
    return _LinearStep(_solved(information, projected), terms, values, weight)


def _normal(terms: Array, values: Array, weight: Array) -> tuple[Array, Array]:
    """Information (p, p) and projection (p,) of a weighted linear fit."""
    weighted = terms * weight[:, np.newaxis]
    return weighted.T @ terms, weighted.T @ values


def _solved(information: Array, projected: Array) -> Array:
    """Solution (..., p) of normal equations; undetermined parameters stay at zero."""
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", information), 1e-12))
    scaled = information / scale[..., np.newaxis] / scale[..., np.newaxis, :] + RIDGE * np.eye(scale.shape[-1])
    return np.asarray(np.linalg.solve(scaled, (projected / scale)[..., np.newaxis])[..., 0] / scale)


def _jackknifed(linear: _LinearStep, block: NDArray[np.int64]) -> float:
    """Standard error of the angle by leaving out one block of points after the other."""
    weighted = linear.terms * linear.weight[:, np.newaxis]
    p, count = linear.terms.shape[1], int(block.max()) + 1
    products = np.einsum("ni,nj->nij", weighted, np.column_stack([linear.terms, linear.values])).reshape(len(block), -1)
    sums = np.stack([np.bincount(block, weights=product, minlength=count) for product in products.T], axis=1)
    without = (sums.sum(axis=0) - sums).reshape(count, p, p + 1)
    angles = _solved(without[..., :p], without[..., p])[:, 0]
    return float(np.sqrt((count - 1) / count * ((angles - angles.mean()) ** 2).sum()))


def centred(axis: Axis, angles: Array, shifts: Array) -> Axis:
    """The axis by where it was found (k, 2) at some angles (k,): what stays put is the axis' own error.

    Shifts are in px, angles in rad.

    A pattern whose zero is off the axis by d goes round: shift = error + R(angle) d.
    """
    terms = np.zeros((2 * len(angles), 4))
    terms[0::2, 0] = terms[1::2, 1] = 1.0
    terms[:, 2:] = np.concatenate([rotation(angle) for angle in angles])
    weight = np.ones(len(angles))
    for _ in range(5):
        twice = np.repeat(weight, 2)[:, np.newaxis]
        ridge = 1e-3 * np.eye(4) * len(angles)  # an arc too short to tell one from the other leaves the axis there
        solution = np.linalg.solve((terms * twice).T @ terms + ridge, (terms * twice).T @ shifts.ravel())
        off = np.hypot(*(shifts.ravel() - terms @ solution).reshape(-1, 2).T)
        weight = 1 / np.maximum(1.0, off / (MAD_TO_SD * np.median(off) + 1e-6)) ** 2
    return replace(axis, x=axis.x + float(solution[0]), y=axis.y + float(solution[1]))


def luma_of(small: Bytes) -> Image:
    """The plane of an image (h, w) or (h, w, 3) that is compared: luma, as it is sharpest. In grey levels."""
    return np.asarray(small if small.ndim == 2 else small[..., 0], dtype=np.float32)
