"""Axis of rotation, and a rough angle in each frame, from the foreground in polar coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array
from trackers._detection.foreground import BackgroundRange, any_channel, most_of_channels
from trackers._frames.arrays import MAD_TO_SD, Bytes, Image

MAX_DIFFERENCE = 60  # grey levels: upper limit of the difference
SPOKES, RINGS = 360, 24  # of the polar image
QUARTER = SPOKES // 4  # a body may turn by less than this between two frames
LEARNING = 0.1  # share of each new frame in the polar image that the next is compared with
REACH = 0.98  # of the foreground lies within this radius of the axis
MIN_PIXELS = 12  # that must differ
TRIPLES = 400  # of frames that are tried for the circle of the middles
OWN_AXIS = 0.05  # of the reach: a middle that stays nearer than this to one position turns about it
ROUND = 0.15  # of the circle's radius: largest scatter of the middles about it
MIN_FRAMES = 3


@dataclass(frozen=True, slots=True)
class Axis:
    """The axis of a turning body and how far the body reaches from it, px of the image of the search."""

    x: float
    y: float
    reach: float


def activity(background_range: BackgroundRange, small: Bytes) -> Image:
    """Distance of each pixel (h, w) from the background range, grey levels, at most 60."""
    excess = background_range.excess(small)
    level = np.where(any_channel(excess > background_range.weak), most_of_channels(excess), 0)
    opened = cv2.morphologyEx(
        np.minimum(level, MAX_DIFFERENCE).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)
    )
    return np.asarray(opened, dtype=np.float32)


def axis_of(images: Sequence[Image]) -> Axis:
    """The axis about which the middle of the foreground turns in some images (h, w).

    The axis is in px.

    The middle of a turning body lies on a circle about the axis, or on the axis itself. Images in which something
    else shows, such as a hand, are outvoted. TrackingError when nothing differs, or the centroid does not follow a
    circle.
    """
    shown = [image for image in images if np.count_nonzero(image) >= MIN_PIXELS]
    if len(shown) < MIN_FRAMES:
        raise TrackingError(
            "nothing in the clip moves, so nothing rotates; check --start and --stop, and --roi and --colour if given"
        )
    middles = np.array([_middle(image) for image in shown])
    size = float(np.median([_reach(image, middle) for image, middle in zip(shown, middles, strict=True)]))
    centre = np.median(middles, axis=0)
    if np.median(np.hypot(*(middles - centre).T)) > OWN_AXIS * size:
        centre = _circle(middles, images[0].shape)
    reach = float(np.median([_reach(image, centre) for image in shown]))
    return Axis(float(centre[0]), float(centre[1]), reach)


def _middle(image: Image) -> Array:
    rows, columns = np.nonzero(image)
    return np.average(np.column_stack([columns, rows]).astype(np.float64), axis=0, weights=image[rows, columns])


def _reach(image: Image, centre: Array) -> float:
    """Radius about a centre that contains most of the foreground."""
    rows, columns = np.nonzero(image)
    away = np.hypot(columns - centre[0], rows - centre[1])
    order = np.argsort(away)
    share = np.cumsum(image[rows, columns][order])
    return float(away[order][np.searchsorted(share, REACH * share[-1])])


def _circle(middles: Array, shape: tuple[int, ...]) -> Array:
    """Centre (2,) of the circle that most middles (k, 2) keep to: the best of many through three, then of its own."""
    rng, best, least = np.random.default_rng(0), np.zeros(3), np.inf
    for _ in range(TRIPLES):
        circle = _through(middles[rng.choice(len(middles), 3, replace=False)])
        off = float(np.median(_off(middles, circle)))
        if off < least:
            best, least = circle, off
    inside = _off(middles, best) <= 3 * MAD_TO_SD * least + 1e-9
    if np.count_nonzero(inside) >= MIN_FRAMES:
        best = _through(middles[inside])
    scatter = float(np.median(_off(middles, best)))
    in_picture = -0.5 <= best[0] < shape[1] and -0.5 <= best[1] < shape[0]
    if not in_picture or scatter > ROUND * best[2]:
        raise TrackingError(
            "the moving body does not rotate about a point in the image: its centroid does not follow a circle "
            f"(scatter {scatter:.2g} px, radius {best[2]:.3g} px); restrict the region with --roi, or use the tracker "
            "median-background"
        )
    return best[:2]


def _through(points: Array) -> Array:
    """Centre and radius (3,) of the circle nearest to points (k, 2), by Kasa's algebraic fit; infinite for a line."""
    origin = points.mean(axis=0)
    x, y = (points - origin).T
    terms = np.column_stack([x, y, np.ones_like(x)])
    (a, b, c), _, rank, _ = np.linalg.lstsq(terms, x**2 + y**2, rcond=1e-9)
    if rank < 3:
        return np.array([np.inf, np.inf, np.inf])
    return np.array([origin[0] + a / 2, origin[1] + b / 2, np.sqrt(max(c + (a**2 + b**2) / 4, 0.0))])


