"""Background subtraction in one frame, and its foreground cut into compact blobs without cords, hands and noise."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np

from trackers._background.median import BackgroundEstimate
from trackers._frames.arrays import Box, Bytes, Flags, Image

STRONG_SIGMAS, STRONG_FLOOR = 6.0, 8.0  # floor in grey levels: surely something
WEAK_SIGMAS, WEAK_FLOOR = 3.5, 4.0  # belongs to it when it touches it
SMALLEST_AREA = 6  # px
SMALLEST_SUPPORT = 3  # px of strong evidence
CONTRAST_SHARES = (0.1, 0.2)  # of a component's peak: fainter pixels are shade or shadow round it
IN_DOUBT = 1.5  # times as clear must a body be to be cut at the higher share
THINNEST = 2.5  # px: a component with a smaller inscribed circle is not taken apart
BLOB_SHARE = 0.5  # of the inscribed radius: thinner parts are cords, arms of clamps, fingers
ARM_SHARE = 0.25  # of the inscribed radius: an object that holds a body at the edge is at least as thick
MOST_BLOBS = 16  # a frame
FRINGE = 4  # px that the outline of a body may lie beyond its stout part
CORD_RADIUS = 6.0  # px: half the width of the thickest cord that is cut off
LARGE_BOX = 3000  # px: a smaller component is not worth cutting
SQUARE = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, eq=False, slots=True)
class BackgroundRange:
    """Grey levels of the background, from ``lowest`` to ``highest``, and the threshold beyond them, as bytes."""

    lowest: Bytes
    highest: Bytes
    weak: Bytes
    strong: Bytes

    def excess(self, image: Bytes) -> Bytes:
        """Distance of each pixel from the background range, grey levels."""
        return np.asarray(cv2.max(cv2.subtract(image, self.highest), cv2.subtract(self.lowest, image)))

    def part(self, box: Box) -> BackgroundRange:
        """Foreground of a part of the image."""
        window = (slice(box[1], box[3]), slice(box[0], box[2]))
        return BackgroundRange(self.lowest[window], self.highest[window], self.weak[window], self.strong[window])


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
        height, width = self.mask.shape
        return (self.left, self.top, self.left + width, self.top + height)


@dataclass(frozen=True, eq=False, slots=True)
class Component:
    """A connected part that differs: its mask and its difference (grey levels) in a window at (left, top)."""

    mask: Bytes
    level: Bytes
    left: int
    top: int

    @property
    def box(self) -> Box:
        """Left, top, right (exclusive), bottom (exclusive)."""
        height, width = self.mask.shape
        return (self.left, self.top, self.left + width, self.top + height)

    def moved(self, left: int, top: int) -> Component:
        """The same component where the corner of the image lies farther left and up by so much."""
        return replace(self, left=self.left + left, top=self.top + top)


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
) -> Iterator[Component]:
    """Connected parts that differ from the background: weakly, but in touch with a strong difference.

    ``colour_mask`` (h, w) limits the search to some pixels.
    """
    excess = background_range.excess(image)
    strong = any_channel(excess > background_range.strong)
    if colour_mask is not None:
        strong &= colour_mask
    if not strong.any():
        return
    weak = any_channel(excess > background_range.weak)
    if colour_mask is not None:
        weak &= colour_mask
    closed = cv2.morphologyEx(weak.astype(np.uint8), cv2.MORPH_CLOSE, SQUARE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    support = np.bincount(labels[strong], minlength=count)
    level = most_of_channels(excess)
    for label in range(1, count):
        if support[label] >= SMALLEST_SUPPORT:
            left, top, width, height, _area = (int(value) for value in stats[label])
            window = (slice(top, top + height), slice(left, left + width))
            yield Component((labels[window] == label).astype(np.uint8), level[window], left, top)


def any_channel(flags: Flags) -> Flags:
    """Flags of an image (h, w) from those of its channels (h, w) or (h, w, 3)."""
    return flags if flags.ndim == 2 else np.logical_or(flags[..., 0], flags[..., 1] | flags[..., 2])


def most_of_channels(image: Bytes) -> Bytes:
    """The largest of the channels of an image (h, w) or (h, w, 3), pixel by pixel."""
    return image if image.ndim == 2 else np.maximum(image[..., 0], np.maximum(image[..., 1], image[..., 2]))


def filled(mask: Bytes) -> Bytes:
    """The mask with its holes filled."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(cv2.drawContours(np.zeros_like(mask), contours, -1, 1, cv2.FILLED), dtype=np.uint8)


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


