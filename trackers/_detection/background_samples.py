"""Sampled frames that show the true background where a body is in most of them: there the median shows the body.

A large body that moves covers the middle of its path in most samples, but its outline is rarely in one place: the
median of the gradients is that of the background [1]_. A body that rests leaves a hole when it leaves.

.. [1] Y. Weiss, Deriving intrinsic images from image sequences, ICCV 2001.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from trackers._background.median import BackgroundEstimate
from trackers._detection.foreground import (
    SQUARE,
    STRONG_FLOOR,
    STRONG_SIGMAS,
    BackgroundRange,
    any_channel,
    background_range_of,
    most_of_channels,
)
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
COVERED = 0.4  # of the samples: beside a part of the background that shows a body, the body is in about half of them
AROUND = 16  # px about what is covered so often
NEAR = 0.25  # of what is added to the background: a sample so near to the result shows it
RIM_WIDTHS, CONFIRMED = 3, 0.5  # of 2 px: what counts as the rim of a body; share of it that samples must show
# of the rare edges may be left over: by rendered balls 0.03 to 0.18, by a cart along a track 0.7, whose sides are in
# one line in most samples
EXPLAINED = 0.4
RARE_EDGE = 3.0  # grey levels a px by which an edge of the background must exceed that in most samples


class UsableSamples(NamedTuple):
    """Which ``samples`` (k, h, w) show the background at each pixel; None when all do.

    ``unseen`` (h, w[, 3]) is the background where none of them does, grey levels, NaN elsewhere; None without such
    pixels. ``rest`` (h, w) is where a body rests in most of them; None when none does.
    """

    samples: Flags | None
    unseen: Image | None = None
    rest: Flags | None = None


def usable_samples(stack: Bytes, estimate: BackgroundEstimate) -> UsableSamples:
    """Which of the sampled frames (k, h, w[, 3]) show the background at each pixel.

    ``estimate`` is background and noise as all samples give them.

    Where a body rests in most samples it becomes background, and the other samples differ from it in
    the body's shape: a hole. A hole is distinguished from a body by its outline: much of it is an edge in the
    background but not in the frame. A mark that a hand hides looks like a hole as well, but is surrounded by an
    object that reaches in from the edge of the image.
    """
    passing = _beside_passing(stack, estimate)
    if passing is not None:
        usable, behind = passing
        shown, at = usable.any(axis=0), np.isfinite(behind)
        estimate = estimate._replace(background=np.where(at, behind, estimate.background))
        behind[shown] = np.nan
    edges, background_range = _edges(estimate.background), background_range_of(estimate)
    holes = np.stack(list(ahead(partial(_holes_of, background_range, edges), stack)))
    differs = sum(background_range.strongly(image).astype(np.int64) for image in stack)
    holes &= holes.sum(axis=0) > AS_HOLE * differs
    if passing is not None:
        holes &= usable.all(axis=0)
    resting = _widely(holes, MIN_SAMPLES) if holes.sum(axis=0).max() >= MIN_SAMPLES else None
    rest = None if resting is None else np.asarray(~resting.all(axis=0))
    if passing is None:
        return UsableSamples(resting, None, rest)
    if resting is not None:
        usable = np.where(usable.all(axis=0), resting, usable)
    return UsableSamples(usable | ~shown, None if shown.all() else behind, rest)


def _widely(shown: Flags, least: int) -> Flags:
    """The samples (k, h, w) that show the background, or are near to one that does; all where too few do."""
    wide = np.stack([cv2.dilate(sample.view(np.uint8), RIM) > 0 for sample in shown])
    return wide | (wide.sum(axis=0) < least)


def _beside_passing(stack: Bytes, estimate: BackgroundEstimate) -> tuple[Flags, Image] | None:
    """Which samples (k, h, w) show the background where a moving body is in most of them, and the background there.

    The background (h, w[, 3]), grey levels, is NaN elsewhere. Pixels that no sample shows have no usable one. None
    where no body is in the background, or where few of its rare edges are those of one.
    """
    strongly = background_range_of(estimate).strongly
    covered = np.sum([strongly(image) for image in stack], axis=0) > COVERED * len(stack)
    if np.count_nonzero(covered) < MIN_HOLE:
        return None
    x, y, columns, rows = cv2.boundingRect(covered.view(np.uint8))
    left, top, right, bottom = grown((x, y, x + columns, y + rows), AROUND, covered.shape[::-1])
    window = slice(top, bottom), slice(left, right)
    here, background = stack[:, *window], estimate.background[window]
    usual = [np.median([np.diff(image.astype(np.int16), axis=axis) for image in here], axis=0) for axis in (0, 1)]
    rare = _rare_edges(usual, background)
    off = _integrated(rare, background.shape)
    noise = np.median(estimate.noise, axis=(0, 1))  # large where a body is in half of the samples
    body = any_channel(np.abs(off) > np.maximum(STRONG_SIGMAS * noise, STRONG_FLOOR))
    apart, size = (
        np.square(of).reshape(*of.shape[: of.ndim - off.ndim + 2], -1).sum(axis=-1)
        for of in (here - background - off, off)
    )
    shown = apart < NEAR**2 * size
    body = _confirmed(body, shown.any(axis=0))
    body &= shown.any(axis=0) | _surrounded(body & ~shown.any(axis=0), body & shown.any(axis=0))
    behind = np.full_like(estimate.background, np.nan)
    behind[window][body] = (background + off)[body]
    left_over = _rare_edges(usual, np.where(np.isfinite(behind[window]), behind[window], background))
    if not body.any() or _strength(left_over, body) > EXPLAINED * _strength(rare, body):
        return None
    usable = np.ones(stack.shape[:3], dtype=np.bool_)
    usable[:, *window] = np.where(body, shown & body, _widely(shown & body, 1))
    return usable, behind


def _rare_edges(usual: Sequence[Image], background: Image) -> list[Image]:
    """What the usual gradients, down and across, have beyond those of a background, grey levels a px; 0 for noise."""
    off = [gradient - np.diff(background, axis=axis) for axis, gradient in enumerate(usual)]
    return [np.where(np.abs(gradient) < RARE_EDGE, 0, gradient) for gradient in off]


def _strength(edges: Sequence[Image], body: Flags) -> float:
    """Sum of gradients, grey levels, within a few px of a body (h, w)."""
    near = cv2.dilate(body.view(np.uint8), RIM, iterations=RIM_WIDTHS) > 0
    return float(np.abs(edges[0])[near[1:]].sum() + np.abs(edges[1])[near[:, 1:]].sum())


def _confirmed(body: Flags, shown: Flags) -> Flags:
    """The parts of the background that show a body (h, w) about whose rims some sample has ``shown`` the background.

    At its rim a body that moves is in half of the samples.
    """
    count, labels = cv2.connectedComponents(body.view(np.uint8), connectivity=8)
    rim = body & (cv2.erode(body.view(np.uint8), RIM, iterations=RIM_WIDTHS) == 0)
    share = np.bincount(labels[rim & shown], minlength=count) / np.maximum(np.bincount(labels[rim], minlength=count), 1)
    return np.asarray((share > CONFIRMED)[labels] & body)


def _surrounded(parts: Flags, by: Flags) -> Flags:
    """Those of some parts (h, w) whose surroundings are mostly of another kind (h, w)."""
    count, labels = cv2.connectedComponents(parts.view(np.uint8), connectivity=8)
    about = np.where(parts, 0, cv2.dilate(labels.astype(np.uint16), SQUARE))
    share = np.bincount(about[by], minlength=count) / np.maximum(np.bincount(about.ravel(), minlength=count), 1)
    return np.asarray((share > SURROUNDED)[labels] & parts)


def _integrated(gradients: Sequence[Image], shape: tuple[int, ...]) -> Image:
    """The image (h, w[, 3]) that has some gradients, down and across, by least squares, and is 0 outside."""
    from scipy.fft import dstn, idstn  # few clips need it

    divergence = np.zeros(shape)
    for axis, gradient in enumerate(gradients):
        ends = [(1, 1) if k == axis else (0, 0) for k in range(len(shape))]
        divergence += np.diff(np.pad(gradient, ends), axis=axis)
    down, across = (2 * np.cos(np.pi * np.arange(1, size + 1) / (size + 1)) - 2 for size in shape[:2])
    laplacian = (down[:, np.newaxis] + across).reshape(*shape[:2], *[1] * (len(shape) - 2))
    waves = dstn(divergence, type=1, axes=(0, 1))
    return np.asarray(idstn(waves / laplacian, type=1, axes=(0, 1)), dtype=np.float32)


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
