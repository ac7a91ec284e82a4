"""Appearance classes: bodies of one colour and size, and how many there are of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array
from trackers._detection.detect_frames import DetectionSetup
from trackers._detection.foreground import (
    SQUARE,
    BackgroundRange,
    Blob,
    blobs,
    components,
    rounded,
)
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes, Flags, Image

SOLID = 0.88  # of its convex hull: a blob that fills less of it is several bodies, or a hand
ROUND = 0.4  # of its area lies within the inscribed circle: less is a cord
MIN_INSCRIBED = 2.0  # px, inscribed radius of the smallest blob with a reliable colour
SAME_COLOUR = 0.3  # of the contrast: colours nearer than this are of one class
MIN_CONTRAST_SHARE = 0.3  # of the strongest contrast: fainter pixels are shade
HALF_COVERED = 0.5
OFF_COLOUR = 0.5  # of the contrast: a pixel farther off the line from background to body is something else
COUNT_PERCENTILE = 95  # percentile over the samples: in the others bodies are hidden or have left
RING = 4  # px round a part in which its surroundings are seen
LIKE = 0.35  # of the contrast: a pixel nearer than this to a body's colour shows it, whatever the background is
MIN_SAMPLES = 3  # that must show the background
MIN_AREA_SHARE = 0.2  # of the area of the largest class: a smaller class consists of parts of bodies
MIN_DETECTIONS = 4  # detections of a class
MAX_COLOURED = 1.5  # times the area of all bodies of a class: more of its colour is background, or a hand
INPAINT_RADIUS = 5  # px round the never visible background from which it is continued
MOVED = 1.0  # px between two samples: an object that moves less stands still and is counted once
SIZE_SPREAD = 0.08  # standard deviation of the log area of one body as it turns


@dataclass(frozen=True, eq=False, slots=True)
class AppearanceClass:
    """Bodies that look alike: colour (channels,), area in px at the size of the search, and their number."""

    colour: Image
    area: float
    count: int = 1

    @property
    def radius(self) -> float:
        """Radius of the disc of the same area, px at the size of the search."""
        return float(np.sqrt(self.area / np.pi))

    def coverage(self, image: Image, background: Image) -> Image:
        """Share of each pixel (..., channels) that such a body covers; 0 where something else is seen.

        With F the body's colour and B the background, a pixel I = a F + (1 - a) B has
        a = (I - B).(F - B) / |F - B|^2; a colour far off that line is not such a body.
        """
        contrast = self.colour - background
        squared = np.maximum((contrast**2).sum(axis=-1), 1.0)
        difference = image - background
        share = (difference * contrast).sum(axis=-1) / squared
        off = ((difference - share[..., np.newaxis] * contrast) ** 2).sum(axis=-1)
        return np.where(off < OFF_COLOUR**2 * squared, np.clip(share, 0.0, 1.0), 0.0).astype(np.float32)


@dataclass(frozen=True, slots=True)
class _IsolatedPart:
    """A compact part of one sample: position and area in px, colour, contrast in grey levels."""

    x: float
    y: float
    area: float
    colour: tuple[float, ...]
    contrast: float


def learn_classes(setup: DetectionSetup, count: int) -> tuple[DetectionSetup, list[AppearanceClass]]:
    """The classes of ``count`` bodies, and the setup with the background seen where none of them is.

    Parameters
    ----------
    setup
        SampledFrames of the clip, and a background in which bodies may be that rested for long.
    count
        How many bodies there are.

    Raises
    ------
    TrackingError
        When the samples do not show ``count`` bodies.
    """
    images = [np.atleast_3d(image) for image in setup.search_images]
    background = background_level(setup.background_range)
    known = _classes_by_colour([part for image in images for part in _isolated_parts(setup, image, background)])[:count]
    free = _free(images, known, background, count)
    unseen = free.sum(axis=0) < MIN_SAMPLES
    setup = setup.with_background_from(free | unseen)
    if unseen.any():
        setup = _filled_in(setup, free | unseen, unseen)
    return setup, _classes_of(setup, images, count)


def _free(images: Sequence[Bytes], classes: Sequence[AppearanceClass], background: Image, count: int) -> Flags:
    """Where (k, h, w) the samples show none of the bodies, judged by colour alone.

    A class of whose colour there is more than the bodies could cover is background, or a hand.
    """
    free = np.ones((len(images), *background.shape[:2]), dtype=np.bool_)
    for appearance in classes:
        limit = LIKE * float(np.median(np.linalg.norm(background - appearance.colour, axis=-1)))
        like = np.stack(list(ahead(partial(_is_near, appearance.colour, limit), images)))
        if like.sum(axis=(1, 2)).mean() < MAX_COLOURED * count * appearance.area:
            free &= np.stack([cv2.dilate(pixels.astype(np.uint8), SQUARE, iterations=2) == 0 for pixels in like])
    return free


def _is_near(colour: Image, limit: float, image: Bytes) -> Flags:
    """Where (h, w) an image is nearer to a colour than that, grey levels."""
    planes = (
        image[..., channel] - level for channel, level in enumerate(colour)
    )  # faster than a norm over the last axis
    return np.asarray(sum(plane * plane for plane in planes) < limit**2)


def _filled_in(setup: DetectionSetup, usable: Flags, unseen: Flags) -> DetectionSetup:
    """The setup with the never visible background (h, w) continued from its surroundings.

    The method is that of A. Telea, J. Graphics Tools 9 (2004) 23. ``usable`` (k, h, w) says which samples show the
    background.
    """
    guess = cv2.inpaint(
        rounded(background_level(setup.background_range)), unseen.astype(np.uint8), INPAINT_RADIUS, cv2.INPAINT_TELEA
    )
    filled = np.full(setup.search_images.shape[1:], np.nan, dtype=np.float32)
    filled[unseen] = guess.reshape(filled.shape)[unseen]
    return replace(setup, unseen=filled).with_background_from(usable)


def _classes_of(setup: DetectionSetup, images: Sequence[Bytes], count: int) -> list[AppearanceClass]:
    """The classes of ``count`` bodies from samples before a background without them.

    Parts that stand alone tell colour and size, those first whose contrast and area are greatest; how much of a
    colour there is over the area of one body is the number of such bodies.
    """
    background = background_level(setup.background_range)
    parts = [part for image in images for part in _isolated_parts(setup, image, background)]
    inner = [_inner(setup.background_range, image) for image in images]
    classes: list[AppearanceClass] = []
    amounts_found: list[float] = []
    for appearance in _classes_by_colour(parts):
        amounts = [_covered(appearance, classes, *pixels, background) / appearance.area for pixels in inner]
        number = float(np.percentile(amounts, COUNT_PERCENTILE))
        if number > HALF_COVERED and (
            not classes or appearance.area > MIN_AREA_SHARE * max(known.area for known in classes)
        ):
            classes.append(appearance)
            amounts_found.append(number)
    classes, amounts_found = classes[:count], amounts_found[:count]
    numbers = _rounded(np.array(amounts_found), count)
    if numbers.sum() < count:
        raise TrackingError(
            f"{count} bodies were requested, but the moving area is enough for {int(numbers.sum())}; request fewer, "
            f"restrict the region with --roi or the bodies with --colour, or begin with --start when they are struck: "
            f"bodies that rest in a pile for most of a clip hide the background"
        )
    return [
        replace(appearance, count=int(number)) for appearance, number in zip(classes, numbers, strict=True) if number
    ]


def background_level(background_range: BackgroundRange) -> Image:
    """The background (h, w, channels) at the size of the search, grey levels: the middle of what it shows."""
    return np.atleast_3d((background_range.lowest.astype(np.float32) + background_range.highest) / 2)


def class_coverages(classes: Sequence[AppearanceClass], image: Image, background: Image) -> list[Image]:
    """Coverage by each class, each pixel given to the class whose colour is nearest.

    Images are (h, w, channels), coverages (h, w), dimensionless.
    """
    nearest = np.stack([((image - appearance.colour) ** 2).sum(axis=-1) for appearance in classes]).argmin(axis=0)
    return [np.where(nearest == k, appearance.coverage(image, background), 0.0) for k, appearance in enumerate(classes)]


def _inner(background_range: BackgroundRange, image: Bytes) -> tuple[Image, Bytes]:
    """An image, and where (h, w) it differs from the background by something that does not reach the edge."""
    height, width = image.shape[:2]
    where = np.zeros((height, width), dtype=np.uint8)
    for component in components(background_range, image):
        rows, columns = component.mask.shape
        if (
            component.left > 1
            and component.top > 1
            and component.left + columns < width - 1
            and component.top + rows < height - 1
        ):
            where[component.top : component.top + rows, component.left : component.left + columns] |= component.mask
    return image.astype(np.float32), where


def _covered(
    appearance: AppearanceClass, others: Sequence[AppearanceClass], image: Image, where: Bytes, background: Image
) -> float:
    """Area in px that bodies of a class cover, without pixels more similar to other classes."""
    chosen = where > 0
    return float(class_coverages([appearance, *others], image[chosen], background[chosen])[0].sum())


def _isolated_parts(setup: DetectionSetup, image: Bytes, background: Image) -> Iterator[_IsolatedPart]:
    """The solid parts of one sample that do not reach in from the edge."""
    for blob in blobs(setup.background_range, image):
        if blob.held or blob.at_edge or blob.inscribed < MIN_INSCRIBED or not _solid(blob):
            continue
        left, top, right, bottom = blob.box
        heart = cv2.erode(blob.mask, SQUARE, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
        if heart.any():
            window = (slice(top, bottom), slice(left, right))
            window_image, estimate = image[window].astype(np.float32), background[window]
            colour = np.median(window_image[heart], axis=0)
            contrast = min(
                float(np.linalg.norm(colour - surrounding))
                for surrounding in (estimate[heart].mean(axis=0), _around(image, blob))
            )
            area = float(
                AppearanceClass(colour, float(blob.area)).coverage(window_image, estimate)[blob.mask > 0].sum()
            )
            yield _IsolatedPart((left + right) / 2, (top + bottom) / 2, area, tuple(map(float, colour)), contrast)


def _around(image: Bytes, blob: Blob) -> Image:
    """Colour just outside of a part: where the background shows a body that has gone, it is the part's own."""
    left, top, right, bottom = blob.box
    window = image[max(0, top - RING) : bottom + RING, max(0, left - RING) : right + RING]
    inside = np.zeros(window.shape[:2], dtype=np.uint8)
    row, column = top - max(0, top - RING), left - max(0, left - RING)
    inside[row : row + bottom - top, column : column + right - left] = blob.mask
    near = cv2.dilate(inside, np.ones((2 * RING + 1, 2 * RING + 1), np.uint8))
    near -= cv2.dilate(inside, SQUARE)
    return np.asarray(np.median(window[near > 0], axis=0), dtype=np.float32)


