"""Sampled frames that show the true background where a body rests for most of the clip.

There the median shows the body itself.
"""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np

from trackers._background.median import BackgroundEstimate
from trackers._detection.foreground import SQUARE, BackgroundRange, any_channel, background_range_of, most_of_channels
from trackers._detection.strong_windows import grown
from trackers._frames.ahead import ahead
from trackers._frames.arrays import Bytes, Flags, Image

MIN_HOLE = 12  # px, area
EDGE_RATIO = 2.0  # how much stronger an edge is in the background than in the frame
MIN_EDGE = 1.0  # grey levels a px beyond that
OUTLINE_SHARE = 0.3  # of a hole's outline: the rest is the outline of an object that hides part of the hole
SHADE = 0.4  # of a component's peak: fainter pixels are the shadow of a near object
MIN_SAMPLES = 3  # that must show the background
AS_HOLE = 0.6  # of the samples in which a pixel differs: where fewer are holes, something passes before the background
MARGIN = 4  # px round a foreground component, in which its edges lie
SURROUNDED = 0.5  # of a hole's surroundings: if more of it is a hand or arm, these hide the hole
RIM = np.ones((5, 5), np.uint8)  # the outline of a resting body is blurred


def usable_samples(stack: Bytes, estimate: BackgroundEstimate) -> Flags | None:
    """Which of the sampled frames (k, h, w[, 3]) show the background at each pixel; None when all do.

    ``estimate`` is background and noise as all samples give them.

    Where a body rests in most samples it becomes background, and the other samples differ from it in
    the body's shape: a hole. A hole is distinguished from a body by its outline: much of it is an edge in the
    background but not in the frame. A mark that a hand hides looks like a hole as well, but is surrounded by an
    object that reaches in from the edge of the image.
    """
    edges = _edges(estimate.background)
    background_range = background_range_of(estimate)
    holes = np.stack(list(ahead(partial(_holes_of, background_range, edges), stack)))
    differs = sum(background_range.strongly(image).astype(np.int64) for image in stack)
    holes &= holes.sum(axis=0) > AS_HOLE * differs
    if holes.sum(axis=0).max() < MIN_SAMPLES:
        return None
    wide = np.stack([cv2.dilate(hole.astype(np.uint8), RIM) > 0 for hole in holes])
    return wide | (wide.sum(axis=0) < MIN_SAMPLES)


def _holes_of(background_range: BackgroundRange, edges: Image, image: Bytes) -> Flags:
    """Where (h, w) one sampled image differs from the background in the shape of a hole."""
    holes = np.zeros(image.shape[:2], dtype=np.bool_)
    x, y, columns, rows = cv2.boundingRect(background_range.strongly(image))
    if not columns:
        return holes
    box = grown((x, y, x + columns, y + rows), MARGIN, (image.shape[1], image.shape[0]))
    inside, here = background_range.part(box), image[box[1] : box[3], box[0] : box[2]]
    for level in _of_either_sign(inside, here):
        if np.count_nonzero(level) >= MIN_HOLE:
            left, top, width, height = cv2.boundingRect(level)
            of_level = (
                slice(max(0, top - MARGIN), top + height + MARGIN),
                slice(max(0, left - MARGIN), left + width + MARGIN),
            )
            top, left = (part.start + corner for part, corner in zip(of_level, box[1::-1], strict=True))
            part = np.ascontiguousarray(here[of_level]).astype(np.float32)
            window = slice(top, top + part.shape[0]), slice(left, left + part.shape[1])
            window_holes = _holes(np.ascontiguousarray(level[of_level]), edges[window], _edges(part))
            if window_holes.any():
                holes[window] |= _without_hidden(window_holes, _reaching_in(background_range, image)[window])
    return holes


