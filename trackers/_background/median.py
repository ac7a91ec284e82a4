"""Median background and its noise from frames sampled over the clip.

Both are computed tile by tile on demand, so that a 4K clip costs only the tiles that its bodies visit.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers._background.inlier_moments import inlier_moments
from trackers._frames.arrays import MAD_TO_SD, QUANTISATION_SD, Bytes, Flags, Image
from trackers._frames.sampled_frames import SampledFrames

DENSEST_SHARE = 0.5  # of the samples: a body that covers a pixel in more of them is taken for background
INLIER_SIGMAS = 3.0
MIN_CUT = 5.0  # grey levels: dither and rounding are noise, not motion
TRUNCATION = 0.9866  # standard deviation of a normal distribution cut at +-3 sigma
POOL = 9  # px, side of the square over which the noise is averaged
TILE = 128  # px
BLOCK = 4  # px, side of the blocks over which noise is summed
PASSING_SIGMAS = 5.0  # of noise: a larger difference is a body that passes
LARGE = 300_000  # px: in a larger image every third frame gives the noise
WIDE = 33  # px: noise that varies over more is flicker


class BackgroundEstimate(NamedTuple):
    """Image without moving bodies: background and noise, (h, w) or (h, w, 3), grey levels."""

    background: Image
    noise: Image

    def channel(self, number: int) -> BackgroundEstimate:
        """One channel alone."""
        return BackgroundEstimate(
            *(np.ascontiguousarray(image[..., number]) for image in (self.background, self.noise))
        )


def estimate_background(stack: Bytes, usable: Flags | None = None) -> BackgroundEstimate:
    """Background and noise of a stack of frames (k, h, w) or (k, h, w, 3).

    The background is the mean of the samples near the middle of the densest half of them: where a body
    passes, the samples without it lie close together. The noise is the standard deviation of
    those samples, pooled over 9 x 9 px, at least that of rounding, 1/sqrt(12). ``usable`` (k, h, w)
    leaves samples out.
    """
    centre, sigma = _densest(stack)
    if usable is not None:
        _settle(centre, sigma, stack, usable)
    cut = np.maximum(np.float32(INLIER_SIGMAS) * _pooled(sigma), np.float32(MIN_CUT))
    for _ in range(2):  # the middle of the densest samples is a rough centre
        centre, variance = _near(centre, cut, stack, usable)
    noise = np.sqrt(np.maximum(_pooled(variance), 0)) / TRUNCATION
    return BackgroundEstimate(centre, np.maximum(noise, QUANTISATION_SD).astype(np.float32))


def with_unseen(estimate: BackgroundEstimate, unseen: Image | None) -> BackgroundEstimate:
    """The estimate with the background that no sample shows, NaN elsewhere; its noise is the usual one.

    ``unseen`` is (h, w) or (h, w, 3), grey levels.
    """
    if unseen is None:
        return estimate
    known = np.isnan(unseen)
    usual = np.median(estimate.noise, axis=(0, 1))
    return BackgroundEstimate(
        np.where(known, estimate.background, unseen), np.where(known, estimate.noise, np.float32(usual))
    )


def estimate_again(stack: Bytes, known: BackgroundEstimate, before: Flags | None, usable: Flags) -> BackgroundEstimate:
    """The estimate where other samples are left out than before: worked out anew only about where these differ.

    Parameters
    ----------
    stack, usable
        As for :func:`estimate_background`.
    known
        The estimate by the samples that were usable before.
    before
        Those samples (k, h, w); None for all.
    """
    differs = (~usable if before is None else usable != before).any(axis=0).view(np.uint8)
    left, top, columns, rows = cv2.boundingRect(differs)
    if not columns:
        return known
    height, width = differs.shape
    inner, outer = (
        (max(0, top - by), min(height, top + rows + by), max(0, left - by), min(width, left + columns + by))
        for by in (POOL, 2 * POOL)  # the noise is that of neighbours, whose cut is that of theirs
    )
    part = slice(outer[0], outer[1]), slice(outer[2], outer[3])
    anew = estimate_background(np.ascontiguousarray(stack[:, *part]), usable[:, *part])
    estimate = BackgroundEstimate(*(image.copy() for image in known))
    for image, new in zip(estimate, anew, strict=True):
        image[inner[0] : inner[1], inner[2] : inner[3]] = new[
            inner[0] - outer[0] : inner[1] - outer[0], inner[2] - outer[2] : inner[3] - outer[2]
        ]
    return estimate


def _near(centre: Image, cut: Image, stack: Bytes, usable: Flags | None) -> tuple[Image, Image]:
    """Mean and variance of the samples within ``cut`` of the centre."""
    rows, channels = (len(stack), stack.shape[1], -1), 1 if stack.ndim == 3 else stack.shape[3]
    samples, about, farthest = (
        np.ascontiguousarray(stack).reshape(rows),
        centre.reshape(rows[1:]),
        cut.reshape(rows[1:]),
    )
    every = np.ones((1, 1, 1), dtype=np.bool_) if usable is None else np.ascontiguousarray(usable)
    mean, variance = inlier_moments(samples, about, farthest, every, channels)
    return mean.reshape(centre.shape), variance.reshape(centre.shape)


def _densest(stack: Bytes) -> tuple[Image, Image]:
    """Middle of the shortest range of grey levels that holds half of the samples, and its sigma."""
    ordered = _sorted(list(stack))
    held = max(2, round(DENSEST_SHARE * len(ordered)))
    narrowest = np.full(stack.shape[1:], 255, dtype=np.uint8)
    lowest, highest = ordered[len(ordered) // 2].copy(), ordered[len(ordered) // 2].copy()
    for low, high in zip(ordered, ordered[held - 1 :], strict=False):
        width = cv2.subtract(high, low)
        narrower = (width < narrowest).view(np.uint8)
        for source, target in ((width, narrowest), (low, lowest), (high, highest)):
            cv2.copyTo(source, narrower, target)
    centre = cv2.addWeighted(lowest, 0.5, highest, 0.5, 0.0, dtype=cv2.CV_32F)
    # to sigma, by trial with normal noise
    return np.asarray(centre, dtype=np.float32), narrowest * np.float32(0.74 + 13 / len(ordered))


def _settle(centre: Image, sigma: Image, stack: Bytes, usable: Flags) -> None:
    """Set centre and sigma, where samples must be left out, by median and median deviation of the others."""
    covered = ~usable.all(axis=0)
    chosen = usable[:, covered] if stack.ndim == 3 else usable[:, covered][..., np.newaxis]
    samples = np.where(chosen, stack[:, covered], np.float32(np.nan))
    count = np.broadcast_to(chosen.sum(axis=0), samples.shape[1:])
    centre[covered] = _median(samples, count)
    sigma[covered] = MAD_TO_SD * _median(np.abs(samples - centre[covered]), count)


def _median(samples: Image, count: NDArray[np.int64]) -> Image:
    """Median over the first axis of the ``count`` samples that are not NaN: np.nanmedian takes ten times as long."""
    ordered = np.sort(samples, axis=0)  # NaN comes last
    low, high = (
        np.take_along_axis(ordered, middle[np.newaxis], axis=0)[0]
        for middle in (np.maximum(count - 1, 0) // 2, np.minimum(count // 2, len(samples) - 1))
    )
    return np.asarray((low + high) / np.float32(2), dtype=np.float32)


def _sorted(images: list[Bytes]) -> list[Bytes]:
    """Images in ascending order at each pixel, by Batcher's merge exchange of whole images [1]_.

    .. [1] D. E. Knuth, The Art of Computer Programming 3, 2nd edition, algorithm 5.2.2M.
    """
    n = len(images)
    p = top = 1 << max(0, (n - 1).bit_length() - 1)
    while p > 0:
        q, r, d = top, 0, p
        while True:
            for i in (i for i in range(n - d) if i & p == r):
                images[i], images[i + d] = cv2.min(images[i], images[i + d]), cv2.max(images[i], images[i + d])
            if q == p:
                break
            d, q, r = q - p, q // 2, p
        p //= 2
    return images


def _pooled(image: Image) -> Image:
    """Mean over a square neighbourhood, the border mirrored."""
    return np.asarray(cv2.blur(image, (POOL, POOL)), dtype=np.float32)


@dataclass(eq=False)
class Background:
    """Background and noise, worked out tile by tile on demand.

    ``stack`` are the sampled images; ``usable`` (k, h', w') says at a reduced size which samples show the
    background, None that all may be used. ``whole`` is the result where it is known already. ``unseen`` (h', w'[, 3])
    is the background that no sample shows, grey levels, NaN elsewhere. ``coarser`` holds the backgrounds of the reduced
    images by their step; one may be given.
    """

    stack: SampledFrames
    usable: Flags | None = None
    whole: BackgroundEstimate | None = None
    unseen: Image | None = None
    coarser: dict[int, Background] = field(default_factory=dict)
    _tiles: dict[tuple[int, int], BackgroundEstimate] = field(default_factory=dict)

    def reduced(self, step: int) -> Background:
        """The background where each pixel is the mean of ``step`` x ``step``."""
        if step == 1:
            return self
        if step not in self.coarser:
            self.coarser[step] = Background(self.stack.reduced(step), self.usable, unseen=self.unseen)
        return self.coarser[step]

    def patch(self, top: int, bottom: int, left: int, right: int) -> BackgroundEstimate:
        """Background and noise of rows ``top`` to ``bottom - 1`` and columns ``left`` to ``right - 1``."""
        if self.whole is not None:
            window = (slice(top, bottom), slice(left, right))
            return BackgroundEstimate(self.whole.background[window], self.whole.noise[window])
        patch = BackgroundEstimate(*np.empty((2, bottom - top, right - left, *self.stack.shape[3:]), dtype=np.float32))
        for row in range(top // TILE, (bottom - 1) // TILE + 1):
            for column in range(left // TILE, (right - 1) // TILE + 1):
                y0, x0 = row * TILE, column * TILE
                y = slice(max(top, y0), min(bottom, y0 + TILE))
                x = slice(max(left, x0), min(right, x0 + TILE))
                into = (slice(y.start - top, y.stop - top), slice(x.start - left, x.stop - left))
                source = (slice(y.start - y0, y.stop - y0), slice(x.start - x0, x.stop - x0))
                tile = self._tile(row, column)
                patch.background[into], patch.noise[into] = tile.background[source], tile.noise[source]
        return (
            patch if self.unseen is None else with_unseen(patch, self.enlarged(self.unseen, top, bottom, left, right))
        )

    def _tile(self, row: int, column: int) -> BackgroundEstimate:
        """One tile, worked out with a margin so that pooling does not show at its seams."""
        if (row, column) not in self._tiles:
            height, width = self.stack.shape[1:3]
            top, left = row * TILE, column * TILE
            y0, x0 = max(0, top - POOL), max(0, left - POOL)
            y1, x1 = min(height, top + TILE + POOL), min(width, left + TILE + POOL)
            estimate = estimate_background(self.stack.window((x0, y0, x1, y1)), self._usable(y0, y1, x0, x1))
            inside = (slice(top - y0, top - y0 + TILE), slice(left - x0, left - x0 + TILE))
            self._tiles[row, column] = BackgroundEstimate(
                estimate.background[inside].copy(), estimate.noise[inside].copy()
            )
        return self._tiles[row, column]

    def _usable(self, top: int, bottom: int, left: int, right: int) -> Flags | None:
        """The flags of a window at full size; None where every sample may be used."""
        if self.usable is None:
            return None
        window = np.moveaxis(self.enlarged(np.moveaxis(self.usable, 0, 2), top, bottom, left, right), 2, 0)
        return None if window.all() else window

    def enlarged(self, image: NDArray[Any], top: int, bottom: int, left: int, right: int) -> NDArray[Any]:
        """A window at full size of an image (h', w', ...), grey levels or flags, at a reduced size.

        Parameters
        ----------
        image
            The whole image.
        top, bottom, left, right
            Rows ``top`` to ``bottom - 1`` and columns ``left`` to ``right - 1``, px.
        """
        height, width = self.stack.shape[1:3]
        rows = np.arange(top, bottom) * image.shape[0] // height
        columns = np.arange(left, right) * image.shape[1] // width
        return image[rows[:, np.newaxis], columns]


def noise_inflation(stack: Bytes, estimate: BackgroundEstimate) -> float:
    """Variance of sums of the noise over blocks of pixels, relative to white noise: 1 or more.

    Compression smooths the noise, which makes sums over pixels noisier than the pixels suggest. What
    varies over more than ``WIDE`` px is left out: flicker is corrected body by body. Blocks through
    which a body passes are left out too. ``stack`` is (k, h, w), or (k, h, w, 3) whose luma counts.
    """
    background, noise = (image if image.ndim == 2 else image[..., 0] for image in (estimate.background, estimate.noise))
    height, width = (size - size % BLOCK for size in background.shape)
    blocks = (height // BLOCK, BLOCK, width // BLOCK, BLOCK)
    noisy = noise[:height:BLOCK, :width:BLOCK] > QUANTISATION_SD
    of_sums = of_pixels = 0.0
    for frame in (stack if stack.ndim == 3 else stack[..., 0])[:: 1 if background.size < LARGE else 3]:
        residual = frame - background
        quiet = np.abs(residual) < PASSING_SIGMAS * noise
        residual = np.where(quiet, residual, 0)
        part = (residual - cv2.blur(residual, (WIDE, WIDE)))[:height, :width].reshape(blocks)
        chosen = quiet[:height, :width].reshape(blocks).all(axis=(1, 3)) & noisy
        of_sums += float((part.sum(axis=(1, 3))[chosen] ** 2).sum())
        of_pixels += float((part**2).sum(axis=(1, 3))[chosen].sum())
    return max(1.0, of_sums / of_pixels) if of_pixels else 1.0
