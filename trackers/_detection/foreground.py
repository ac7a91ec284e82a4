"""Background subtraction in one frame, and its foreground cut into compact blobs without cords, hands and noise."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from iris_sysid.types import Array
from trackers._background.median import BackgroundEstimate
from trackers._detection.connected import Labels, connected_parts
from trackers._detection.cut_components import INSCRIBED, LEFT, MIN_INSCRIBED, SEED, WHOLE, cut_at, peak_of
from trackers._detection.strong_windows import are_most, grown, merged, windows_of
from trackers._frames.arrays import Box, Bytes, Flags, Image

STRONG_SIGMAS, STRONG_FLOOR = 6.0, 8.0  # floor in grey levels: surely something
WEAK_SIGMAS, WEAK_FLOOR = 3.5, 4.0  # belongs to it when it touches it
MIN_AREA = 6  # px
MIN_SUPPORT = 3  # px of strong evidence
CONTRAST_SHARES = (0.1, 0.2)  # of a component's peak: fainter pixels are shade or shadow round it
SPECK = 2  # px: a thinner component is not a body, whichever share of the peak it is cut at
IN_DOUBT = 1.5  # times as clear must a body be to be cut at the higher share
ARM_SHARE = 0.25  # of the inscribed radius: an object that holds a body at the edge is at least as thick
MAX_BLOBS = 16  # a frame
FRINGE = 4  # px that the outline of a body may lie beyond its stout part
CORD_RADIUS = 6.0  # px: half the width of the thickest cord that is cut off
GROWN, FRAYED = 48, 3  # px by which a window grows that cuts a part; about its sides, where gaps are closed wrongly
LARGE_BOX = 3000  # px: a smaller component is not worth cutting
SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False, slots=True)
class BackgroundRange:
    """Grey levels of the background, from ``lowest`` to ``highest``, and the threshold beyond them, as bytes.

    ``limits`` are the lowest and highest levels that do not differ weakly, then those that do not differ strongly.
    """

    lowest: Bytes
    highest: Bytes
    weak: Bytes
    strong: Bytes
    limits: tuple[Bytes, ...] = ()

    def __post_init__(self) -> None:
        if not self.limits:
            pairs = [(cv2.subtract(self.lowest, by), cv2.add(self.highest, by)) for by in (self.weak, self.strong)]
            object.__setattr__(self, "limits", (*pairs[0], *pairs[1]))

    def excess(self, image: Bytes) -> Bytes:
        """Distance of each pixel from the background range, grey levels."""
        return np.asarray(cv2.max(cv2.subtract(image, self.highest), cv2.subtract(self.lowest, image)))

    def weakly(self, image: Bytes) -> Bytes:
        """1 where some channel of an image differs weakly, 0 elsewhere. Shape (h, w)."""
        return outside_of(image, self.limits[0], self.limits[1])

    def strongly(self, image: Bytes) -> Bytes:
        """1 where some channel of an image differs strongly, 0 elsewhere. Shape (h, w)."""
        return outside_of(image, self.limits[2], self.limits[3])

    def part(self, box: Box) -> BackgroundRange:
        """Foreground of a part of the image."""
        window = (slice(box[1], box[3]), slice(box[0], box[2]))
        limits = tuple(limit[window] for limit in self.limits)
        return BackgroundRange(
            self.lowest[window], self.highest[window], self.weak[window], self.strong[window], limits
        )


@dataclass(frozen=True, eq=False, slots=True)
class Blob:
    """A compact part of the foreground: its mask in a window whose corner is (left, top), px.

    ``inscribed`` is the radius of its largest inscribed circle, ``at_edge`` whether it reaches the
    edge of the image, ``held`` whether it is connected to the edge by something thick as an arm.
    """

    mask: Bytes
    left: int
    top: int
    inscribed: float
    at_edge: bool
    held: bool

    @property
    def area(self) -> int:
        """Number of pixels."""
        return int(np.count_nonzero(self.mask))

    @property
    def box(self) -> Box:
        """Left, top, right (exclusive), bottom (exclusive)."""
        return _box_of(self.mask, self.left, self.top)


@dataclass(frozen=True, eq=False, slots=True)
class ConnectedComponent:
    """A connected part that differs: its mask and its difference (grey levels) in a window at (left, top)."""

    mask: Bytes
    level: Bytes
    left: int
    top: int

    @property
    def box(self) -> Box:
        """Left, top, right (exclusive), bottom (exclusive)."""
        return _box_of(self.mask, self.left, self.top)

    def moved(self, left: int, top: int) -> ConnectedComponent:
        """The same component in an image whose corner lies ``left`` and ``top`` px farther left and up."""
        return replace(self, left=self.left + left, top=self.top + top)


def _box_of(mask: Bytes, left: int, top: int) -> Box:
    height, width = mask.shape
    return left, top, left + width, top + height


def background_range_of(estimate: BackgroundEstimate) -> BackgroundRange:
    """The background range; a camera that shakes by a pixel stays within it."""
    return BackgroundRange(
        lowest=rounded(cv2.erode(estimate.background, SQUARE)),
        highest=rounded(cv2.dilate(estimate.background, SQUARE)),
        weak=rounded(np.maximum(WEAK_SIGMAS * estimate.noise, WEAK_FLOOR)),
        strong=rounded(np.maximum(STRONG_SIGMAS * estimate.noise, STRONG_FLOOR)),
    )


def rounded(image: Image) -> Bytes:
    """Grey levels as bytes. Any shape: (h, w) or (h, w, 3)."""
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def components(
    background_range: BackgroundRange, image: Bytes, colour_mask: Flags | None = None
) -> Iterator[ConnectedComponent]:
    """Connected parts that differ from the background: weakly, but in touch with a strong difference.

    Only windows round the strong differences are searched, which grow until they hold the parts whole.
    ``colour_mask`` (h, w) limits the search to some pixels.
    """
    strong = background_range.strongly(image)
    if colour_mask is not None:
        strong &= colour_mask

    def parts_in(box: Box) -> list[ConnectedComponent]:
        window = slice(box[1], box[3]), slice(box[0], box[2])
        mask = None if colour_mask is None else colour_mask[window]
        return parts_of(background_range, image[window], box, mask)

    return whole_parts(parts_in, windows_of(strong), (image.shape[1], image.shape[0]))


def whole_parts(
    parts_in: Callable[[Box], list[ConnectedComponent]], boxes: list[Box], size: tuple[int, int]
) -> Iterator[ConnectedComponent]:
    """The components in some boxes of an image of that width and height, which grow until they hold the parts whole.

    ``parts_in`` gives those in one box, by :func:`parts_of`.
    """
    parts = dict[Box, list[ConnectedComponent]]()
    while boxes:
        if are_most(boxes, size):
            boxes = [(0, 0, *size)]
        parts = {box: parts[box] if box in parts else parts_in(box) for box in boxes}
        cut = {box for box, ones in parts.items() if any(_reaches_side(one.box, box, size) for one in ones)}
        if not cut:
            break
        boxes = merged([grown(box, GROWN, size) if box in cut else box for box in boxes])
    yield from sorted((part for ones in parts.values() for part in ones), key=_first_block)


def parts_of(
    background_range: BackgroundRange, image: Bytes, box: Box, colour_mask: Flags | None = None
) -> list[ConnectedComponent]:
    """The components of the image of a box; those that reach a side may be parts of larger ones.

    ``colour_mask`` (h, w) limits the search to some pixels of the box.
    """
    part = background_range.part(box)
    strong = part.strongly(image)
    if not strong.any():
        return []
    weak = part.weakly(image)
    if colour_mask is not None:
        weak &= colour_mask
        strong &= colour_mask
    closed = cv2.morphologyEx(weak, cv2.MORPH_CLOSE, SQUARE)
    labels, boxes = connected_parts(closed, strong)
    found = []
    for number, (left, top, right, bottom, support) in enumerate(boxes.tolist(), start=1):
        if support >= MIN_SUPPORT:
            inside = (slice(top, bottom), slice(left, right))
            excess = part.part((left, top, right, bottom)).excess(image[inside])
            mask = (labels[inside] == number).view(np.uint8)
            found.append(ConnectedComponent(mask, most_of_channels(excess), left + box[0], top + box[1]))
    return found


def _reaches_side(part: Box, box: Box, size: tuple[int, int]) -> bool:
    """Whether a part may go on beyond a side of its box: it comes near to a side that is not a side of the image."""
    low = any(part[k] < box[k] + FRAYED and box[k] > 0 for k in (0, 1))
    return low or any(part[k + 2] > box[k + 2] - FRAYED and box[k + 2] < size[k] for k in (0, 1))


def _first_block(component: ConnectedComponent) -> tuple[int, int]:
    """Row and column of the first square of 2 x 2 px, row by row, that holds a part of a component."""
    row = component.top // 2
    first = component.mask[: 2 * row + 2 - component.top].any(axis=0)
    return row, (component.left + int(first.argmax())) // 2


def outside_of(image: Bytes, lowest: Bytes, highest: Bytes) -> Bytes:
    """1 where some channel of an image is below or above these levels. Shape (h, w)."""
    return (cv2.inRange(image, lowest, highest) == 0).view(np.uint8)


def any_channel(flags: Flags) -> Flags:
    """Flags of an image (h, w) from those of its channels (h, w) or (h, w, 3)."""
    return flags if flags.ndim == 2 else np.logical_or(flags[..., 0], flags[..., 1] | flags[..., 2])


def most_of_channels(image: Bytes) -> Bytes:
    """The largest of the channels of an image (h, w) or (h, w, 3), pixel by pixel."""
    return image if image.ndim == 2 else np.maximum(image[..., 0], np.maximum(image[..., 1], image[..., 2]))


def padded(mask: Bytes) -> Bytes:
    """The mask with another pixel on every side, 0; several times as fast as np.pad."""
    return np.asarray(cv2.copyMakeBorder(mask, 1, 1, 1, 1, cv2.BORDER_CONSTANT, value=0), dtype=np.uint8)


def blobs(background_range: BackgroundRange, image: Bytes, colour_mask: Flags | None = None) -> list[Blob]:
    """The compact parts of one image, the largest first; parts thinner than half the thickest are cut off.

    Shade and shadow round a body are fainter than it, but so are parts of a body itself: each component
    is cut at the share of its peak contrast at which its parts are compact and their outlines sharp,
    the lower share if in doubt.
    """
    return blobs_of(components(background_range, image, colour_mask), image.shape)


def blobs_of(parts: Iterable[ConnectedComponent], shape: tuple[int, ...]) -> list[Blob]:
    """The compact parts of some components of an image of that shape; see :func:`blobs`."""
    found_blobs: list[Blob] = []
    for component in parts:
        peak = peak_of(component.mask, np.ascontiguousarray(component.level))
        (faint, clearness), (bold, clearer) = (_blobs_at(component, share * peak, shape) for share in CONTRAST_SHARES)
        thin = min(component.mask.shape) <= SPECK
        found_blobs += bold if clearer > IN_DOUBT * clearness and not thin else faint
    return sorted(found_blobs, key=lambda blob: -blob.area)[:MAX_BLOBS]


def stout(component: ConnectedComponent) -> ConnectedComponent:
    """A component cut to the box of its parts thicker than a cord: the box of a cord is large, and slow to search."""
    if component.mask.size < LARGE_BOX:
        return component
    depth = cv2.distanceTransform(padded(component.mask), cv2.DIST_L2, cv2.DIST_MASK_3)
    thick = min(CORD_RADIUS, ARM_SHARE * float(depth.max()))
    x, y, width, height = cv2.boundingRect((depth > thick).astype(np.uint8))
    reach = int(thick) + FRINGE
    window = slice(max(0, y - 1 - reach), y + height + reach), slice(max(0, x - 1 - reach), x + width + reach)
    return ConnectedComponent(
        np.ascontiguousarray(component.mask[window]),
        np.ascontiguousarray(component.level[window]),
        component.left + window[1].start,
        component.top + window[0].start,
    )


def _blobs_at(component: ConnectedComponent, faintest: float, shape: tuple[int, ...]) -> tuple[list[Blob], float]:
    """The blobs of the parts of a component that differ by ``faintest`` grey levels or more, and how clear they are.

    See :func:`cut_at`.
    """
    level = np.ascontiguousarray(component.level)
    owner, depth, table, clearness = cut_at(component.mask, level, faintest, MIN_AREA)
    rows = enumerate(table, start=1)
    return [_blob(component, shape, (owner, depth), number, row) for number, row in rows], clearness


def _blob(
    component: ConnectedComponent, shape: tuple[int, ...], seen: tuple[Labels, Image], number: int, row: Array
) -> Blob:
    """One part of a component of an image of that shape, from the maps of :func:`cut_at` and its row of the table."""
    owner, depth = seen
    left, top, right, bottom = (int(side) for side in row[LEFT:INSCRIBED])
    inscribed, thickest = float(row[INSCRIBED]), float(row[WHOLE + 4])
    mask = (owner[top:bottom, left:right] == number).view(np.uint8)
    x, y = component.left + left, component.top + top
    edge = _at_edge((x, y, component.left + right, component.top + bottom), shape)
    held = edge
    if not edge and thickest >= MIN_INSCRIBED:
        whole = tuple(int(side) for side in row[WHOLE : WHOLE + 4])
        if _near_edge(_moved(whole, component), ARM_SHARE * thickest, shape):
            held = _hangs_on_edge(depth, (int(row[SEED]), int(row[SEED + 1]), inscribed), component, shape)
    return Blob(mask, x, y, inscribed, edge, held)


def _hangs_on_edge(
    depth: Image, seed: tuple[int, int, float], component: ConnectedComponent, shape: tuple[int, ...]
) -> bool:
    """Whether a seed is connected to the edge of the image by something at least an arm thick.

    The seed is the column and row of one of its pixels in the window of a component, and the greatest depth in it.
    """
    x, y, deepest = seed
    arm = ARM_SHARE * deepest
    _, labels, stats, _ = cv2.connectedComponentsWithStats((depth > arm).view(np.uint8), connectivity=8)
    left, top, width, height = (int(value) for value in stats[labels[y, x], :4])
    return _near_edge(_moved((left, top, left + width, top + height), component), arm, shape)


def _moved(box: tuple[int, ...], component: ConnectedComponent) -> Box:
    """A box in the window of a component, in the image."""
    left, top, right, bottom = box
    return left + component.left, top + component.top, right + component.left, bottom + component.top


def _near_edge(box: Box, arm: float, shape: tuple[int, ...]) -> bool:
    """Whether a box comes as near to the edge of an image of that shape as an arm is thick."""
    reach = int(arm) + 1
    return _at_edge((box[0] - reach, box[1] - reach, box[2] + reach, box[3] + reach), shape)


def _at_edge(box: Box, shape: tuple[int, ...]) -> bool:
    """Whether a box comes within a pixel of the edge of an image of that shape."""
    return box[0] <= 1 or box[1] <= 1 or box[2] >= shape[1] - 1 or box[3] >= shape[0] - 1
