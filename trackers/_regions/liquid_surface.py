"""Liquid surface in a vessel: the region it sweeps, the appearance above and below it, its row in each frame."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Array
from trackers._frames.arrays import MAD_TO_SD, Bytes

MIN_CHANGE = 12.0  # grey levels between full and empty
MIN_HEIGHT = 4  # px that the surface sweeps
MIN_WIDTH = 8  # px
FULL_HEIGHT = 0.8  # of the tallest column: the vessel is as wide as its columns are swept so far
WALL = 0.08  # of the width, on either side: there the liquid climbs the wall
STEPWISE = 0.8  # of the changing pixels must be one step in time
STRIPS = 24  # into which the width is divided
CLEAR = 4  # px above or below the surface from which a pixel shows one side alone
WINDOW = 10  # px above and below the surface whose pixels are compared
MIN_ROOM = 3  # px that must show on either side of the surface
TUKEY = 5.0  # standard deviations from which a strip does not count
MAX_OFF = 0.5  # of the strips may not keep to the surface
MIN_SCATTER = 5e-3  # px: of strips that agree to the last digit in an image without noise
MIN_CONTRAST = 4.0  # grey levels, of a strip


@dataclass(frozen=True, slots=True)
class Vessel:
    """Rows and columns that a surface sweeps, px of the view."""

    left: int
    right: int
    top: int
    bottom: int

    @property
    def middle(self) -> float:
        """Column midway between the walls, px."""
        return (self.left + self.right - 1) / 2


def vessel_of(stack: Bytes) -> Vessel:
    """The largest upright region of samples (k, h, w) whose pixels change; TrackingError when none do."""
    change = cv2.GaussianBlur((stack.max(axis=0) - stack.min(axis=0)).astype(np.float32), (0, 0), 1.0)
    high = float(np.percentile(change, 99.9))
    mask = (change > max(MIN_CHANGE, 0.4 * high)).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((MIN_HEIGHT, MIN_WIDTH), np.uint8))
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    if count < 2:
        raise TrackingError(
            "no surface moves in the clip: no region changes its brightness enough; "
            "check --start and --stop, and --roi if given"
        )
    largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    heights = (labels == largest).sum(axis=0)
    columns = np.flatnonzero(heights >= FULL_HEIGHT * heights.max())
    rows = np.flatnonzero((labels == largest)[:, columns].mean(axis=1) > 0.5)
    if columns.size < MIN_WIDTH or rows.size < MIN_HEIGHT:
        raise TrackingError(
            f"no surface moves in the clip: the region that changes is {columns.size} px wide and {rows.size} px high; "
            "restrict the region with --roi"
        )
    return Vessel(int(columns[0]), int(columns[-1]) + 1, int(rows[0]), int(rows[-1]) + 1)


def rough_levels(rows_over_time: Array) -> Array:
    """Surface in samples (k, rows) of swept rows in order of time, as rows from the first: the best step of each row.

    Samples are grey levels, rows are in units of the spacing.

    TrackingError when the rows do not change once and stay, as a surface that rises or falls makes them.
    """
    steps, explained = _steps(rows_over_time)
    if explained < STEPWISE:
        raise TrackingError(
            f"this is not the surface of a liquid: only {explained:.0%} of the change is one lasting step, as when "
            "something passes; restrict the region to the vessel with --roi, or use another tracker"
        )
    falls = np.polyfit(np.arange(steps.size), steps, 1)[0] > 0
    k = np.arange(len(rows_over_time))[:, np.newaxis]
    below = (k < steps) if falls else (k >= steps)
    return np.asarray(steps.size - 0.5 - below.sum(axis=1))


def _steps(rows_over_time: Array) -> tuple[Array, float]:
    """First sample (rows,) after the change of each row, and the share of the variance that these steps explain."""
    k = len(rows_over_time)
    total = rows_over_time.var(axis=0) * k
    sums = np.cumsum(rows_over_time, axis=0)[:-1]
    n = np.arange(1, k)[:, np.newaxis]
    between = (sums - n * rows_over_time.mean(axis=0)) ** 2 * k / (n * (k - n))
    best = between.argmax(axis=0)
    return best + 1, float(between.max(axis=0).sum() / max(float(total.sum()), 1e-9))


@dataclass(frozen=True, eq=False, slots=True)
class Surface:
    """What the strips of a vessel (rows, strips) show ``above`` the surface and ``below`` it.

    ``x`` (strips,) are the middles of the strips, px from midway between the walls.
    """

    above: Array
    below: Array
    x: Array

    def level(self, strips: Array) -> tuple[float, float]:
        """Row of the surface midway between the walls and its standard error, px, in an image (rows, strips).

        NaN where the surface is not in the image or does not keep to a straight line.
        """
        rough = self._rough(strips)
        for _ in range(2):
            if not MIN_ROOM <= rough + 0.5 <= len(strips) - MIN_ROOM:
                return float("nan"), float("nan")
            heights = self._filled(strips, rough)
            row, sigma = _midway(heights, self.x)
            rough = row if np.isfinite(row) else rough
        return row, sigma

    def _rough(self, strips: Array) -> float:
        """The first row that looks as below the surface, to about a pixel."""
        above = ((strips - self.above) ** 2).sum(axis=1)
        below = ((strips - self.below) ** 2).sum(axis=1)
        cost = np.concatenate([[0.0], np.cumsum(above)]) + np.concatenate([np.cumsum(below[::-1])[::-1], [0.0]])
        return float(np.argmin(cost)) - 0.5

    def _filled(self, strips: Array, rough: float) -> Array:
        """Row (strips,) of the surface in each strip: how much of a window about it is below the surface.

        What is farther than ``CLEAR`` from it shows by how much the light differs from that of the samples.
        """
        first, last = max(0, round(rough) - WINDOW), min(len(strips), round(rough) + WINDOW + 1)
        rows = np.arange(first, last)
        seen, above, below = strips[rows], self.above[rows], self.below[rows]
        over, under = rows < rough - CLEAR, rows > rough + CLEAR
        if over.any():
            above = above + (seen - above)[over].mean(axis=0)
        if under.any():
            below = below + (seen - below)[under].mean(axis=0)
        contrast = (below - above).mean(axis=0)
        contrast = np.where(np.abs(contrast) < MIN_CONTRAST, np.nan, contrast)
        edge = ~(over | under)
        share = (seen - above)[edge].sum(axis=0) / contrast
        return np.asarray(rows[edge][-1] + 0.5 - share)


def surface_of(stack: Array, levels: Array, x: Array) -> Surface:
    """Both sides of the surface from samples (k, rows, strips) in which it stands at rows ``levels`` (k,).

    Samples are grey levels; ``levels`` are in rows, ``x`` (strips,) in px.

    A row that never was on one side is given the appearance of the nearest row that was.
    """
    row, parts = np.arange(stack.shape[1]), []
    for side in (-1, 1):
        clear = (side * (row - levels[:, np.newaxis]) > CLEAR).astype(np.float64)
        count = clear.sum(axis=0)
        seen = np.flatnonzero(count)
        if seen.size == 0:
            where = "above" if side < 0 else "below"
            raise TrackingError(f"the image shows nothing {where} the surface; give a taller region with --roi")
        look = np.einsum("kr,krs->rs", clear, stack)[seen] / count[seen, np.newaxis]
        parts.append(look[np.argmin(np.abs(row[:, np.newaxis] - seen), axis=1)])
    return Surface(parts[0], parts[1], x)


def _midway(heights: Array, x: Array) -> tuple[float, float]:
    """Row at x = 0 of the straight line through the heights (strips,), and its standard error; robust."""
    known = np.isfinite(heights)
    terms = np.column_stack([np.ones(x.size), x / np.abs(x).max()])
    weight = known.astype(np.float64)
    heights = np.where(known, heights, 0.0)
    for _ in range(5):
        if np.count_nonzero(weight) <= MAX_OFF * x.size:
            return float("nan"), float("nan")
        information = (terms * weight[:, np.newaxis]).T @ terms
        line = np.linalg.solve(information, (terms * weight[:, np.newaxis]).T @ heights)
        residual = heights - terms @ line
        scale = max(MAD_TO_SD * float(np.median(np.abs(residual[known]))), MIN_SCATTER)
        weight = np.where(known, np.maximum(0.0, 1 - (residual / (TUKEY * scale)) ** 2) ** 2, 0.0)
    free = max(float(weight.sum()) - 2, 1.0)
    variance = max(float((weight * residual**2).sum()) / free, MIN_SCATTER**2)
    return float(line[0]), float(np.sqrt(variance * np.linalg.inv(information)[0, 0]))
