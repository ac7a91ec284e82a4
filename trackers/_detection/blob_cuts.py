"""A component cut into compact parts, at one level of contrast."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trackers._detection.masks import SQUARE, as_bytes, depth_of, filled
from trackers._frames.arrays import Box, Bytes, Flags, Image

Owner = NDArray[np.uint16]  # (h, w): number of the part of each pixel, from 1

THINNEST = 2.5  # px: a component with a smaller inscribed circle is not taken apart
BLOB_SHARE = 0.5  # of the inscribed radius: thinner parts are cords, arms of clamps, fingers


@dataclass(frozen=True, eq=False, slots=True)
class BlobPart:
    """A part that was cut: its mask in a window whose corner is (left, top), and its inscribed radius, px.

    ``seed`` is the column and row of a pixel in its depth; ``whole`` and ``thickest`` are box and inscribed radius of
    the piece from which it was cut.
    """

    mask: Bytes
    left: int
    top: int
    inscribed: float
    seed: tuple[int, int]
    whole: Box
    thickest: float


@dataclass(frozen=True, eq=False, slots=True)
class Cut:
    """The parts of a component, its depth (h, w), px, and how compact the parts are times how sharp their outlines."""

    parts: list[BlobPart]
    depth: Image
    clearness: float


def peak_of(mask: Bytes, level: Bytes) -> float:
    """Largest mean of 3 x 3 px of a difference (h, w), grey levels, within a mask, rounded."""
    return float(cv2.minMaxLoc(cv2.blur(level, (3, 3)), mask)[1])


def cut_at(mask: Bytes, level: Bytes, faintest: float, smallest: int) -> Cut:
    """Cut a component where it is thin: opening by half its thickness; pixels between parts are of the nearest.

    Parameters
    ----------
    mask, level
        The component and its difference (h, w), grey levels.
    faintest
        Least difference of the pixels that count.
    smallest
        Fewest pixels of a piece that is cut.
    """
    solid = filled(mask.view(np.bool_) & (level >= faintest))
    depth = depth_of(solid, exact=True)
    owner = np.zeros(mask.shape, dtype=np.uint16)
    count, pieces, stats, _ = cv2.connectedComponentsWithStats(solid, connectivity=8)
    cuts: list[_Seed] = []
    for number in range(1, count):
        if stats[number, cv2.CC_STAT_AREA] >= smallest:
            box = _box(stats[number])
            window = _window(box)
            cuts += _cut_piece(pieces[window] == number, depth[window], owner[window], box, len(cuts))
    parts = [_part(owner, cut, number) for number, cut in enumerate(cuts, start=1)]
    return Cut(parts, depth, _clearness(parts, level))


_Seed = tuple[tuple[int, int], float, Box, float]  # seed, inscribed radius, box and thickness of the piece


def _cut_piece(piece: Flags, depth: Image, owner: Owner, box: Box, before: int) -> list[_Seed]:
    """The seeds of one piece (h, w) in its box; ``owner`` is set to the number of the seed of each pixel."""
    inner = np.where(piece, depth, np.float32(0))
    thickest = float(inner.max())
    if thickest < THINNEST:
        owner[piece] = before + 1
        return [(_first_pixel(piece, box), thickest, box, thickest)]
    cut = BLOB_SHARE * thickest
    count, seeds, stats, _ = cv2.connectedComponentsWithStats(as_bytes(inner > cut), connectivity=8)
    nearest, found = np.full(piece.shape, np.inf, dtype=np.float32), []
    for number in range(1, count):
        left, top, right, bottom = _box(stats[number])
        reach = int(cut) + 2
        around = slice(max(0, top - reach), bottom + reach), slice(max(0, left - reach), right + reach)
        seed = seeds[around] == number
        away = depth_of(~seed, outside=False, exact=True)
        mine = piece[around] & (away <= cut + 1) & (away < nearest[around])
        owner[around][mine], nearest[around][mine] = before + number, away[mine]
        at = _first_pixel(seed, (around[1].start + box[0], around[0].start + box[1], 0, 0))
        found.append((at, float(inner[around][seed].max()), box, thickest))
    return found


def _first_pixel(flags: Flags, box: Box) -> tuple[int, int]:
    """Column and row of the first pixel of some flags in a window at the corner of a box."""
    row, column = divmod(int(flags.argmax()), flags.shape[1])
    return box[0] + column, box[1] + row


def _part(owner: Owner, cut: _Seed, number: int) -> BlobPart:
    seed, inscribed, whole, thickest = cut
    window = _window(whole)
    mine = as_bytes(owner[window] == number)
    left, top, width, height = cv2.boundingRect(mine)
    mask = np.ascontiguousarray(mine[top : top + height, left : left + width])
    return BlobPart(mask, whole[0] + left, whole[1] + top, inscribed, seed, whole, thickest)


def _clearness(parts: list[BlobPart], level: Bytes) -> float:
    """Compactness of the parts times the mean gradient (Sobel), grey levels a px, at their rims; 0 of none."""
    if not parts:
        return 0.0
    rim = np.zeros(level.shape, dtype=np.uint8)
    for part in parts:
        inner = cv2.erode(part.mask, SQUARE, borderType=cv2.BORDER_CONSTANT, borderValue=0)
        height, width = part.mask.shape
        rim[part.top : part.top + height, part.left : part.left + width] |= part.mask - inner
    on_rim = rim.view(np.bool_)
    across, down = (cv2.Sobel(level, cv2.CV_16S, *along)[on_rim].astype(np.float32) for along in ((1, 0), (0, 1)))
    area = sum(cv2.countNonZero(part.mask) for part in parts)
    compactness = sum(part.inscribed**2 for part in parts) / max(1, area)
    return float(compactness * np.hypot(across, down).mean() / 8)


def _box(stats: NDArray[np.int32]) -> Box:
    left, top, width, height = (int(value) for value in stats[:4])
    return (left, top, left + width, top + height)


def _window(box: Box) -> tuple[slice, slice]:
    return slice(box[1], box[3]), slice(box[0], box[2])
