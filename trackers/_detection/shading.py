"""Shading of a body: a polynomial in x and y through its pixels, continued over its window (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._frames.arrays import Flags, Image

INSIDE = 0.5  # px: a pixel deeper than this counts in the fit of the shading
TERMS, LINEAR = 6, 3  # of the quadratic polynomial, and of its linear part
MIN_A_TERM, MAX_SHADED = 60, 1500  # pixels for each term; pixels to which it is fitted
EXPLAINED = 0.15  # of the variance that fewer terms leave
RIDGE = 1e-9  # of the mean square of the constant term, added to each: pixels in one line do not determine all terms


def shading(image: Image, depth: Image, near: Flags) -> Image:
    """The polynomial in x and y (channels, h, w), constant to quadratic, that fits the pixels inside.

    More terms must explain a good part of the residual of fewer: shading does, texture does not. It stays between the
    darkest and the brightest of these pixels.

    Parameters
    ----------
    image
        Grey levels (channels, h, w).
    depth
        Depth (h, w) of each pixel within the body, px.
    near
        Pixels (h, w) at which the polynomial is evaluated, besides those inside; elsewhere it is 0.
    """
    inside = np.flatnonzero(depth > INSIDE)
    if not inside.size:
        return np.zeros(image.shape, dtype=np.float32)
    rows, columns = np.divmod(inside[:: -(-inside.size // MAX_SHADED)], depth.shape[1])
    values = image[:, rows, columns].astype(np.float64, order="C")
    level = values.mean(axis=1)
    values -= level[:, np.newaxis]  # squares of what is about 0 are exact
    middle = columns.mean(), rows.mean(), max(1.0, (columns.max() - columns.min()) / 2)
    best = _fitted(columns, rows, middle, values)
    best[:, 0] += level
    limits = values.min(axis=1) + level, values.max(axis=1) + level
    return np.asarray(_continued(best, middle, limits, near | (depth > 0)))


@kernel(nogil=True)
def _fill_terms(row: Array, u: float, v: float) -> None:
    """Set the terms (6,) of the polynomial at a place."""
    row[0], row[1], row[2], row[3], row[4], row[5] = 1.0, u, v, u * u, u * v, v * v


@kernel(nogil=True)
def _continued(best: Array, middle: tuple[float, float, float], limits: tuple[Array, Array], where: Flags) -> Image:
    """The polynomial (channels, h, w) of coefficients (channels, 6), within limits (channels,), at some pixels (h, w).

    ``middle`` are the column and the row of its centre, px, and its scale, px.
    """
    channels, (height, width) = best.shape[0], where.shape
    shade, row = np.zeros((channels, height, width), dtype=np.float32), np.empty(TERMS)
    for y in range(height):
        for x in range(width):
            if not where[y, x]:
                continue
            _fill_terms(row, (x - middle[0]) / middle[2], (y - middle[1]) / middle[2])
            for c in range(channels):
                level = 0.0
                for term in range(TERMS):
                    level += row[term] * best[c, term]
                shade[c, y, x] = min(max(level, limits[0][c]), limits[1][c])
    return shade


@kernel(nogil=True)
def _fitted(columns: Array, rows: Array, middle: tuple[float, float, float], values: Array) -> Array:
    """Coefficients (channels, 6) of the polynomial of the degree that fits values (channels, n) of mean 0."""
    channels, count = values.shape
    gram, moments, squares = np.zeros((TERMS, TERMS)), np.zeros((channels, TERMS)), 0.0
    row = np.empty(TERMS)
    for k in range(count):
        _fill_terms(row, (columns[k] - middle[0]) / middle[2], (rows[k] - middle[1]) / middle[2])
        for i in range(TERMS):
            for j in range(i + 1):
                gram[i, j] += row[i] * row[j]
            for c in range(channels):
                moments[c, i] += row[i] * values[c, k]
        for c in range(channels):
            squares += values[c, k] ** 2
    best, residual = np.zeros((channels, TERMS)), squares
    for i in range(TERMS):
        gram[i, i] += RIDGE * count
    for terms in (LINEAR, TERMS):
        if count < MIN_A_TERM * terms:
            break
        solved = _solved(gram, moments, terms)
        spread = squares - _product(solved, moments)
        if spread < (1 - EXPLAINED) * residual:
            best, residual = solved, spread
    return best


@kernel(nogil=True)
def _product(first: Array, second: Array) -> float:
    """Sum of the products of the elements of two arrays (m, n)."""
    total = 0.0
    for i in range(first.shape[0]):
        for j in range(first.shape[1]):
            total += first[i, j] * second[i, j]
    return total


@kernel(nogil=True)
def _solved(gram: Array, moments: Array, terms: int) -> Array:
    """Solution (channels, 6) of the first normal equations by Cholesky's method; the other coefficients are 0."""
    lower, solved = np.zeros((terms, terms)), np.zeros(moments.shape)
    for i in range(terms):
        for j in range(i + 1):
            rest = gram[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(rest) if i == j else rest / lower[j, j]
    for c in range(moments.shape[0]):
        for i in range(terms):
            rest = moments[c, i]
            for k in range(i):
                rest -= lower[i, k] * solved[c, k]
            solved[c, i] = rest / lower[i, i]
        for i in range(terms - 1, -1, -1):
            rest = solved[c, i]
            for k in range(i + 1, terms):
                rest -= lower[k, i] * solved[c, k]
            solved[c, i] = rest / lower[i, i]
    return solved
