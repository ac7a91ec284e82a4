"""Exact area coverage of polygons on a pixel grid, and blending through it, row by row (numba).

The signed area that each edge cuts off in each pixel is summed into a buffer; the running sum along a row is the
covered fraction of each pixel (a box filter, evaluated exactly). Many polygons may share one buffer with weights:
that is how motion blur (sub-exposures) and penumbras (growing outlines) are integrated. Cost follows the pixels
touched, not the bounding box. Method: R. Levien, "font-rs", 2016; Catmull's area sampling, SIGGRAPH 1978.

Vertices are in pixels with the origin at the centre of pixel (0, 0), as everywhere.
"""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

Plane = NDArray[np.float32]
Rows = NDArray[np.int64]


class Canvas:
    """Reusable buffer for the coverage of one shape at a time on a grid of ``width`` by ``height`` pixels.

    Between shapes the buffer is zero everywhere; ``first`` and ``last`` (height,) bound the columns touched in a row.
    """

    def __init__(self, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.area = np.zeros((height, width + 2))
        self.first = np.full(height, width + 2, dtype=np.int64)
        self.last = np.full(height, -1, dtype=np.int64)
        self.top, self.bottom = height, 0

    def add(self, polygons_px: Array, weights: Array) -> None:
        """Add polygons (k, v, 2) px, each with its weight (k,); either orientation, closed by itself."""
        low = float(np.min(polygons_px[..., 1])) + 0.5
        high = float(np.max(polygons_px[..., 1])) + 0.5
        self.top = min(self.top, max(0, math.floor(low)))
        self.bottom = max(self.bottom, min(self.height, math.ceil(high)))
        _add_polygons(self.area, self.first, self.last, self.width, self.height, polygons_px, weights)

    @property
    def rows(self) -> tuple[int, int]:
        """Rows touched since the buffer was last taken: start and stop."""
        return (self.top, self.bottom) if self.bottom > self.top else (0, 0)

    def columns(self) -> tuple[int, int]:
        """Columns touched since the buffer was last taken: start and stop."""
        top, bottom = self.rows
        if bottom == top:
            return (0, 0)
        return int(self.first[top:bottom].min(initial=self.width)), int(self.last[top:bottom].max(initial=-1)) + 1

    def taken(self) -> None:
        """Forget which rows were touched; the blending kernels have zeroed the buffer."""
        self.top, self.bottom = self.height, 0


# Shading: centre x, y (px), 1/radius, light gradient along x and y, darkening towards the limb.
NO_SHADING: Array = np.zeros(6)


def blend(planes: Sequence[Plane], canvas: Canvas, tones: Sequence[float], shading: Array = NO_SHADING) -> None:
    """Lay tones over planes of one size through the coverage in the canvas, and empty the canvas.

    Parameters
    ----------
    planes
        (height, width) float32 grey levels each, changed in place.
    canvas
        Holds the coverage; is zero afterwards.
    tones
        Level of the shape in each plane.
    shading
        (6,): centre x, y (px), 1/radius (1/px), gradient along x, along y, darkening towards the limb.
    """
    for left, plane, tone in zip(reversed(range(len(planes))), planes, tones, strict=True):
        _blend_rows(plane, canvas.area, canvas.first, canvas.last, *canvas.rows, tone, shading, left == 0)
    canvas.taken()


# --------------------------------------------------------------------------- kernels


@kernel(nogil=True)
def _add_polygons(
    area: Array, first: Rows, last: Rows, width: int, height: int, polygons: Array, weights: Array
) -> None:
    count = polygons.shape[1]
    for k in range(polygons.shape[0]):
        for j in range(count):
            i = j - 1 if j > 0 else count - 1
            start = (polygons[k, i, 0] + 0.5, polygons[k, i, 1] + 0.5)
            stop = (polygons[k, j, 0] + 0.5, polygons[k, j, 1] + 0.5)
            if start[1] < stop[1]:
                _add_edge(area, first, last, (width, height), start, stop, weights[k])
            elif start[1] > stop[1]:
                _add_edge(area, first, last, (width, height), stop, start, -weights[k])


@kernel(nogil=True, inline="always")
def _add_edge(
    area: Array,
    first: Rows,
    last: Rows,
    size: tuple[int, int],
    start: tuple[float, float],
    stop: tuple[float, float],
    weight: float,
) -> None:
    """One edge that runs downwards, cut at the left and right borders: what is outside still counts to its right."""
    width, height = size
    slope = (stop[0] - start[0]) / (stop[1] - start[1])
    y, y_end = max(start[1], 0.0), min(stop[1], float(height))
    if y < y_end and min(start[0], stop[0]) >= 0.0 and max(start[0], stop[0]) <= width:
        x, x_cut = start[0] + (y - start[1]) * slope, start[0] + (y_end - start[1]) * slope
        _add_inside(area, first, last, x, y, x_cut, y_end, weight)
        return
    while y < y_end:
        y_cut = min(y_end, _next_border(start, slope, y, float(width)))
        x, x_cut = start[0] + (y - start[1]) * slope, start[0] + (y_cut - start[1]) * slope
        side = min(max(0.5 * (x + x_cut), 0.0), float(width))
        if side in (0.0, float(width)):  # beyond a border: as if it ran along the border
            x = x_cut = side
        _add_inside(area, first, last, _clip(x, width), y, _clip(x_cut, width), y_cut, weight)
        y = y_cut


@kernel(nogil=True)
def _next_border(start: tuple[float, float], slope: float, y: float, width: float) -> float:
    """Where below y an edge next crosses x = 0 or x = width; infinity when it does not."""
    nearest = np.inf
    if slope != 0.0:
        for border in (0.0, width):
            crossing = start[1] + (border - start[0]) / slope
            if y + 1e-12 < crossing < nearest:
                nearest = crossing
    return nearest


@kernel(nogil=True)
def _clip(x: float, width: int) -> float:
    return min(max(x, 0.0), float(width))


@kernel(nogil=True, inline="always")
def _add_inside(
    area: Array, first: Rows, last: Rows, x: float, y: float, x_stop: float, y_stop: float, weight: float
) -> None:
    """Signed area to the right of an edge that runs downwards inside the grid, row by row."""
    slope = (x_stop - x) / (y_stop - y)
    row = math.floor(y)
    while y < y_stop:
        below = min(float(row + 1), y_stop)
        x_next = x + (below - y) * slope if below < y_stop else x_stop
        _add_row(area, first, last, row, min(x, x_next), max(x, x_next), (below - y) * weight)
        x, y, row = x_next, below, row + 1


@kernel(nogil=True, inline="always")
def _add_row(area: Array, first: Rows, last: Rows, row: int, low: float, high: float, height: float) -> None:
    """Spread an edge piece of signed height, from x = low to high within one row, over that row's pixels."""
    start = max(math.floor(low), 0)  # a rounding error may lie left of the border
    stop = math.ceil(high)
    if start < first[row]:
        first[row] = start
    if max(stop, start + 1) > last[row]:
        last[row] = max(stop, start + 1)
    if stop <= start + 1:
        right = 0.5 * (low + high) - start
        area[row, start] += height * (1.0 - right)
        area[row, start + 1] += height * right
        return
    density = height / (high - low)
    carried = 0.0  # area to the right within the pixels passed: cumulative coverage so far
    for column in range(start, stop):
        begin = max(low, float(column))
        end = min(high, float(column + 1))
        piece = density * (end - begin)
        right = 0.5 * (begin + end) - column
        area[row, column] += piece * (1.0 - right)
        carried = piece * right
        area[row, column + 1] += carried


@kernel(nogil=True)
def _blend_rows(
    plane: Plane,
    area: Array,
    first: Rows,
    last: Rows,
    top: int,
    bottom: int,
    tone: float,
    shading: Array,
    empty: bool,
) -> None:
    """Lay the tone over the rows from ``top`` up to ``bottom``; ``empty`` makes the buffer zero again."""
    width = plane.shape[1]
    centre_x, centre_y, inverse, along_x, along_y, limb = shading
    for row in range(top, bottom):
        inside = 0.0
        for column in range(first[row], last[row] + 1):
            inside += area[row, column]
            if empty:
                area[row, column] = 0.0
            if column >= width:
                continue
            alpha = min(abs(inside), 1.0)
            if alpha > 0.0:
                u = (column - centre_x) * inverse
                v = (row - centre_y) * inverse
                light = 1.0 + along_x * u + along_y * v - limb * (u * u + v * v)
                plane[row, column] += alpha * (tone * light - plane[row, column])
        if empty:
            first[row] = width + 2
            last[row] = -1