def _off(middles: Array, circle: Array) -> Array:
    if not np.isfinite(circle).all():
        return np.full(len(middles), np.inf)
    return np.asarray(np.abs(np.hypot(middles[:, 0] - circle[0], middles[:, 1] - circle[1]) - circle[2]))


@dataclass(frozen=True, slots=True)
class Middle:
    """The middle of the turning body: distance from the axis, px, with its standard error, and direction, rad."""

    radius: float
    direction: float
    sigma: float


def middle_of(images: Sequence[Image], axis: Axis, angles: Array) -> Middle:
    """The middle of the foreground in images turned by some angles (k,) rad, at angle zero."""
    shown = [k for k, image in enumerate(images) if np.count_nonzero(image) >= MIN_PIXELS]
    x, y = (np.array([_middle(images[k]) for k in shown]) - np.array([axis.x, axis.y])).T
    cosine, sine = np.cos(angles[shown]), np.sin(angles[shown])
    back = np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
    right, down = np.median(back, axis=0)
    sigma = float(np.sqrt(back.var(axis=0).sum() / 2 / len(shown)))
    return Middle(float(np.hypot(right, down)), float(np.arctan2(-down, right)), sigma)


class RotationFollower:
    """Follows the angle from frame to frame by the polar image of the foreground, to about a degree."""

    def __init__(self, axis: Axis) -> None:
        angle = 2 * np.pi * np.arange(SPOKES) / SPOKES
        radius = axis.reach * (np.arange(RINGS) + 0.5) / RINGS
        self.columns = (axis.x + radius[:, np.newaxis] * np.cos(angle)).astype(np.float32)
        self.rows = (axis.y - radius[:, np.newaxis] * np.sin(angle)).astype(np.float32)
        self.weight = np.sqrt(radius)[:, np.newaxis]
        self.known = np.zeros((RINGS, SPOKES))
        self.angle = self.rate = 0.0

    def follow(self, image: Image) -> float:
        """Angle in spokes, counted on through full turns, anticlockwise, of the next frame (h, w)."""
        polar = cv2.remap(image, self.columns, self.rows, cv2.INTER_LINEAR) * self.weight
        if not self.known.any():
            self.known = polar
            return self.angle
        likeness = np.fft.irfft((np.fft.rfft(polar) * np.conj(np.fft.rfft(self.known))).sum(axis=0), SPOKES)
        expected = round(self.angle + self.rate)
        steps = np.arange(expected - QUARTER + 1, expected + QUARTER)
        best = int(np.argmax(likeness[steps % SPOKES]))
        before, now, after = (float(likeness[(steps[best] + side) % SPOKES]) for side in (-1, 0, 1))
        bend = before - 2 * now + after
        angle = float(steps[best]) + (float(np.clip((before - after) / (2 * bend), -0.5, 0.5)) if bend < 0 else 0.0)
        self.rate, self.angle = angle - self.angle, angle
        rotated_back = np.roll(polar, -round(angle), axis=1)
        self.known = (1 - LEARNING) * self.known + LEARNING * rotated_back
        return angle
