"""The size of a body that a mark shows: by its motion where it moves, else by its colour."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from iris_sysid.types import Array
from trackers._auto.scene import Place
from trackers._auto.survey import WEIGHTS
from trackers._frames.arrays import Bytes

MAX_RADIUS = 0.25  # of the smaller side of the image
MIN_RADIUS = 2.0  # px of the search image
DISTINCT = (2.0, 2.0)  # times what is usual about it, and grey levels: a smaller difference is none of the body
CLICKED = 2.0  # px of the search image: pixels round a click that are surely of the body
GROWTH = 1.12  # ratio of the radii that are tried


def size_at(image: Bytes, place: Place, samples: Sequence[Bytes]) -> float:
    """Radius in px of the object at a place of a search image (h, w, 3), by where it differs from most ``samples``.

    Its region is where the difference is more than half of that at the place; of a long one the radius is the mean of
    that of its area and the inscribed one. Where the body rests in most samples, its colour tells its size.
    """
    reach = int(MAX_RADIUS * min(image.shape[:2]))
    y, x = (min(max(round(c), 0), size - 1) for c, size in zip(place[::-1], image.shape, strict=False))
    left, top = max(0, x - reach), max(0, y - reach)
    window = (slice(top, y + reach + 1), slice(left, x + reach + 1))
    here = image[window].astype(np.float32)
    apart = [cv2.blur(np.linalg.norm(here - sample[window], axis=2), (3, 3)) for sample in samples]
    difference = np.median(apart, axis=0)
    usual, at = float(np.median(difference)), (y - top, x - left)
    if difference[at] < DISTINCT[0] * usual + DISTINCT[1]:
        return radius_by_colour(image, place)
    _, labels = cv2.connectedComponents((difference > (usual + difference[at]) / 2).astype(np.uint8), connectivity=4)
    region = (labels == labels[at]).astype(np.uint8)
    framed = cv2.copyMakeBorder(region, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    inscribed = float(cv2.distanceTransform(framed, cv2.DIST_L2, 5).max())
    return max(MIN_RADIUS, float(np.sqrt(np.sqrt(np.count_nonzero(region) / np.pi) * inscribed)))


def radius_by_colour(image: Bytes, place: tuple[float, float]) -> float:
    """The same by colour alone: where it changes most."""
    rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
    distance: Array = np.hypot(columns - place[0], rows - place[1])
    largest = MAX_RADIUS * min(image.shape[:2])
    near = distance <= 2 * largest
    colours, away = image[near].astype(np.float64), distance[near]
    colour = np.median(colours[away <= CLICKED], axis=0)
    off = np.linalg.norm((colours - colour) * WEIGHTS, axis=1)
    best, radius = -np.inf, 3.0
    tried = MIN_RADIUS
    while tried <= largest:
        step = _mean(off[(away > tried) & (away <= 1.4 * tried + 1)]) - _mean(off[away <= tried])
        if step > best:
            best, radius = step, tried
        tried *= GROWTH
    return radius


def _mean(values: Array) -> float:
    return float(values.mean()) if values.size else 0.0
