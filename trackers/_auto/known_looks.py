"""A body known from its places in the samples: where else it is clearly visible, and which places are scenery."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from trackers._auto.appearance import MIN_SCORE, NOWHERE, Appearance, Peaks, learn, score_at
from trackers._auto.scene import Place
from trackers._frames.arrays import Bytes, Image

SCENERY = 0.5  # share of the samples with the body elsewhere: a place that looks like it there too is scenery
MIN_ELSEWHERE = 5  # samples with the body elsewhere, that tell what a place looks like without it
PLAIN = 0.75  # of the usual score of the body: chance rarely reaches it


@dataclass(frozen=True, eq=False, slots=True)
class KnownLooks:
    """Appearance of a tracked body, the smallest score of a place that clearly shows it, and its places in the samples.

    ``maps`` are the scores (h, w) of the search images, ``places`` where the body is in them, by the sample's number.
    """

    looks: Appearance
    plain: float
    maps: Mapping[int, Image]
    places: Mapping[int, Place]

    def plainly_in(self, image: Bytes) -> Peaks:
        """The places of a search image (h, w, 3) that clearly show the body and not scenery, the best first."""
        peaks = self.looks.peaks(image, self.plain)
        at = [(float(x), float(y)) for x, y in peaks.xy]
        kept = [not is_scenery(self.maps, self.places, place, self.looks.radius, self.plain) for place in at]
        return peaks.where(np.array(kept, np.bool_))

    def expected_in(self, image: Bytes, place: Place, reach: float) -> Peaks:
        """The best place of a search image (h, w, 3) within ``reach`` px of where the body is expected, or none.

        It must look more like the body than anything there does in the samples in which the body is elsewhere: the
        chance of that is less than one in their number, in a window however large.
        """
        rows, columns = np.ogrid[: image.shape[0], : image.shape[1]]
        window = np.hypot(columns - place[0], rows - place[1]) <= reach
        away = {k: np.hypot(*np.subtract(at, place)) > reach + 2 * self.looks.radius for k, at in self.places.items()}
        chance = [float(self.maps[k][window].max()) for k, is_away in away.items() if is_away and window.any()]
        if len(chance) < MIN_ELSEWHERE:
            return NOWHERE
        score = np.where(window, self.looks.score_map(image), -np.inf)
        y, x = np.unravel_index(int(np.argmax(score)), score.shape)
        seen = Peaks(np.array([[x, y]], dtype=np.float64), np.array([float(score[y, x])]))
        return seen.where(seen.score > max(*chance, MIN_SCORE))


def known_looks(images: Sequence[Bytes], places: Mapping[int, Place], radius: float) -> KnownLooks:
    """The appearance of a body of that radius, from its places (x, y) in some sampled search images, all in px."""
    shown = {k: images[k] for k in places}
    looks = learn(list(shown.values()), list(places.values()), max(1.5, radius))
    maps = {k: looks.score_map(image) for k, image in shown.items()}
    plain = PLAIN * float(np.median([score_at(maps[k], place) for k, place in places.items()]))
    return KnownLooks(looks, plain, maps, places)


def is_scenery(
    maps: Mapping[int, Image], places: Mapping[int, Place], place: Place, reach: float, plain: float
) -> bool:
    """Whether a place looks like the body also in most of the samples in which the body is elsewhere.

    Parameters
    ----------
    maps
        Scores (h, w) of samples that show the body, by their number.
    places
        Where it is in them, px of the search image.
    place
        The place in question, likewise.
    reach
        Radius of the body, px.
    plain
        Smallest score of a place that looks like the body.
    """
    away = [k for k, body in places.items() if np.hypot(body[0] - place[0], body[1] - place[1]) > 3 * reach]
    return bool(away) and bool(np.mean([score_at(maps[k], place) > plain for k in away]) > SCENERY)
