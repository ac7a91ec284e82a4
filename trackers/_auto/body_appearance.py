"""Where a body may be in a frame, by all that tells it from the scene: its colours, its pattern, and that it moves.

Each of the three fails somewhere: colours before scenery of like colours, the pattern where the body turns or is
blurred, motion where it rests or others move. Each is scaled to what the body usually shows, so that their mean is 1 on
the body and small where only one of them is mistaken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from trackers._auto.appearance import Appearance, Peaks, at_and_around, learn, peaks_of, score_at
from trackers._auto.scene import Place
from trackers._frames.arrays import Bytes, Flags, Image

HALF_SIDE = 1.2  # radii: half the side of a patch, which shows the outline of the body
MIN_HALF = 4  # px of the search image
PATCHES = 2  # that are compared with each frame, from places spread over the clip
STRIP = 64  # rows of the search image that are compared with patches at once
MIN_SCORE = 0.35  # below it a place shows no more than one of the three
MIN_COLOUR = 0.1  # mean log ratio: what a body of no colour of its own shows at least
MIN_MOTION = 6.0  # grey levels: what a body that rests shows at least


@dataclass(frozen=True, eq=False, slots=True)
class BodyAppearance:
    """Colours of a body, patches (s, s) of its luma, the scene (h, w, 3) without it, and what it usually shows of each.

    All at the size of the search; ``usual_colour`` is a mean log ratio, ``usual_motion`` in grey levels.
    """

    colours: Appearance
    patches: tuple[Bytes, ...]
    still: Image
    usual_colour: float
    usual_motion: float

    @classmethod
    def learned(cls, images: Sequence[Bytes], places: Sequence[Place], radius: float, still: Image) -> BodyAppearance:
        """Those of a body of that radius, px, at places (x, y) in search images (h, w, 3); ``still`` is the scene."""
        colours, known = learn(images, places, radius), list(zip(images, places, strict=True))
        shown = [_patch(image, place, radius) for image, place in known]
        patches = [patch for patch in shown if patch is not None]
        chosen = np.unique(np.linspace(0, max(len(patches) - 1, 0), 2 * PATCHES + 1).astype(int)[1::2])
        colour = [score_at(colours.score_map(image), place) for image, place in known]
        motion = [score_at(_motion(image, still, radius), place) for image, place in known]
        return cls(
            colours,
            tuple(patches[k] for k in chosen[: len(patches)]),
            still,
            max(float(np.median(colour)), MIN_COLOUR),
            max(float(np.median(motion)), MIN_MOTION),
        )

    @property
    def radius(self) -> float:
        """Radius of the body, px of the search image."""
        return self.colours.radius

    def score_map(self, image: Bytes) -> Image:
        """How much each place of a search image (h, w, 3) shows the body, (h, w): the mean of three shares, 0 to 1."""
        colour = np.clip(self.colours.score_map(image) / self.usual_colour, 0.0, 1.0)
        motion = np.clip(_motion(image, self.still, self.radius) / self.usual_motion, 0.0, 1.0)
        if not self.patches:
            return np.asarray((colour + motion) / 2, dtype=np.float32)
        # elsewhere no pattern lifts the mean to the least score
        wanted = np.asarray(colour + motion > 3 * MIN_SCORE - 1)
        pattern = _pattern(np.ascontiguousarray(image[..., 0]), self.patches, wanted)
        return np.asarray((colour + motion + pattern) / 3, dtype=np.float32)

    def peaks(self, image: Bytes) -> Peaks:
        """The best places of a search image (h, w, 3), the best first."""
        return peaks_of(self.score_map(image), self.radius, MIN_SCORE)


def _patch(image: Bytes, place: Place, radius: float) -> Bytes | None:
    """The luma about a place; None where it does not lie in the image, or shows one grey level."""
    half, (x, y) = max(MIN_HALF, round(HALF_SIDE * radius)), (round(c) for c in place)
    height, width = image.shape[:2]
    if not (half <= x < width - half and half <= y < height - half):
        return None
    patch = np.ascontiguousarray(image[y - half : y + half + 1, x - half : x + half + 1, 0])
    return patch if int(np.ptp(patch)) > 0 else None


def _pattern(luma: Bytes, patches: Sequence[Bytes], wanted: Flags) -> Image:
    """The best normalised correlation (h, w) with patches at the pixels that are wanted, in strips of rows; 0 if none.

    Other pixels of a strip, from the first that is wanted to the last, have theirs as well.
    """
    score = np.zeros(luma.shape, np.float32)
    for top in range(0, len(luma), STRIP):
        columns = np.flatnonzero(wanted[top : top + STRIP].any(axis=0))
        if columns.size:
            part = (slice(top, top + STRIP), slice(int(columns[0]), int(columns[-1]) + 1))
            score[part] = np.max([_correlation(luma, patch, part) for patch in patches], axis=0)
    return score


def _correlation(luma: Bytes, patch: Bytes, part: tuple[slice, slice]) -> Image:
    """The normalised correlation with a patch centred on each pixel of a part, 0 where negative or not defined."""
    half = patch.shape[0] // 2
    rows, columns = (np.arange(size)[one] for size, one in zip(luma.shape, part, strict=True))
    score = np.zeros((rows.size, columns.size), np.float32)
    top, left = max(rows[0] - half, 0), max(columns[0] - half, 0)
    window = luma[top : rows[-1] + half + 1, left : columns[-1] + half + 1]
    if min(window.shape) < patch.shape[0]:
        return score
    inner = cv2.matchTemplate(np.ascontiguousarray(window), patch, cv2.TM_CCOEFF_NORMED)
    inner = np.where((inner > 0.0) & (inner <= 1.0 + 1e-6), inner, 0.0)  # an image of one grey level has none
    y, x = top + half - rows[0], left + half - columns[0]
    score[y : y + inner.shape[0], x : x + inner.shape[1]] = inner
    return score


def _motion(image: Bytes, still: Image, radius: float) -> Image:
    """By how much more each place differs from the scene than its surroundings do, grey levels (h, w)."""
    difference = cv2.absdiff(image.astype(np.float32), np.asarray(still, dtype=np.float32))
    inner, ring = at_and_around(np.asarray(cv2.transform(difference, np.ones((1, 3), np.float32))), radius)
    return inner - ring
