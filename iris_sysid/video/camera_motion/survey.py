"""Whether the camera moves, from a few sampled frames.

Points are taken from one of the frames and found again in the others. A camera that moves takes most of them, all over
the image, with it; a camera that stands leaves some of them, spread over the image, where they are, however many a
moving body has. Where both could be said the camera stands: motion that is none would spoil a track that was right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from iris_sysid.types import Array, Frame, Mask, mapped
from iris_sysid.video.camera_motion.affine import MIN_POINTS, first_guess, moved_together
from iris_sysid.video.camera_motion.texture import Bytes, Texture, corners, found_again, inside, shift_of, texture_of

WIDEST = 480  # px: a larger image is surveyed at reduced size
POINTS, STRONGEST = 120, 40  # of the image; of those the ones that are tried first
MAX_FRAMES = 12
SPARSE = 8  # px between the pixels that tell a black frame
MIN_PX = 0.3  # of the reduced image: a smaller displacement is compression, or a lamp that flickers
MIN_FRAMES = 3  # in which the image must be displaced
AGREE_PX = 0.7  # of the reduced image: points that move with the image do so to this tolerance
CLEAR = 3.0  # times the scatter of the points that agree: a smaller displacement may be chance
AGREEING, MIN_AGREEING = 0.5, 0.3  # of the points that were found again; of all
STAYING, STAYING_PX = 0.35, 1.0  # of the displacement of the image, and px: a point that moves less stays
STAYS_PX = 0.3  # of the reduced image: a point that is found so near in most frames stays
STAYS_IN = 0.75  # of the frames
MAX_STAYING = 0.2  # of the points: with more of them, spread over the image, the camera stands
MIN_EXTENT = 0.6  # of a side of the image, that the points span which move together
TILES, MIN_TILES, MIN_TILES_STAYING = 4, 5, 4  # a side; of them with points that move together; that stay


class CameraState(Enum):
    """What the sampled frames say."""

    STILL = "still"
    MOVING = "moving"
    UNKNOWN = "unknown"


@dataclass(frozen=True, eq=False, slots=True)
class Consensus:
    """Where most points of the image went in a frame: displacements (n, 2) px, their typical size and scatter, px."""

    displacement: Array
    size: float
    scatter: float

    @property
    def is_displaced(self) -> bool:
        """Whether the image is displaced beyond what compression and noise do to points."""
        return self.size > max(MIN_PX, CLEAR * self.scatter)


@dataclass(frozen=True, eq=False, slots=True)
class Survey:
    """The size of the reduced image and its points (n, 2) px, strongest first; what the other frames show of them.

    ``displacement`` (k, n, 2) px is that of each point in each frame.
    """

    size: tuple[int, int]
    points: Array
    displacement: Array
    consensus: tuple[Consensus | None, ...]

    @property
    def state(self) -> CameraState:
        """Whether the camera moves."""
        fits = {k: fit for k, fit in enumerate(self.consensus) if fit is not None}
        displaced = [k for k, fit in fits.items() if fit.is_displaced]
        if len(displaced) >= MIN_FRAMES and not self._some_stay(displaced):
            return CameraState.MOVING
        if len(fits) >= max(MIN_FRAMES, len(self.consensus) // 2) or self._still_points():
            return CameraState.STILL
        return CameraState.UNKNOWN

    def _some_stay(self, displaced: Sequence[int]) -> bool:
        """Whether points that are spread over the image stay in place while most of it is displaced."""
        fits = [fit for k in displaced if (fit := self.consensus[k]) is not None]
        expected = np.array([np.hypot(*fit.displacement.T) for fit in fits])
        typical = np.array([[fit.size] for fit in fits])
        own = np.hypot(*np.moveaxis(self.displacement[list(displaced)], 2, 0))
        known = np.isfinite(own) & (expected > np.maximum(MIN_PX, 0.5 * typical))
        stays = known & (np.nan_to_num(own, nan=np.inf) < np.minimum(STAYING * expected, STAYING_PX))
        often = known.sum(axis=0) >= max(1, len(displaced) // 2)
        staying = often & (stays.sum(axis=0) > STAYS_IN * known.sum(axis=0))
        many = np.count_nonzero(staying) >= MAX_STAYING * np.count_nonzero(often)
        return bool(many and self._spread(staying))

    def _still_points(self) -> bool:
        """Whether points that are spread over the image stay in place in most frames: noise does not."""
        own = np.hypot(*np.moveaxis(self.displacement, 2, 0))
        near = np.nan_to_num(own, nan=np.inf) < STAYS_PX
        return self._spread(near.sum(axis=0) > STAYS_IN * len(self.displacement))

    def _spread(self, chosen: Mask) -> bool:
        tiles = tiles_of(self.points[chosen], self.size)
        return bool(np.count_nonzero(chosen) >= MIN_POINTS and len(tiles) >= MIN_TILES_STAYING)


def tiles_of(points: Array, size: tuple[int, int]) -> set[tuple[int, int]]:
    """The tiles, numbered across and down, in which points (n, 2) px of an image of that size lie."""
    cells = np.minimum(points / np.array(size) * TILES, TILES - 1).astype(int)
    return {(int(column), int(row)) for column, row in cells}


def _all_over(points: Array, size: tuple[int, int]) -> bool:
    """Whether points (n, 2) px lie all over an image of that size, or all along one of its sides."""
    low, high = np.percentile(points, (5, 95), axis=0)
    extent = (high - low) / np.array(size)
    long = extent.max() >= MIN_EXTENT and extent.prod() >= MIN_EXTENT**2 / 2
    return bool(long and len(tiles_of(points, size)) >= MIN_TILES)


def survey(frames: Sequence[Frame]) -> Survey:
    """Follow points of the middle one of some frames of a clip through the others."""
    few = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, MAX_FRAMES + 1).astype(int))]
    middle = _middle_one(few)
    texture = texture_of(few[middle].luma, WIDEST)
    image = texture.image(few[middle].luma)
    points, size = corners(image, POINTS), (image.shape[1], image.shape[0])
    found: list[tuple[Array, Consensus | None]] = []
    for way in (few[middle + 1 :], few[:middle][::-1]):  # from frame to frame, so that a slow pan is followed
        found += _followed(way, texture, image, points)
    displacement = np.array([own for own, _ in found]).reshape(len(found), -1, 2)
    return Survey(size, points, displacement, tuple(fit for _, fit in found))


def _middle_one(frames: Sequence[Frame]) -> int:
    """The number of the frame nearest to the middle of some that shows something: clips have black parts."""
    contrast = np.array([frame.luma[::SPARSE, ::SPARSE].std() for frame in frames])
    shown = np.flatnonzero(contrast >= contrast.max() / 2)
    return int(shown[np.argmin(np.abs(shown - len(frames) // 2))])


def _followed(
    frames: Sequence[Frame], texture: Texture, image: Bytes, points: Array
) -> list[tuple[Array, Consensus | None]]:
    """Displacements (n, 2) of the points in each frame, px, and what most of them agree on.

    What most agree on may be found from where the frame before had them, or from the shift of the whole image. Where
    that is a displacement, the points' own are looked for near where they were, and not at reduced size: there a strong
    pattern that moves carries away the points beside it that stay.
    """
    found: list[tuple[Array, Consensus | None]] = []
    expected = points
    for frame in frames:
        now = texture.image(frame.luma)
        own, fit = _agreed(image, now, points, points)
        if fit is None and expected is not points:
            _, fit = _agreed(image, now, points, expected)
        if fit is None and np.hypot(*(shift := shift_of(image, now))) > MIN_PX:
            _, fit = _agreed(image, now, points, points + shift)
        if fit is not None and fit.is_displaced:
            expected = points + fit.displacement
            own = found_again(image, now, points, levels=0) - points
        found.append((own, fit))
    return found


def _agreed(image: Bytes, now: Bytes, points: Array, expected: Array) -> tuple[Array, Consensus | None]:
    """Displacements (n, 2) px of the points that are looked for where they are expected, and what most agree on."""
    places = found_again(image, now, points, expected)
    places[~inside(places, image.shape)] = np.nan
    own = places - points
    return own, _consensus(points, own, (image.shape[1], image.shape[0]))


def _consensus(points: Array, own: Array, size: tuple[int, int]) -> Consensus | None:
    """What most of the strongest points agree on, or most of all; None where these are not spread over the image."""
    for count in (STRONGEST, len(points)):
        seen = np.flatnonzero(np.isfinite(own[:count]).all(axis=1))
        motion = first_guess(points[seen], (points + own)[seen], AGREE_PX)
        if motion is None:
            continue
        agree = seen[moved_together((points + own)[seen], points[seen], motion, AGREE_PX)]
        enough = len(agree) > max(AGREEING * len(seen), MIN_AGREEING * count, MIN_POINTS)
        if enough and _all_over(points[agree], size):
            displacement = mapped(motion, points) - points
            moved, scatter = (np.median(np.hypot(*part[agree].T)) for part in (displacement, own - displacement))
            return Consensus(displacement, float(moved), float(scatter))
    return None