def blobs_of(parts: Iterable[Component], shape: tuple[int, ...]) -> list[Blob]:
    """The compact parts of some components of an image of that shape; see :func:`blobs`."""
    found_blobs: list[Blob] = []
    for component in parts:
        peak = float(cv2.blur(component.level, (3, 3))[component.mask > 0].max())
        faint, bold = (_blobs_at(component, share * peak, shape) for share in CONTRAST_SHARES)
        edges = _edges(component.level)
        clearness, clearer = (_clearness(component, edges, parts) for parts in (faint, bold))
        found_blobs += bold if clearer > IN_DOUBT * clearness else faint
    return sorted(found_blobs, key=lambda blob: -blob.area)[:MOST_BLOBS]


def stout(component: Component) -> Component:
    """A component cut to the box of its parts thicker than a cord: the box of a cord is large, and slow to search."""
    if component.mask.size < LARGE_BOX:
        return component
    depth = cv2.distanceTransform(padded(component.mask), cv2.DIST_L2, cv2.DIST_MASK_3)
    thick = min(CORD_RADIUS, ARM_SHARE * float(depth.max()))
    x, y, width, height = cv2.boundingRect((depth > thick).astype(np.uint8))
    reach = int(thick) + FRINGE
    window = slice(max(0, y - 1 - reach), y + height + reach), slice(max(0, x - 1 - reach), x + width + reach)
    return Component(
        np.ascontiguousarray(component.mask[window]),
        np.ascontiguousarray(component.level[window]),
        component.left + window[1].start,
        component.top + window[0].start,
    )


