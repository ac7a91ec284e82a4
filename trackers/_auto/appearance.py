"""What a body looks like against the rest of the clip: a histogram of its luma and chroma, as likelihood ratios.

The ratio of the two histograms tells whether a pixel is rather of the body or of the scene [1]_. Its mean
over a disc of the body's size, less that of the surroundings, peaks where the body is.

.. [1] M. J. Swain and D. H. Ballard, Color indexing, International Journal of Computer Vision 7 (1991) 11-32.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Frame
from trackers._frames.arrays import Bytes, Flags, Image
from trackers._frames.working_image import WorkingView

LUMA_SHIFT, CHROMA_SHIFT = 4, 2  # bits: 16 steps of luma, 64 of each colour difference
SHAPE = (16, 64, 64)
SMOOTHING = (0.8, 1.0, 1.0)  # bins: lighting and compression shift a colour by about one
MAX_LOG_RATIO = 3.0  # of one pixel
FLOOR = 2e-5  # least probability of any colour: one that was never seen proves nothing
CORE = 0.75  # of the radius: pixels nearer to the outline are mixed
SURROUNDINGS = 2.2  # times the radius: half the side of the square round a body that is compared with it
SURROUND_WEIGHT = 0.6
MAX_PEAKS = 8  # a frame
MIN_SCORE = 0.15  # mean log ratio: fainter peaks are not considered


@dataclass(frozen=True, eq=False, slots=True)
class Peaks:
    """Where a body may be in one frame: centres (k, 2) in px of the search image, and scores (k,)."""

    xy: Array
    score: Array

    def where(self, kept: Flags) -> Peaks:
        """Those that are ``kept`` (k,)."""
        return Peaks(self.xy[kept], self.score[kept])


NOWHERE = Peaks(np.zeros((0, 2)), np.zeros(0))


@dataclass(frozen=True, eq=False, slots=True)
class Appearance:
    """Log likelihood ratio of body to scene by luma and chroma, and the body's radius in px of the search image."""

    log_ratio: Image
    radius: float

    def of_pixels(self, image: Bytes) -> Image:
        """Log likelihood ratio of each pixel (h, w) of a search image (h, w, 3)."""
        return np.take(self.log_ratio, _bins(image))

    def score_map(self, image: Bytes) -> Image:
        """How much the surroundings of each pixel look like the body, (h, w)."""
        inner, ring = at_and_around(self.of_pixels(image), self.radius)
        return np.asarray(inner - SURROUND_WEIGHT * np.maximum(ring, -1.0), dtype=np.float32)

    def peaks(self, image: Bytes, least: float = MIN_SCORE, most: int = MAX_PEAKS) -> Peaks:
        """The best places of a search image, the best first."""
        return peaks_of(self.score_map(image), self.radius, least, most)


def at_and_around(values: Image, radius: float) -> tuple[Image, Image]:
    """Means of values (h, w) over a body of that radius, px, centred on each pixel, and over what is about it."""
    side = max(3, 2 * round(0.8 * radius) + 1)
    wide = max(side + 4, 2 * round(SURROUNDINGS * radius) + 1)
    inner = cv2.blur(values, (side, side), borderType=cv2.BORDER_REPLICATE)
    outer = cv2.blur(values, (wide, wide), borderType=cv2.BORDER_REPLICATE)
    return inner, (outer * wide**2 - inner * side**2) / (wide**2 - side**2)


def peaks_of(score: Image, radius: float, least: float, most: int = MAX_PEAKS) -> Peaks:
    """The best places of scores (h, w) above the ``least``, a body of that radius, px, apart; the best first."""
    reach = max(3, 2 * round(0.8 * radius) + 1)
    top = cv2.dilate(score, np.ones((reach, reach), np.uint8))
    rows, columns = np.nonzero((score >= top) & (score > least))
    values = score[rows, columns]
    best = np.argsort(-values, kind="stable")[:most]
    return Peaks(np.column_stack([columns[best], rows[best]]).astype(np.float64), values[best].astype(np.float64))


def _bins(image: Bytes) -> NDArray[np.int32]:
    luma, red, blue = cv2.split(image)
    index: NDArray[np.int32] = (luma >> LUMA_SHIFT).astype(np.int32) << 12
    return index | ((red >> CHROMA_SHIFT).astype(np.int32) << 6) | (blue >> CHROMA_SHIFT)


def histogram(pixels: Bytes) -> Image:
    """Smoothed share of pixels (n, 3) in each bin of luma and chroma."""
    index = _bins(np.ascontiguousarray(pixels[np.newaxis]))[0]
    counts = np.bincount(index, minlength=int(np.prod(SHAPE))).reshape(SHAPE).astype(np.float32)
    for axis, sigma in enumerate(SMOOTHING):
        counts = np.moveaxis(_blurred(np.moveaxis(counts, axis, 0), sigma), 0, axis)
    return counts / max(1.0, float(counts.sum()))


def _blurred(counts: Image, sigma: float) -> Image:
    flat = np.ascontiguousarray(counts.reshape(counts.shape[0], -1))
    return np.asarray(cv2.GaussianBlur(flat, (1, 5), sigma, None, sigma, cv2.BORDER_REPLICATE)).reshape(counts.shape)


def learn(images: Sequence[Bytes], places: Sequence[tuple[float, float] | None], radius: float) -> Appearance:
    """The appearance of a body of that radius (px) whose place in some search images (h, w, 3) is known.

    ``places`` are centres in px; None where the body's place is not known: that image is left out.
    """
    inside: list[Bytes] = []
    outside: list[Bytes] = []
    for image, place in zip(images, places, strict=True):
        if place is None:
            continue
        body, near = _parts(image.shape[:2], place, radius)
        inside.append(image[body])
        scene = image[~near]
        outside.append(scene[:: max(1, len(scene) // 20_000)])
        ring = near & ~_parts(image.shape[:2], place, 1.3 * radius / CORE)[0]
        outside += [image[ring]] * 2  # what the body moves before counts more than what is far off
    ratio = np.log((histogram(np.concatenate(inside)) + FLOOR) / (histogram(np.concatenate(outside)) + FLOOR))
    return Appearance(np.clip(ratio, -MAX_LOG_RATIO, MAX_LOG_RATIO).astype(np.float32).ravel(), radius)


def _parts(shape: tuple[int, ...], place: tuple[float, float], radius: float) -> tuple[Flags, Flags]:
    """Pixels well inside of a body, and those within twice its radius."""
    y, x = np.ogrid[: shape[0], : shape[1]]
    distance = (x - place[0]) ** 2 + (y - place[1]) ** 2
    return np.asarray(distance <= max(1.0, (CORE * radius) ** 2)), np.asarray(distance <= (2 * radius + 2) ** 2)


def search_image(view: WorkingView, frame: Frame) -> Bytes:
    """The image in which bodies are searched by appearance: luma and chroma at the size of the search."""
    return view.with_chroma().search_image(frame)


def score_at(score_map: Image, place: tuple[float, float]) -> float:
    """The best score (h, w) at a place (x, y) px, or next to it."""
    y, x = (min(max(round(c), 0), size - 1) for c, size in zip(place[::-1], score_map.shape, strict=True))
    return float(score_map[max(0, y - 1) : y + 2, max(0, x - 1) : x + 2].max())
