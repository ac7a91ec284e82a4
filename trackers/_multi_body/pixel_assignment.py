"""Assignment of covered pixels to bodies by k-means: touching bodies of one class part at the middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array
from trackers._detection.foreground import BackgroundRange
from trackers._frames.arrays import Bytes, Image
from trackers._multi_body.appearance_classes import HALF_COVERED, AppearanceClass, class_coverages

MIN_COVERAGE = 0.25  # of a pixel: less is noise, shade or the blurred outline
REACH = 1.6  # radii: a pixel farther from every body is of none
THIN = 0.35  # of a body's radius: a part thinner on both sides is a cord
ROUNDS = 12
SETTLED = 0.02  # px that the centres move in a round
TRIES = 12  # starts of the search without a prediction
FULL, EMPTY = 1.45, 0.55  # of a body's area: two bodies in one share, one body in two


@dataclass(frozen=True, eq=False, slots=True)
class CoveredPixels:
    """Pixels that bodies cover in one frame: ``xy`` (n, 2), the share of each (n,), and the number of its class (n,).

    ``size`` is width and height of the image of the search, px.
    """

    frame: int
    t_s: float
    xy: NDArray[np.int16]
    share: NDArray[np.float16]
    class_index: NDArray[np.int8]
    size: tuple[int, int]

    def pool(self, number: int, radius: float) -> ClassPixels:
        """The pixels of one class, whose bodies have that radius, px."""
        chosen = self.class_index == number
        return ClassPixels(self.xy[chosen].astype(np.float64), self.share[chosen].astype(np.float64), radius, self.size)


@dataclass(frozen=True, eq=False, slots=True)
class PixelAssignment:
    """Pixels shared out among bodies: ``labels`` (n,) with -1 for none, ``centres`` (k, 2) px, ``areas`` (k,) px.

    ``areas`` are seen, ``beyond`` (k,) px lie beyond the edge of the image. ``energy`` is the spread of the pixels
    about their centres, 1 for each body that is a whole disc.
    """

    labels: NDArray[np.int64]
    centres: Array
    areas: Array
    beyond: Array
    energy: float

    def taken(self, order: NDArray[np.int64]) -> PixelAssignment:
        """The same assignments renumbered: body k gets what ``order[k]`` had. ``order`` (bodies,) holds indices."""
        back = np.full(len(order) + 1, -1)
        back[order] = np.arange(len(order))
        return PixelAssignment(
            back[self.labels], self.centres[order], self.areas[order], self.beyond[order], self.energy
        )


def covered_pixels(
    background_range: BackgroundRange,
    classes: Sequence[AppearanceClass],
    background: Image,
    image: Bytes,
    frame: int,
    t_s: float,
) -> CoveredPixels:
    """What bodies of some classes cover in an image (h, w, channels) before a background of that shape.

    Images are in grey levels.
    """
    where = background_range.weakly(image)
    size = (image.shape[1], image.shape[0])
    if not where.any():
        return CoveredPixels(
            frame, t_s, np.zeros((0, 2), np.int16), np.zeros(0, np.float16), np.zeros(0, np.int8), size
        )
    x, y, width, height = cv2.boundingRect(where)
    part = (slice(y, y + height), slice(x, x + width))
    shown = where[part] > 0
    coverages = np.zeros((len(classes), height, width), dtype=np.float32)
    coverages[:, shown] = class_coverages(classes, image[part][shown].astype(np.float32), background[part][shown])
    for number, appearance in enumerate(classes):
        coverages[number] *= _thick(coverages[number], appearance.radius)
    class_of, share = coverages.argmax(axis=0), coverages.max(axis=0)
    rows, columns = np.nonzero(share > MIN_COVERAGE)
    xy = np.stack([columns + x, rows + y], axis=-1).astype(np.int16)
    return CoveredPixels(
        frame, t_s, xy, share[rows, columns].astype(np.float16), class_of[rows, columns].astype(np.int8), size
    )


def _thick(share: Image, radius: float) -> Image:
    """1 where the covered region is as thick as a body, or adjacent to that; removes cords and specks."""
    side = 2 * max(1, int(THIN * radius)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    covered = cv2.copyMakeBorder((share > HALF_COVERED).astype(np.uint8), side, side, side, side, cv2.BORDER_REPLICATE)
    opened = cv2.dilate(cv2.morphologyEx(covered, cv2.MORPH_OPEN, disc), np.ones((5, 5), np.uint8))
    return opened[side:-side, side:-side].astype(np.float32)


@dataclass(frozen=True, eq=False, slots=True)
class ClassPixels:
    """Pixels (n, 2) that equal bodies of some radius (px) cover, the share of each (n,), and the image's size, px."""

    xy: Array
    share: Array
    radius: float
    size: tuple[int, int]

    def assign(self, start: Array) -> PixelAssignment:
        """Share the pixels out by Lloyd's iteration, begun at ``start`` (k, 2) px, and mend what is uneven.

        Each pixel goes to the nearest centre within reach, each centre to the mean of its pixels. Of a body that the
        edge of the image cuts, the hidden part counts as that of a disc: the step of the EM algorithm for
        data that are missing.
        """
        assignment = self._lloyd(start)
        for _ in range(len(start)):
            areas = assignment.areas + assignment.beyond
            full, empty = int(areas.argmax()), int(areas.argmin())
            if areas[full] < FULL * self.area or areas[empty] > EMPTY * self.area:
                break
            other = self._lloyd(self._parted(assignment, full, empty))
            if other.energy >= assignment.energy:
                break
            assignment = other
        return assignment

    def assign_without_prediction(self, count: int, rng: np.random.Generator) -> PixelAssignment:
        """Share the pixels out among ``count`` bodies without knowing where they are: the best of many starts."""
        from scipy.cluster.vq import kmeans2

        starts = [kmeans2(self.xy, count, iter=3, minit="++", rng=rng)[0] for _ in range(TRIES)]
        return min((self.assign(start) for start in starts), key=lambda assignment: assignment.energy)

    @property
    def area(self) -> float:
        """Area of one body, px."""
        return float(np.pi * self.radius**2)

    def _lloyd(self, start: Array) -> PixelAssignment:
        centres, reach = start.astype(np.float64), (REACH * self.radius) ** 2
        for _ in range(ROUNDS):
            apart = ((self.xy[:, np.newaxis] - centres) ** 2).sum(axis=-1)
            labels = apart.argmin(axis=1)
            distance = apart[np.arange(len(labels)), labels]
            labels = np.where(distance < reach, labels, -1)
            beyond, sums = self._beyond(centres)
            areas = _summed(labels, self.share, len(start))
            sums = sums + np.stack([_summed(labels, self.share * x, len(start)) for x in self.xy.T], axis=-1)
            whole = (areas + beyond)[:, np.newaxis]
            before, centres = centres, np.where(whole > 0, sums / np.maximum(whole, 1e-9), centres)
            if np.abs(centres - before).max() < SETTLED:
                break
        spread = float((self.share * np.minimum(distance, reach)).sum()) / (self.area * self.radius**2 / 2)
        return PixelAssignment(labels, centres, areas, beyond, spread)

    def _beyond(self, centres: Array) -> tuple[Array, Array]:
        """Area (k,) of discs at some centres that lies beyond the edges, and the sum (k, 2) of its coordinates."""
        inner = (centres > self.radius) & (centres < np.array(self.size) - 1 - self.radius)
        if inner.all():
            return np.zeros(len(centres)), np.zeros_like(centres)
        side = np.arange(-int(self.radius) - 1, int(self.radius) + 2)
        disc = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        disc = disc[(disc**2).sum(axis=1) < self.radius**2]
        points = centres[:, np.newaxis] + disc
        outside = ((points < -0.5) | (points > np.array(self.size) - 0.5)).any(axis=-1)
        return outside.sum(axis=1).astype(np.float64), (points * outside[..., np.newaxis]).sum(axis=1)

    def _parted(self, assignment: PixelAssignment, full: int, empty: int) -> Array:
        """The centres with the emptiest moved into the fullest share, which is cut across."""
        pixels = self.xy[assignment.labels == full] - assignment.centres[full]
        axis = np.linalg.eigh(pixels.T @ pixels)[1][:, -1] if len(pixels) else np.zeros(2)
        centres = assignment.centres.copy()
        centres[empty], centres[full] = (assignment.centres[full] + side * self.radius * axis for side in (-0.7, 0.7))
        return centres


def _summed(labels: NDArray[np.int64], values: Array, count: int) -> Array:
    """Sum of values by label, those of label -1 left out."""
    return np.asarray(np.bincount(labels + 1, weights=values, minlength=count + 1)[1:], dtype=np.float64)