def _edges(level: Bytes) -> Image:
    """Gradient of an image, grey levels a px."""
    fine = level.astype(np.float32)
    across, down = (cv2.Sobel(fine, cv2.CV_32F, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    return np.asarray(np.hypot(across, down), dtype=np.float32)


def _clearness(component: Component, edges: Image, parts: list[Blob]) -> float:
    """How compact some parts are, times how sharp their outlines are by the gradient, grey levels a px."""
    compactness = sum(part.inscribed**2 for part in parts) / max(1, sum(part.area for part in parts))
    outlines = [np.zeros(0, dtype=np.float32)]
    for part in parts:
        left, top, right, bottom = part.box
        inside = cv2.erode(part.mask, SQUARE, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        window = edges[top - component.top : bottom - component.top, left - component.left : right - component.left]
        outlines.append(window[part.mask > inside])
    outline = np.concatenate(outlines)
    return compactness * float(outline.mean()) if outline.size else 0.0


def _blobs_at(component: Component, faintest: float, shape: tuple[int, ...]) -> list[Blob]:
    """The blobs of those parts of a component that differ by so many grey levels at least."""
    mask = component.mask & (component.level >= faintest).astype(np.uint8)
    x0, y0, width, height = cv2.boundingRect(mask)
    mask = filled(mask[y0 : y0 + height, x0 : x0 + width])
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    found_blobs: list[Blob] = []
    for label in range(1, count):
        x, y, width, height, area = (int(value) for value in stats[label])
        if area >= SMALLEST_AREA:
            part = (labels[y : y + height, x : x + width] == label).astype(np.uint8)
            found_blobs += _split(part, component.left + x0 + x, component.top + y0 + y, shape)
    return found_blobs


def _split(component: Bytes, left: int, top: int, shape: tuple[int, ...]) -> list[Blob]:
    """Cut a component where it is thin: morphological opening by a disc of half its thickness."""
    wider = padded(component)
    depth = np.asarray(cv2.distanceTransform(wider, cv2.DIST_L2, cv2.DIST_MASK_PRECISE))
    thickest = float(depth.max())
    if thickest < THINNEST:
        edge = _at_edge(_box(component, left, top), shape)
        return [_blob(component, left, top, thickest, (edge, edge))]
    cut = BLOB_SHARE * thickest
    count, labels = cv2.connectedComponents((depth > cut).astype(np.uint8), connectivity=8)
    inland = not _near_edge(_box(component, left, top), ARM_SHARE * thickest, shape)
    if count == 2 and inland:
        return [_lone(wider, depth, cut, (left - 1, top - 1))]
    seeds = [labels == label for label in range(1, count)]
    away = [cv2.distanceTransform((~s).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for s in seeds]
    nearest, near = np.argmin(away, axis=0), np.min(away, axis=0) <= cut + 1.0
    found_blobs = []
    for k, seed in enumerate(seeds):
        mask = ((nearest == k) & near & (wider > 0)).astype(np.uint8)[1:-1, 1:-1]
        edge = _at_edge(_box(mask, left, top), shape)
        held = edge or (not inland and _hangs_on_edge(depth, seed, left - 1, top - 1, shape))
        found_blobs.append(_blob(mask, left, top, float(depth[seed].max()), (edge, held)))
    return found_blobs


def _lone(mask: Bytes, depth: Image, cut: float, corner: tuple[int, int]) -> Blob:
    """The one blob of a part that is not near the edge of the image: what lies about where it is deep."""
    x, y, width, height = cv2.boundingRect((depth > cut).astype(np.uint8))
    reach = int(cut) + 2
    x0, y0 = max(0, x - reach), max(0, y - reach)
    window = slice(y0, y + height + reach), slice(x0, x + width + reach)
    shallow = (depth[window] <= cut).astype(np.uint8)
    near = cv2.distanceTransform(shallow, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) <= cut + 1.0
    body = mask[window] & near.astype(np.uint8)
    return _blob(body, corner[0] + x0, corner[1] + y0, float(depth.max()), (False, False))


def _hangs_on_edge(depth: Image, seed: Flags, left: int, top: int, shape: tuple[int, ...]) -> bool:
    """Whether a seed is connected to the edge of the image by something at least an arm thick."""
    arm = ARM_SHARE * float(depth[seed].max())
    thick, labels = cv2.connectedComponents((depth > arm).astype(np.uint8), connectivity=8)
    if thick <= 1:
        return False
    return _near_edge(_box((labels == labels[seed][0]).astype(np.uint8), left, top), arm, shape)


def _near_edge(box: Box, arm: float, shape: tuple[int, ...]) -> bool:
    """Whether a box comes as near to the edge of an image of that shape as an arm is thick."""
    reach = int(arm) + 1
    return _at_edge((box[0] - reach, box[1] - reach, box[2] + reach, box[3] + reach), shape)


def _box(mask: Bytes, left: int, top: int) -> Box:
    """Left, top, right, bottom (exclusive) of the set pixels of a mask whose corner is (left, top)."""
    x, y, width, height = cv2.boundingRect(mask)
    return left + x, top + y, left + x + width, top + y + height


def _at_edge(box: Box, shape: tuple[int, ...]) -> bool:
    """Whether a box comes within a pixel of the edge of an image of that shape."""
    return box[0] <= 1 or box[1] <= 1 or box[2] >= shape[1] - 1 or box[3] >= shape[0] - 1


def _blob(mask: Bytes, left: int, top: int, inscribed: float, edge_and_held: tuple[bool, bool]) -> Blob:
    """A blob with its window cut close."""
    x0, y0, x1, y1 = _box(mask, 0, 0)
    return Blob(np.ascontiguousarray(mask[y0:y1, x0:x1]), left + x0, top + y0, inscribed, *edge_and_held)
