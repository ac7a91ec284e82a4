"""What the bodies look like: kinds of one colour and size, and how many there are of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array
from trackers._background.median import Background, Box, Bytes, Flags, Image, Stack, still_of
from trackers._detection.detect_frames import Stage
from trackers._detection.foreground import SQUARE, Core, Scene, components, cores, rounded, scene_of

SOLID = 0.88  # of its convex hull: what fills less of it is several bodies, or a hand
ROUND = 0.4  # of its area lies within the inscribed circle: less is a cord
THINNEST = 2.0  # px, inscribed radius of what can tell a colour
SAME_COLOUR = 0.3  # of the contrast: colours nearer than this are of one kind
FAINTEST = 0.3  # of the strongest contrast: what is fainter is shade
HALF_COVERED = 0.5
OFF_COLOUR = 0.5  # of the contrast: a pixel farther off the line from background to body is something else
FULLEST = 95  # percentile over the samples: in the others bodies are hidden or have left
RING = 4  # px round a part in which its surroundings are seen
LIKE = 0.35  # of the contrast: a sample's pixel so near to a body's colour shows it, whatever the background is
FEWEST_SAMPLES = 3  # that must show what is behind
SMALLEST = 0.2  # of the area of the largest kind: what is smaller is a part of something
FEWEST = 4  # sightings of a kind
TOO_MUCH = 1.5  # times the area of all bodies
INPAINT_RADIUS = 5  # px round what is never seen from which it is continued
MOVED = 1.0  # px between two samples: less is one thing that stands still, counted once
SIZE_SPREAD = 0.08  # standard deviation of the log area of one body as it turns


@dataclass(frozen=True, eq=False, slots=True)
class Kind:
    """Bodies that look alike: colour (channels,), area in px at the size that is searched, and their number."""

    colour: Image
    area: float
    count: int = 1

    @property
    def radius(self) -> float:
        """Radius of the disc of the same area, px at the size that is searched."""
        return float(np.sqrt(self.area / np.pi))

    def coverage(self, picture: Image, background: Image) -> Image:
        """Share of each pixel (..., channels) that such a body covers; 0 where something else is seen.

        With F the body's colour and B the background, a pixel I = a F + (1 - a) B has
        a = (I - B).(F - B) / |F - B|^2; what lies off that line by much is not such a body.
        """
        contrast = self.colour - background
        squared = np.maximum((contrast**2).sum(axis=-1), 1.0)
        difference = picture - background
        share = (difference * contrast).sum(axis=-1) / squared
        off = ((difference - share[..., np.newaxis] * contrast) ** 2).sum(axis=-1)
        return np.where(off < OFF_COLOUR**2 * squared, np.clip(share, 0.0, 1.0), 0.0).astype(np.float32)


@dataclass(frozen=True, slots=True)
class _Lone:
    """A compact part of one sample: place and area in px, colour, contrast in grey levels."""

    x: float
    y: float
    area: float
    colour: tuple[float, ...]
    contrast: float


def studied(stage: Stage, count: int) -> tuple[Stage, list[Kind]]:
    """The kinds of ``count`` bodies, and the stage with the background seen where none of them is.

    Parameters
    ----------
    stage
        Samples of the clip, and a background in which bodies may be that rested for long.
    count
        How many bodies there are.

    Raises
    ------
    TrackingError
        When so many cannot be seen.
    """
    pictures = [np.atleast_3d(picture) for picture in stage.smalls]
    background = behind(stage.scene)
    known = _by_colour([one for picture in pictures for one in _lone(stage, picture, background)])[:count]
    free = _free(pictures, known, background, count)
    unseen = free.sum(axis=0) < FEWEST_SAMPLES
    stage = stage.behind(free | unseen)
    if unseen.any():
        stage = _filled_in(stage, free | unseen, unseen)
    return stage, _kinds_of(stage, pictures, count)


def _free(pictures: Sequence[Bytes], kinds: Sequence[Kind], background: Image, count: int) -> Flags:
    """Where (k, h, w) the samples show none of the bodies, judged by colour alone.

    A kind of whose colour there is more than the bodies could cover is background, or a hand.
    """
    free = np.ones((len(pictures), *background.shape[:2]), dtype=np.bool_)
    for kind in kinds:
        limit = LIKE * float(np.median(np.linalg.norm(background - kind.colour, axis=-1)))
        like = np.stack([np.linalg.norm(picture - kind.colour, axis=-1) < limit for picture in pictures])
        if like.sum(axis=(1, 2)).mean() < TOO_MUCH * count * kind.area:
            free &= np.stack([cv2.dilate(one.astype(np.uint8), SQUARE, iterations=2) == 0 for one in like])
    return free


@dataclass(frozen=True, eq=False, slots=True)
class _Filled:
    """Sampled pictures in which what is ``unseen`` (h', w'), at the size that is searched, has given ``values``."""

    stack: Stack
    values: Bytes
    unseen: Flags

    @property
    def shape(self) -> tuple[int, ...]:
        """As that of an array."""
        return self.stack.shape

    def window(self, box: Box) -> Bytes:
        """A window of all of them."""
        rows = np.arange(box[1], box[3]) * self.unseen.shape[0] // self.shape[1]
        columns = np.arange(box[0], box[2]) * self.unseen.shape[1] // self.shape[2]
        place = np.ix_(rows, columns)
        pictures = self.stack.window(box).copy()
        where = self.unseen[place]
        pictures[:, where] = self.values[place][where].reshape(pictures[0][where].shape)
        return pictures

    def reduced(self, step: int) -> _Filled:
        """The same with each pixel the mean of ``step`` x ``step``."""
        return _Filled(self.stack.reduced(step), self.values, self.unseen)


def _filled_in(stage: Stage, usable: Flags, unseen: Flags) -> Stage:
    """The stage with what is never seen (h, w) continued from its surroundings, in every sample.

    The method is that of A. Telea, J. Graphics Tools 9 (2004) 23. ``usable`` (k, h, w) says which samples show the
    background.
    """
    guess = cv2.inpaint(rounded(behind(stage.scene)), unseen.astype(np.uint8), INPAINT_RADIUS, cv2.INPAINT_TELEA)
    step = stage.view.step
    stack = _Filled(stage.stack, np.atleast_3d(guess), unseen)
    smalls = stage.smalls.copy()
    smalls[:, unseen] = guess[unseen]
    still = still_of(smalls, usable)
    background = Background(stack, usable, still)
    if step > 1:
        background = Background(stack, usable, None, {step: Background(stack.reduced(step), usable, still)})
    return replace(stage, scene=scene_of(still), lens=replace(stage.lens, background=background))


def _kinds_of(stage: Stage, pictures: Sequence[Bytes], count: int) -> list[Kind]:
    """The kinds of ``count`` bodies from samples before a background without them.

    Parts that stand alone tell colour and size, those first whose contrast and area are greatest; how much of a
    colour there is over the area of one body is the number of such bodies.
    """
    background = behind(stage.scene)
    lone = [one for picture in pictures for one in _lone(stage, picture, background)]
    inner = [_inner(stage.scene, picture) for picture in pictures]
    kinds: list[Kind] = []
    found: list[float] = []
    for kind in _by_colour(lone):
        amounts = [_covered(kind, kinds, *pixels, background) / kind.area for pixels in inner]
        number = float(np.percentile(amounts, FULLEST))
        if number > HALF_COVERED and (not kinds or kind.area > SMALLEST * max(one.area for one in kinds)):
            kinds.append(kind)
            found.append(number)
    kinds, found = kinds[:count], found[:count]
    numbers = _rounded(np.array(found), count)
    if numbers.sum() < count:
        raise TrackingError(
            f"{count} bodies were asked for, but what moves is enough for {int(numbers.sum())}; ask for fewer, "
            f"limit the picture with --roi or --colour, or leave out with --start what comes before they are struck: "
            f"bodies that rest in a pile for most of a clip hide what is behind them"
        )
    return [replace(kind, count=int(number)) for kind, number in zip(kinds, numbers, strict=True) if number]


def behind(scene: Scene) -> Image:
    """The background (h, w, channels) at the size that is searched, grey levels: the middle of what it shows."""
    return np.atleast_3d((scene.lowest.astype(np.float32) + scene.highest) / 2)


def shares(kinds: Sequence[Kind], picture: Image, background: Image) -> list[Image]:
    """Coverage by each kind, each pixel given to the kind whose colour is nearest."""
    nearest = np.stack([((picture - kind.colour) ** 2).sum(axis=-1) for kind in kinds]).argmin(axis=0)
    return [np.where(nearest == k, kind.coverage(picture, background), 0.0) for k, kind in enumerate(kinds)]


def _inner(scene: Scene, picture: Bytes) -> tuple[Image, Bytes]:
    """A picture, and where (h, w) it differs from the background by something that does not reach the edge."""
    height, width = picture.shape[:2]
    where = np.zeros((height, width), dtype=np.uint8)
    for one in components(scene, picture):
        rows, columns = one.mask.shape
        if one.left > 1 and one.top > 1 and one.left + columns < width - 1 and one.top + rows < height - 1:
            where[one.top : one.top + rows, one.left : one.left + columns] |= one.mask
    return picture.astype(np.float32), where


def _covered(kind: Kind, others: Sequence[Kind], picture: Image, where: Bytes, background: Image) -> float:
    """Area in px that bodies of a kind cover, without what is more like the others."""
    chosen = where > 0
    return float(shares([kind, *others], picture[chosen], background[chosen])[0].sum())


def _lone(stage: Stage, picture: Bytes, background: Image) -> Iterator[_Lone]:
    """The solid parts of one sample that do not reach in from the edge."""
    for core in cores(stage.scene, picture):
        if core.held or core.at_edge or core.inscribed < THINNEST or not _solid(core):
            continue
        left, top, right, bottom = core.box
        heart = cv2.erode(core.mask, SQUARE, borderType=cv2.BORDER_CONSTANT, borderValue=0) > 0
        if heart.any():
            window = (slice(top, bottom), slice(left, right))
            image, still = picture[window].astype(np.float32), background[window]
            colour = np.median(image[heart], axis=0)
            contrast = min(
                float(np.linalg.norm(colour - one)) for one in (still[heart].mean(axis=0), _around(picture, core))
            )
            area = float(Kind(colour, float(core.area)).coverage(image, still)[core.mask > 0].sum())
            yield _Lone((left + right) / 2, (top + bottom) / 2, area, tuple(map(float, colour)), contrast)


def _around(picture: Bytes, core: Core) -> Image:
    """Colour just outside of a part: where the background shows a body that has gone, it is the part's own."""
    left, top, right, bottom = core.box
    window = picture[max(0, top - RING) : bottom + RING, max(0, left - RING) : right + RING]
    inside = np.zeros(window.shape[:2], dtype=np.uint8)
    row, column = top - max(0, top - RING), left - max(0, left - RING)
    inside[row : row + bottom - top, column : column + right - left] = core.mask
    near = cv2.dilate(inside, np.ones((2 * RING + 1, 2 * RING + 1), np.uint8))
    near -= cv2.dilate(inside, SQUARE)
    return np.asarray(np.median(window[near > 0], axis=0), dtype=np.float32)


