"""Assignment of covered pixels to bodies by k-means: touching bodies of one class part at the middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array
from trackers._detection.foreground import BackgroundRange
from trackers._detection.strong_windows import grown, merged
from trackers._frames.arrays import Box, Bytes, Image
from trackers._multi_body.appearance_classes import HALF_COVERED, AppearanceClass, class_coverages

MIN_COVERAGE = 0.25  # of a pixel: less is noise, shade or the blurred outline
REACH = 1.6  # radii: a pixel farther from every body is of none
NEAR = 3  # px about a part: what is adjacent to it, and one more
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
    size = (image.shape[1], image.shape[0])
    rows, columns = np.nonzero(background_range.weakly(image))
    shares = np.zeros((len(classes), len(rows)), dtype=np.float32)
    if len(rows):
        shown, behind = image[rows, columns].astype(np.float32), background[rows, columns]
        for share, coverage, appearance in zip(shares, class_coverages(classes, shown, behind), classes, strict=True):
            covered = np.zeros(image.shape[:2], dtype=np.uint8)
            covered[rows, columns] = coverage > HALF_COVERED
            share[:] = coverage * _thick(covered, appearance.radius)[rows, columns]
    most = shares.max(axis=0)
    chosen = most > MIN_COVERAGE
    xy = np.stack([columns[chosen], rows[chosen]], axis=-1).astype(np.int16)
    class_index = shares[:, chosen].argmax(axis=0).astype(np.int8)
    return CoveredPixels(frame, t_s, xy, most[chosen].astype(np.float16), class_index, size)


def _thick(covered: Bytes, radius: float) -> Bytes:
    """1 where the covered region (h, w) is as thick as a body, or adjacent to that; removes cords and specks."""
    side = 2 * max(1, int(THIN * radius)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    thick = np.zeros_like(covered)
    for left, top, right, bottom in _boxes_about(covered, side):
        window = slice(top, bottom), slice(left, right)
        part = cv2.copyMakeBorder(covered[window], side, side, side, side, cv2.BORDER_REPLICATE)
        opened = cv2.dilate(cv2.morphologyEx(part, cv2.MORPH_OPEN, disc), np.ones((5, 5), np.uint8))
        thick[window] = opened[side:-side, side:-side]
    return thick


def _boxes_about(covered: Bytes, side: int) -> list[Box]:
    """Boxes about the parts of a mask that are at least ``side`` px wide and high, or at its edge; the others go."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(covered, connectivity=8)
    size = (covered.shape[1], covered.shape[0])
    parts = [(int(x), int(y), int(x + width), int(y + height)) for x, y, width, height, _ in stats]
    kept = [
        number
        for number, (x0, y0, x1, y1) in enumerate(parts[:count])
        if number and (min(x1 - x0, y1 - y0) >= side or x0 == 0 or y0 == 0 or x1 == size[0] or y1 == size[1])
    ]
    is_kept = np.zeros(count, dtype=np.uint8)
    is_kept[kept] = 1
    covered[:] = is_kept[labels]
    return merged(grown(parts[number], NEAR, size) for number in kept)


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
