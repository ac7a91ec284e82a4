"""Maps of the image plane fitted to points, with robust weights and their covariance."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from iris_sysid.types import Array, Mask, mapped

MIN_POINTS = 8
CUTOFF = 4.685  # of Tukey's weights, in standard deviations: 95 % efficient for normal errors
MAD_TO_SD = 1.4826
ROUNDS = 6
MIN_SD = 0.01  # px: points closer than this are equally good
CLUSTERS = 6  # tiles a side: errors of points in one tile are taken to be alike


@dataclass(frozen=True, eq=False, slots=True)
class Fit:
    """A map (2, 3), the covariance (6, 6) of its numbers, the weights (n,) of the points and their spread, px."""

    motion: Array
    covariance: Array
    weight: Array
    spread: float


# from shift x, shift y, stretch and turn of a similarity to the entries of its map (2, 3), row by row
ENTRIES = np.zeros((6, 4))
ENTRIES[2, 0] = ENTRIES[5, 1] = 1.0
ENTRIES[[0, 4], 2] = 1.0
ENTRIES[1, 3], ENTRIES[3, 3] = -1.0, 1.0


def basis(points: Array) -> Array:
    """Derivatives (n, 2, 4) of the image of points (n, 2) px by shift x, shift y, stretch and turn."""
    x, y = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    columns = [(one, zero), (zero, one), (x, y), (-y, x)]
    return np.stack([np.stack(column, axis=-1) for column in columns], axis=-1)


def first_guess(points: Array, places: Array, tolerance_px: float) -> Array | None:
    """The similarity (2, 3) px by which most points (n, 2) reach their places (n, 2), by random sampling."""
    if len(points) < MIN_POINTS:
        return None
    motion, _ = cv2.estimateAffinePartial2D(points, places, ransacReprojThreshold=tolerance_px, maxIters=500)
    return None if motion is None else np.asarray(motion, dtype=np.float64)


def fitted(points: Array, places: Array, start: Array, prior: Array | None = None) -> Fit | None:
    """The similarity from points (n, 2) px to their places (n, 2) px by weighted least squares; None for too few.

    Tukey's weights leave out points that move otherwise. Covariance robust to clusters: errors of points in one tile of
    the image are alike (compression, light, depth).

    Parameters
    ----------
    points, places
        Positions (n, 2), px; NaN where a point was not found. ``points`` are about the centre of the image.
    start
        A map (2, 3) within a few px of the right one.
    prior
        Weights (n,) of the points, by how well they follow in other frames.
    """
    seen = np.isfinite(places).all(axis=1) & np.isfinite(points).all(axis=1)
    given = np.where(seen, 1.0, 0.0) if prior is None else np.where(seen, prior, 0.0)
    if np.count_nonzero(given) < MIN_POINTS:
        return None
    design, rows = basis(points[seen]), given[seen]
    motion, spread, weight = start, np.inf, rows
    for _ in range(ROUNDS):
        residual = places[seen] - mapped(motion, points[seen])
        weight, spread = _tukey(residual, rows)
        if np.count_nonzero(weight) < MIN_POINTS:
            return None
        numbers = _solved(design, places[seen], weight)
        motion = (ENTRIES @ numbers).reshape(2, 3)
    residual = places[seen] - mapped(motion, points[seen])
    covariance = _sandwich(design, residual, weight, _tiles(points[seen]))
    whole = np.zeros(len(points))
    whole[seen] = weight
    return Fit(motion, ENTRIES @ covariance @ ENTRIES.T, whole, spread)


def _tukey(residual: Array, given: Array) -> tuple[Array, float]:
    distance = np.hypot(*residual.T)
    counted = given > 0
    # the median of a distance in the plane is 1.1774 standard deviations
    spread = max(MIN_SD, float(np.median(distance[counted])) / 1.1774)
    return given * np.maximum(1 - (distance / (CUTOFF * spread)) ** 2, 0.0) ** 2, spread


def _solved(design: Array, places: Array, weight: Array) -> Array:
    normal = np.einsum("nap,n,naq->pq", design, weight, design)
    right = np.einsum("nap,n,na->p", design, weight, places)
    return np.asarray(np.linalg.lstsq(normal, right, rcond=None)[0])


def _tiles(points: Array) -> Array:
    """The number (n,) of the tile in which each point lies; tiles hold about the same number of points along x."""
    low, high = points.min(axis=0), points.max(axis=0)
    cell = np.minimum((points - low) / np.maximum(high - low, 1e-9) * CLUSTERS, CLUSTERS - 1).astype(int)
    return np.asarray(cell[:, 0] * CLUSTERS + cell[:, 1])


def _sandwich(design: Array, residual: Array, weight: Array, tiles: Array) -> Array:
    """Covariance (p, p) of the numbers, robust to clusters (Liang and Zeger 1986), for few clusters enlarged."""
    p = design.shape[2]
    scores = np.einsum("nap,n,na->np", design, weight, residual)
    sums = np.zeros((CLUSTERS * CLUSTERS, p))
    np.add.at(sums, tiles.astype(int), scores)
    count = len(np.unique(tiles[weight > 0]))
    inverse = np.linalg.pinv(np.einsum("nap,n,naq->pq", design, weight, design), hermitian=True)
    enlarged = count / max(count - p / 2, 1.0)
    return np.asarray(enlarged * inverse @ (sums.T @ sums) @ inverse)


def moved_together(places: Array, points: Array, motion: Array, tolerance_px: float) -> Mask:
    """Which points lie near where a map takes them.

    Parameters
    ----------
    places
        Where they lie (n, 2), px.
    points
        What is mapped (n, 2), px.
    motion
        The map (2, 3).
    tolerance_px
        How near, px.
    """
    distance = np.hypot(*(places - mapped(motion, points)).T)
    return np.asarray(np.nan_to_num(distance, nan=np.inf) < tolerance_px)