def _solid(blob: Blob) -> bool:
    """Whether a part is convex and not long."""
    contours, _ = cv2.findContours(blob.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.fillConvexPoly(np.zeros_like(blob.mask), cv2.convexHull(np.concatenate(contours)), 1)
    return bool(blob.area > SOLID * np.count_nonzero(hull) and np.pi * blob.inscribed**2 > ROUND * blob.area)


def _classes_by_colour(parts: Sequence[_IsolatedPart]) -> list[AppearanceClass]:
    """Kinds by colour, those first that show most; the area is the commonest of those that stood alone."""
    groups: list[list[_IsolatedPart]] = []
    for part in sorted(parts, key=lambda shown: -shown.contrast * shown.area):
        alike = [
            group
            for group in groups
            if np.linalg.norm(np.subtract(part.colour, group[0].colour)) < SAME_COLOUR * group[0].contrast
        ]
        if not alike:
            groups.append([part])
        elif not any(np.hypot(part.x - other.x, part.y - other.y) < MOVED for other in alike[0]):
            alike[0].append(part)
    strongest = max((part.contrast for part in parts), default=0.0)
    groups = [
        group for group in groups if len(group) >= MIN_DETECTIONS and group[0].contrast > MIN_CONTRAST_SHARE * strongest
    ]
    groups.sort(key=lambda group: -sum(part.contrast * part.area for part in group))
    return [_class_of(group) for group in groups]


def _class_of(group: Sequence[_IsolatedPart]) -> AppearanceClass:
    """The class of some parts of one colour: the area is the mode of their log areas, fragments counting less."""
    areas = np.array([part.area for part in group])
    apart = np.log(areas)[:, np.newaxis] - np.log(areas)
    density = (np.sqrt(areas) * np.exp(-(apart**2) / (2 * SIZE_SPREAD**2))).sum(axis=1)
    typical = [part for part in group if abs(np.log(part.area / areas[np.argmax(density)])) < 2 * SIZE_SPREAD]
    colour = np.median([part.colour for part in typical], axis=0).astype(np.float32)
    return AppearanceClass(colour, float(np.median([part.area for part in typical])))


def _rounded(amounts: Array, count: int) -> NDArray[np.int64]:
    """Whole numbers near ``amounts`` that add up to ``count``, or to as many as there may be."""
    numbers = np.maximum(np.rint(amounts), 1).astype(np.int64)
    while numbers.sum() > count and np.any(numbers > 1):
        numbers[np.argmax(np.where(numbers > 1, (numbers - amounts) / amounts, -np.inf))] -= 1
    while amounts.size and numbers.sum() < count and np.max(amounts / numbers) > 1:
        numbers[np.argmax((amounts - numbers) / amounts)] += 1
    return numbers
