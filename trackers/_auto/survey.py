"""What moves in a clip, from sampled frames: compact objects by colour and size, and how often they are seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import repeat

import cv2
import numpy as np

from iris_sysid.types import Array
from trackers._background.median import BackgroundEstimate, estimate_again, estimate_background, with_unseen
from trackers._detection.background_samples import usable_samples
from trackers._detection.foreground import Blob, background_range_of, blobs
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes, Flags, Image

MIN_INSCRIBED = 2.0  # px, inscribed radius at the size of the search
ALIKE = 16.0  # grey levels, luma counting a third: colours of one kind of object
ALIKE_SIZE = 2.0  # times: sizes of one kind of object
WEIGHTS = np.array([0.35, 1.0, 1.0])  # of luma, red and blue in a difference of colours: light changes the luma
MIN_CONTRAST = 5.0  # grey levels, of colour and luma together
SHADOW_RANGE = (0.3, 0.97)  # of the light that remains in a shadow
SHADOW_CHROMA = 3.5  # grey levels: largest difference of a shadow's chroma from that of the wall in less light
SEEN_OFTEN = 0.2  # of the samples
MAX_RADIUS = 0.3  # of the smaller side of the image: the radius of a body
MAX_KINDS = 4


@dataclass(frozen=True, slots=True)
class SampledObject:
    """A compact object in one sampled frame: centre and radius in px of the search image, colours (luma, red, blue).

    ``around`` is the colour just outside of it; ``roundness`` is 1 for a disc, ``inscribed`` the inscribed radius.
    """

    sample: int
    x: float
    y: float
    radius: float
    colour: tuple[float, float, float]
    around: tuple[float, float, float]
    roundness: float
    inscribed: float

    @property
    def contrast(self) -> float:
        """Difference in colour from what is just outside, grey levels."""
        return colour_distance(np.array(self.colour), np.array(self.around))

    @property
    def shadow_like(self) -> bool:
        """Whether it looks like its surroundings in less light."""
        return looks_like_shadow(np.array(self.colour), np.array(self.around))


@dataclass(eq=False)
class ObjectClass:
    """Objects of one colour and size that were seen in the samples."""

    seen: list[SampledObject] = field(default_factory=list)

    def typical(self, name: str) -> Array:
        """Median of a property."""
        return np.asarray(np.median([getattr(sighting, name) for sighting in self.seen], axis=0))

    @property
    def samples(self) -> set[int]:
        """The samples in which it is seen."""
        return {sighting.sample for sighting in self.seen}

    @property
    def salience(self) -> float:
        """How much it is like a body that is meant: seen often, distinct in colour, round, going far; no shadow."""
        travel = float(np.hypot(*np.ptp([(sighting.x, sighting.y) for sighting in self.seen], axis=0)))
        radius = float(self.typical("radius"))
        shadow = 0.1 if bool(np.mean([sighting.shadow_like for sighting in self.seen]) > 0.5) else 1.0
        going = min(1.0, travel / (3 * radius))
        distinct = min(float(self.typical("contrast")), 60.0)
        return len(self.samples) * distinct * float(self.typical("roundness")) ** 2 * going * shadow


def colour_distance(colour: Array, other: Array) -> float:
    """Distance, grey levels, of two colours (3,), luma, red and blue: luma counts a third."""
    return float(np.linalg.norm((colour - other) * WEIGHTS))


def looks_like_shadow(colour: Array, around: Array) -> bool:
    """Whether a colour is that of its surroundings in less light: chroma fades with the light [1]_.

    .. [1] A. Prati, I. Mikic, M. M. Trivedi and R. Cucchiara, Detecting moving shadows, IEEE Transactions on Pattern
       Analysis and Machine Intelligence 25 (2003) 918-923.
    """
    light = float(colour[0] / max(around[0], 1.0))
    if not SHADOW_RANGE[0] <= light <= SHADOW_RANGE[1]:
        return False
    return bool(np.all(np.abs((colour[1:] - 128) - light * (around[1:] - 128)) < SHADOW_CHROMA))


def kinds_of(images: Sequence[Bytes], still: Image, foregrounds: Sequence[Sequence[Blob]]) -> list[ObjectClass]:
    """The kinds of objects that move in sampled search images (h, w, 3), the likeliest body first.

    Parameters
    ----------
    images
        The samples.
    still, foregrounds
        Their background, and what differs from it in each, from :func:`foregrounds_of`.
    """
    kinds: list[ObjectClass] = []
    for number, (image, foreground) in enumerate(zip(images, foregrounds, strict=True)):
        covered = np.zeros(image.shape[:2], np.uint8)
        for blob in foreground:
            left, top, right, bottom = blob.box
            covered[top:bottom, left:right] |= blob.mask
        for blob in foreground:
            sighting = _seen(number, blob, image, still, covered)
            if sighting is not None:
                _sort_in(kinds, sighting)
    often = [kind for kind in kinds if len(kind.samples) >= max(3, SEEN_OFTEN * len(images))]
    return sorted(often, key=lambda kind: -kind.salience)[:MAX_KINDS]


def foregrounds_of(
    images: Sequence[Bytes], known: BackgroundEstimate | None = None, colours: Sequence[Flags | None] | None = None
) -> tuple[Image, list[list[Blob]]]:
    """The still background (h, w, 3) of sampled search images (h, w, 3), and what differs from it in each of them.

    A body that rests in most of them differs too: the others show the scenery behind it. The background is the
    ``known`` one of these images if there is one of their size. ``colours`` are the pixels (h, w) of each image that
    have the colour of the body, where one was stated: nothing else counts.
    """
    if known is None or known.background.shape != images[0].shape:
        known = _still_background(np.stack(images))
    background_range = background_range_of(known)
    # light that flickers or adapts moves the whole image: the middle difference is not motion
    levelled = (_levelled(image, known.background) for image in images)
    pairs = zip(levelled, repeat(None) if colours is None else colours, strict=False)
    return known.background, list(ahead(lambda pair: blobs(background_range, *pair), pairs))


def _still_background(stack: Bytes) -> BackgroundEstimate:
    estimate = estimate_background(stack)
    usable, unseen, _ = usable_samples(stack, estimate)
    return with_unseen(estimate if usable is None else estimate_again(stack, estimate, None, usable), unseen)


def blob_at(foreground: Sequence[Blob], place: tuple[float, float]) -> Blob | None:
    """What differs from the background at a place (x, y), px of the search image."""
    x, y = (round(c) for c in place)
    for blob in foreground:
        left, top, right, bottom = blob.box
        if left <= x < right and top <= y < bottom and blob.mask[y - top, x - left]:
            return blob
    return None


def any_near(foreground: Sequence[Blob], place: tuple[float, float], reach: float) -> bool:
    """Whether anything differs from the background within ``reach`` of a place (x, y), px of the search image."""
    for blob in foreground:
        left, top, right, bottom = blob.box
        if left - reach < place[0] < right + reach and top - reach < place[1] < bottom + reach:
            rows, columns = np.nonzero(blob.mask)
            if np.any(np.hypot(columns + left - place[0], rows + top - place[1]) < reach):
                return True
    return False


def _levelled(image: Bytes, still: Image) -> Bytes:
    """The image with the exposure of the background."""
    luma, known = image[::4, ::4, 0].astype(np.float32), still[::4, ::4, 0]
    gain = float(np.median((known + 1) / (luma + 1)))
    if abs(gain - 1) < 0.01:
        return image
    levelled = image.copy()
    levelled[..., 0] = np.clip(np.rint(image[..., 0] * np.float32(gain)), 0, 255).astype(np.uint8)
    return levelled


def _seen(number: int, blob: Blob, image: Bytes, still: Image, covered: Bytes) -> SampledObject | None:
    """A blob as an object that is there; not the place that a body has left, where the background still shows it.

    None where it is too thin, too large, at the edge, or no different from its surroundings.
    """
    largest = MAX_RADIUS * min(image.shape[:2])
    if blob.at_edge or blob.held or blob.inscribed < MIN_INSCRIBED or np.sqrt(blob.area / np.pi) > largest:
        return None
    left, top, right, bottom = blob.box
    reach = max(4, round(0.6 * blob.inscribed))
    window = (slice(max(0, top - reach), bottom + reach), slice(max(0, left - reach), right + reach))
    inside = np.zeros(covered.shape, np.uint8)[window]
    y, x = top - window[0].start, left - window[1].start
    inside[y : y + bottom - top, x : x + right - left] = blob.mask
    ring = covered[window] == 0
    heart = cv2.distanceTransform(cv2.copyMakeBorder(inside, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0), cv2.DIST_L2, 3)
    deep = heart[1:-1, 1:-1] > 0.4 * heart.max()
    if np.count_nonzero(ring) < 8 or not deep.any():
        return None
    around, colour = _middle(image[window], ring), _middle(image[window], deep)
    before = _middle(still[window], deep)
    if colour_distance(before, around) > 1.5 * colour_distance(colour, around):
        return None  # it was here, at rest, and is seen nowhere in this blob
    rows, columns = np.nonzero(inside)
    sighting = SampledObject(
        number,
        float(columns.mean() + window[1].start),
        float(rows.mean() + window[0].start),
        float(np.sqrt(blob.area / np.pi)),
        (float(colour[0]), float(colour[1]), float(colour[2])),
        (float(around[0]), float(around[1]), float(around[2])),
        float(min(1.0, np.pi * blob.inscribed**2 / blob.area)),
        float(blob.inscribed),
    )
    return sighting if sighting.contrast > MIN_CONTRAST else None


def _middle(image: Bytes | Image, where: Flags) -> Array:
    return np.median(image[where].astype(np.float64), axis=0)


def _sort_in(kinds: list[ObjectClass], sighting: SampledObject) -> None:
    """Add an object to the kind that it is most like, or begin a new one."""
    best, nearest = None, ALIKE
    for kind in kinds:
        ratio = sighting.radius / float(kind.typical("radius"))
        apart = colour_distance(np.array(sighting.colour), kind.typical("colour"))
        if apart < nearest and 1 / ALIKE_SIZE < ratio < ALIKE_SIZE:
            best, nearest = kind, apart
    if best is None:
        kinds.append(best := ObjectClass())
    best.seen.append(sighting)