def _solid(core: Core) -> bool:
    """Whether a part is convex and not long."""
    contours, _ = cv2.findContours(core.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.fillConvexPoly(np.zeros_like(core.mask), cv2.convexHull(np.concatenate(contours)), 1)
    return bool(core.area > SOLID * np.count_nonzero(hull) and np.pi * core.inscribed**2 > ROUND * core.area)


def _by_colour(lone: Sequence[_Lone]) -> list[Kind]:
    """Kinds by colour, those first that show most; the area is the commonest of those that stood alone."""
    groups: list[list[_Lone]] = []
    for one in sorted(lone, key=lambda part: -part.contrast * part.area):
        alike = [
            group
            for group in groups
            if np.linalg.norm(np.subtract(one.colour, group[0].colour)) < SAME_COLOUR * group[0].contrast
        ]
        if not alike:
            groups.append([one])
        elif not any(np.hypot(one.x - other.x, one.y - other.y) < MOVED for other in alike[0]):
            alike[0].append(one)
    strongest = max((one.contrast for one in lone), default=0.0)
    groups = [group for group in groups if len(group) >= FEWEST and group[0].contrast > FAINTEST * strongest]
    groups.sort(key=lambda group: -sum(one.contrast * one.area for one in group))
    return [_kind(group) for group in groups]


def _kind(group: Sequence[_Lone]) -> Kind:
    """The kind of some parts of one colour: the area is the mode of their log areas, fragments counting less."""
    areas = np.array([one.area for one in group])
    apart = np.log(areas)[:, np.newaxis] - np.log(areas)
    density = (np.sqrt(areas) * np.exp(-(apart**2) / (2 * SIZE_SPREAD**2))).sum(axis=1)
    typical = [one for one in group if abs(np.log(one.area / areas[np.argmax(density)])) < 2 * SIZE_SPREAD]
    colour = np.median([one.colour for one in typical], axis=0).astype(np.float32)
    return Kind(colour, float(np.median([one.area for one in typical])))


def _rounded(found: Array, count: int) -> NDArray[np.int64]:
    """Whole numbers near ``found`` that add up to ``count``, or to as many as there may be."""
    numbers = np.maximum(np.rint(found), 1).astype(np.int64)
    while numbers.sum() > count and np.any(numbers > 1):
        numbers[np.argmax(np.where(numbers > 1, (numbers - found) / found, -np.inf))] -= 1
    while found.size and numbers.sum() < count and np.max(found / numbers) > 1:
        numbers[np.argmax((found - numbers) / found)] += 1
    return numbers
