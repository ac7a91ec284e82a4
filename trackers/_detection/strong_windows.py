"""Windows of an image that hold all strong differences from the background: the rest need not be searched."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from trackers._frames.arrays import Box, Bytes

TILE = 16  # px, side of the squares that are marked where they hold a difference
AROUND = 8  # px round them at first
WORD = 8  # bytes compared with 0 at once
HALF = 0.5  # of the image: if windows cover more of it, the whole is as quick


def windows_of(strong: Bytes) -> list[Box]:
    """Boxes that do not overlap and hold every pixel of a mask (h, w) that is not 0, with some px round it."""
    return boxes_of_tiles(tiles_of(strong, TILE), (strong.shape[1], strong.shape[0]))


def tiles_of(mask: Bytes, side: int) -> Bytes:
    """1 for each square, ``side`` px a side, that may hold pixels of a mask (h, w) that are not 0; 0 for the others."""
    height, width = mask.shape
    grid = np.zeros((-(-height // side), -(-width // side)), dtype=np.uint8)
    first = _words(mask)
    for place in (first, np.minimum(first + WORD - 1, mask.size - 1)):  # a word may end in the next tile, or row
        grid[place // width // side, place % width // side] = 1
    return grid


def boxes_of_tiles(grid: Bytes, size: tuple[int, int]) -> list[Box]:
    """Boxes that do not overlap and hold the squares of a grid that are not 0, in an image of that width and height."""
    if not grid.any():
        return []
    count, _, stats, _ = cv2.connectedComponentsWithStats(grid, connectivity=8)
    boxes = [(int(x), int(y), int(x + w), int(y + h)) for x, y, w, h, _ in stats[1:count]]
    tiles = (tuple(side * TILE for side in box) for box in boxes)
    return merged(grown((x0, y0, x1, y1), AROUND, size) for x0, y0, x1, y1 in tiles)


def _words(mask: Bytes) -> np.ndarray:
    """Where, in the order of the pixels, words of a mask begin that are not 0."""
    flat = np.ascontiguousarray(mask).ravel()
    end = flat.size - flat.size % WORD
    places = WORD * np.flatnonzero(flat[:end].view(np.uint64))
    return np.concatenate([places, end + np.flatnonzero(flat[end:])])


def grown(box: Box, by: int, size: tuple[int, int]) -> Box:
    """A box made larger by ``by`` px on every side, within an image of that width and height."""
    return (max(0, box[0] - by), max(0, box[1] - by), min(size[0], box[2] + by), min(size[1], box[3] + by))


def are_most(boxes: Iterable[Box], size: tuple[int, int]) -> bool:
    """Whether some boxes cover most of an image of that width and height."""
    return sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in boxes) > HALF * size[0] * size[1]


def merged(boxes: Iterable[Box]) -> list[Box]:
    """Boxes that hold all of those given and do not overlap each other."""
    apart: list[Box] = []
    for box in boxes:
        while near := [other for other in apart if overlap(box, other)]:
            apart = [other for other in apart if other not in near]
            all_boxes = (box, *near)
            box = (
                min(b[0] for b in all_boxes),
                min(b[1] for b in all_boxes),
                max(b[2] for b in all_boxes),
                max(b[3] for b in all_boxes),
            )
        apart.append(box)
    return apart


def overlap(box: Box, other: Box) -> bool:
    """Whether two boxes have a pixel in common."""
    return box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]
