"""A body known from its places in the samples: where else it is clearly visible."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.types import Track
from trackers._auto.appearance import Peaks
from trackers._auto.body_appearance import BodyAppearance
from trackers._auto.scene import Place, SampledScene
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes, Image

MIN_RADIUS = 1.5  # px of the search image
ABOUT = 3.0  # radii: a place this near shows a part of the body
MIN_ELSEWHERE = 5  # samples with the body elsewhere, that tell what a place looks like without it
MIN_SCORE = 0.5  # a place with less looks like something else rather than like the body
CLEAR = 0.75  # of what the body usually shows, at a place that the samples do not show without it


@dataclass(frozen=True, eq=False, slots=True)
class KnownBody:
    """Appearance of a tracked body, and the score (h, w) above which each place of a search image clearly shows it."""

    appearance: BodyAppearance
    least: Image

    @classmethod
    def learned(
        cls, scene: SampledScene, places: Mapping[int, Place], radius: float, others: Collection[Track] = ()
    ) -> KnownBody:
        """The body of that radius at places (x, y) in the samples, by their number, all in px of the search image.

        A place clearly shows the body where it looks more like it than it does in any sample with the body elsewhere:
        the chance of that is less than one in their number. ``others`` are the tracks of other bodies, which may look
        like this one.
        """
        images, radius = {k: scene.images[k] for k in places}, max(MIN_RADIUS, radius)
        appearance = BodyAppearance.learned(list(images.values()), list(places.values()), radius, scene.still)
        taken = [places, *(scene.places(other) for other in others)]
        side = 2 * round(radius) + 1
        chance, count = np.zeros(scene.still.shape[:2], np.float32), np.zeros(scene.still.shape[:2], np.uint16)
        for k, score in zip(images, ahead(appearance.score_map, images.values()), strict=True):
            free = np.ones(chance.shape, np.uint8)
            for x, y in [known[k] for known in taken if k in known]:
                cv2.circle(free, (round(x), round(y)), round(ABOUT * radius), 0, -1)
            about = cv2.dilate(score * free, np.ones((side, side), np.uint8))
            chance, count = np.maximum(chance, about), count + free
        return cls(appearance, np.where(count < MIN_ELSEWHERE, CLEAR, np.maximum(chance, MIN_SCORE)))

    def clearly_in(self, image: Bytes) -> Peaks:
        """The places of a search image (h, w, 3) that clearly show the body, the best first."""
        peaks = self.appearance.peaks(image)
        columns, rows = peaks.xy.astype(int).T
        return peaks.where(peaks.score > self.least[rows, columns])