def _of_either_sign(background_range: BackgroundRange, image: Bytes) -> tuple[Bytes, Bytes]:
    """Largest strong difference of the channels of an image, (h, w): where it has one sign, and where the other.

    The sign is that along the colour in which the differences vary most: a hole differs from a background that shows a
    body as that body does from the scenery, the other way round; in one channel alone both may be brighter.
    """
    above, below = (
        np.where(excess > background_range.strong, excess, 0).astype(np.uint8)
        for excess in (cv2.subtract(image, background_range.highest), cv2.subtract(background_range.lowest, image))
    )
    if image.ndim == 2:
        return above, below
    difference = (above.astype(np.float32) - below).reshape(-1, image.shape[2])
    _, colours = np.linalg.eigh(difference.T @ difference)
    sign = (difference @ colours[:, -1]).reshape(image.shape[:2])
    level = np.maximum(most_of_channels(above), most_of_channels(below))
    return np.where(sign > 0, level, 0).astype(np.uint8), np.where(sign < 0, level, 0).astype(np.uint8)


def _reaching_in(background_range: BackgroundRange, image: Bytes) -> Flags:
    """Foreground that is connected to the edge of the image (h, w)."""
    differs = any_channel(background_range.excess(image) > background_range.weak).astype(np.uint8)
    count, labels = cv2.connectedComponents(cv2.morphologyEx(differs, cv2.MORPH_CLOSE, SQUARE), connectivity=8)
    reaches = np.zeros(count, dtype=np.bool_)
    for side in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        reaches[side] = True
    reaches[0] = False
    return np.asarray(reaches[labels])


def _without_hidden(holes: Flags, reaching: Flags) -> Flags:
    """The holes (h, w) except those enclosed by an object that reaches in from the edge."""
    if not reaching.any():
        return holes
    count, labels = cv2.connectedComponents(holes.astype(np.uint8), connectivity=8)
    kept = holes.copy()
    for label in range(1, count):
        shape = labels == label
        ring = (cv2.dilate(shape.astype(np.uint8), RIM) > 0) & ~shape
        if reaching[ring].mean() > SURROUNDED:
            kept[shape] = False
    return kept


def _edges(image: Image) -> Image:
    """Strength of the edges of an image (h, w[, 3]): length of the gradient, grey levels a px; the largest of channels.

    A body may differ from its background in colour alone, as an orange ball on a brown floor.
    """
    slopes = (cv2.Sobel(image, cv2.CV_32F, *along, scale=1 / 8) for along in ((1, 0), (0, 1)))
    strength = np.hypot(*slopes)
    return np.asarray(strength if strength.ndim == 2 else np.maximum.reduce(cv2.split(strength)), dtype=np.float32)


def _holes(level: Bytes, edges: Image, edges_now: Image) -> Flags:
    """Foreground parts whose outline is an edge of the background rather than of the frame."""
    holes = np.zeros(level.shape, dtype=np.bool_)
    closed = cv2.morphologyEx((level > 0).astype(np.uint8), cv2.MORPH_CLOSE, SQUARE)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    for label in range(1, count):
        left, top, width, height, area = (int(value) for value in stats[label])
        if area < MIN_HOLE:
            continue
        y0, x0 = max(0, top - 2), max(0, left - 2)
        window = (slice(y0, top + height + 2), slice(x0, left + width + 2))
        shape = _without_shade(level[window], labels[window] == label)
        outline = cv2.morphologyEx(shape, cv2.MORPH_GRADIENT, SQUARE) > 0
        only_behind = edges[window][outline] > EDGE_RATIO * edges_now[window][outline] + MIN_EDGE
        if np.count_nonzero(only_behind) > OUTLINE_SHARE * np.count_nonzero(outline):
            holes[window] |= shape > 0
    return holes


def _without_shade(level: Bytes, shape: Flags) -> Bytes:
    """A component without its pixels of low contrast, relative to its strongest."""
    faint = SHADE * float(cv2.blur(level, (3, 3))[shape].max())
    return (shape & (level >= faint)).astype(np.uint8)
