"""Shading of a body: a polynomial in x and y through its pixels, continued over its window (numba)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import math

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._frames.arrays import Bytes, Image

INSIDE = 0.5  # px: a pixel deeper than this counts in the fit of the shading
TERMS, LINEAR = 6, 3  # of the quadratic polynomial, and of its linear part
MIN_A_TERM, MAX_SHADED = 60, 1500  # pixels for each term; pixels to which it is fitted
EXPLAINED = 0.15  # of the variance that fewer terms leave
RIDGE = 1e-9  # of the mean square of the constant term, added to each: pixels in one line do not determine all terms


@kernel(nogil=True)
def shading(image: Image, depth: Image, near: Bytes) -> Image:
    """The polynomial in x and y (h, w, channels), constant to quadratic, that fits the pixels inside.

    More terms must explain a good part of the residual of fewer: shading does, texture does not.

    Parameters
    ----------
    image
        Grey levels (h, w, channels).
    depth
        Depth (h, w) of each pixel within the body, px.
    near
        Pixels (h, w) at which the polynomial is evaluated, besides those inside; elsewhere it is 0.
    """
    height, width, channels = image.shape
    places, values = _inside(image, depth)
    shade = np.zeros((height, width, channels), dtype=np.float32)
    if not values.shape[0]:
        return shade
    x0, y0 = places[:, 0].mean(), places[:, 1].mean()
    scale = max(1.0, (places[:, 0].max() - places[:, 0].min()) / 2)
    terms = np.empty((values.shape[0], TERMS))
    for k in range(values.shape[0]):
        _fill_terms(terms[k], (places[k, 0] - x0) / scale, (places[k, 1] - y0) / scale)
    lowest, highest, row, middle = np.empty(channels), np.empty(channels), np.empty(TERMS), np.empty(channels)
    for c in range(channels):
        lowest[c], highest[c], middle[c] = values[:, c].min(), values[:, c].max(), values[:, c].mean()
        values[:, c] -= middle[c]  # squares of what is about 0 are exact
    best = _best(terms, values)
    best[0] += middle
    for y in range(height):
        for x in range(width):
            if not near[y, x] and depth[y, x] <= 0:
                continue
            _fill_terms(row, (x - x0) / scale, (y - y0) / scale)
            for c in range(channels):
                level = 0.0
                for term in range(TERMS):
                    level += row[term] * best[term, c]
                shade[y, x, c] = min(max(level, lowest[c]), highest[c])
    return shade


@kernel(nogil=True)
def _inside(image: Image, depth: Image) -> tuple[Array, Array]:
    """Column and row (n, 2) of pixels inside, evenly thinned, and their grey levels (n, channels)."""
    height, width, channels = image.shape
    count = 0
    for y in range(height):
        for x in range(width):
            count += depth[y, x] > INSIDE
    every = max(1, -(-count // MAX_SHADED))
    places, values = np.empty((-(-count // every), 2)), np.empty((-(-count // every), channels))
    number = 0
    for y in range(height):
        for x in range(width):
            if depth[y, x] > INSIDE:
                if number % every == 0:
                    places[number // every, 0], places[number // every, 1] = x, y
                    values[number // every] = image[y, x]
                number += 1
    return places, values


@kernel(nogil=True)
def _fill_terms(row: Array, u: float, v: float) -> None:
    """Set the terms (6,) of the polynomial at a place."""
    row[0], row[1], row[2], row[3], row[4], row[5] = 1.0, u, v, u * u, u * v, v * v


@kernel(nogil=True)
def _best(terms: Array, values: Array) -> Array:
    """Coefficients (6, channels) of the polynomial of the degree that fits the values (n, channels)."""
    count, channels = values.shape
    gram, moments, squares = np.zeros((TERMS, TERMS)), np.zeros((TERMS, channels)), 0.0
    for k in range(count):
        for i in range(TERMS):
            for j in range(i + 1):
                gram[i, j] += terms[k, i] * terms[k, j]
            for c in range(channels):
                moments[i, c] += terms[k, i] * values[k, c]
        for c in range(channels):
            squares += values[k, c] ** 2
    best = np.zeros((TERMS, channels))
    best[0] = moments[0] / count
    residual = _residual(gram, moments, squares, best)
    for i in range(TERMS):
        gram[i, i] += RIDGE * count
    for of_degree in (LINEAR, TERMS):
        if count < MIN_A_TERM * of_degree:
            break
        solved = cholesky_solved(gram, moments, of_degree)
        spread = _residual(gram, moments, squares, solved)
        if spread < (1 - EXPLAINED) * residual:
            best, residual = solved, spread
    return best


@kernel(nogil=True)
def _residual(gram: Array, moments: Array, squares: float, coefficients: Array) -> float:
    """Sum of squares that a polynomial leaves: v'v - 2 c'X'v + c'X'X c, of whose X'X the lower triangle is given."""
    total = squares
    for c in range(coefficients.shape[1]):
        for i in range(TERMS):
            total -= 2 * coefficients[i, c] * moments[i, c]
            for j in range(i):
                total += 2 * coefficients[i, c] * coefficients[j, c] * gram[i, j]
            total += coefficients[i, c] ** 2 * gram[i, i]
    return total


@kernel(nogil=True)
def cholesky_solved(gram: Array, moments: Array, count: int) -> Array:
    """Solution (6, channels) of the first normal equations by Cholesky's method; the other coefficients are 0."""
    lower, solved = np.zeros((count, count)), np.zeros(moments.shape)
    for i in range(count):
        for j in range(i + 1):
            rest = gram[i, j]
            for k in range(j):
                rest -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(rest) if i == j else rest / lower[j, j]
    for c in range(moments.shape[1]):
        for i in range(count):
            rest = moments[i, c]
            for k in range(i):
                rest -= lower[i, k] * solved[k, c]
            solved[i, c] = rest / lower[i, i]
        for i in range(count - 1, -1, -1):
            rest = solved[i, c]
            for k in range(i + 1, count):
                rest -= lower[k, i] * solved[k, c]
            solved[i, c] = rest / lower[i, i]
    return solved
