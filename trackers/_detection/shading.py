"""Shading of a body: a polynomial in x and y through its pixels, continued over its window (numba: the loops)."""

# mypy: disallow-untyped-decorators=False
from __future__ import annotations

import numpy as np

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array
from trackers._frames.arrays import Image

INSIDE = 0.5  # px: a pixel deeper than this counts in the fit of the shading
TERMS, LINEAR = 6, 3  # of the quadratic polynomial, and of its linear part
OF_X, OF_Y = np.array([0, 1, 0, 2, 1, 0]), np.array([0, 0, 1, 0, 1, 2])  # powers of x and of y in each term
MIN_A_TERM, MAX_SHADED = 60, 1500  # pixels for each term; pixels to which it is fitted
EXPLAINED = 0.15  # of the variance that fewer terms leave
RIDGE = 1e-9  # of the mean square of the constant term, added to each: pixels in one line do not determine all terms


def shading(image: Image, depth: Image) -> Image:
    """The polynomial in x and y (channels, h, w), constant to quadratic, that fits the pixels inside; 0 without any.

    More terms must explain a good part of the residual of fewer: shading does, texture does not. It stays between the
    darkest and the brightest of these pixels.

    Parameters
    ----------
    image
        Grey levels (channels, h, w).
    depth
        Depth (h, w) of each pixel within the body, px.
    """
    inside = np.flatnonzero(depth > INSIDE)
    if not inside.size:
        return np.zeros(image.shape, dtype=np.float32)
    inside = inside[:: -(-inside.size // MAX_SHADED)]
    scene, limits, powers, moments, squares = _sums(image, inside)
    best = _fitted(powers[OF_X[:, np.newaxis] + OF_X, OF_Y[:, np.newaxis] + OF_Y], moments, squares)
    return np.asarray(_drawn(best, scene, limits, *depth.shape))


@kernel(nogil=True)
def _sums(image: Image, inside: Array) -> tuple[Array, Array, Array, Array, float]:
    """What a polynomial through some pixels, by their number in a channel (n,), follows from.

    Their middle and scale (3,), px, which give u and v; of the values the lowest, the highest and the mean (channels,
    3); sums of powers of u and v (5, 5); sums of the values about their mean times each term (channels, 6), and of
    their squares.
    """
    channels, width, count = len(image), image.shape[2], inside.size
    limits, moments = np.zeros((channels, 3)), np.zeros((channels, TERMS))
    limits[:, 0], limits[:, 1] = np.inf, -np.inf
    left, right, x, y = width, 0, 0, 0
    for k in range(count):
        row, column = inside[k] // width, inside[k] % width
        left, right, x, y = min(left, column), max(right, column), x + column, y + row
        for c in range(channels):
            value = np.float64(image[c, row, column])
            limits[c, 0], limits[c, 1] = min(limits[c, 0], value), max(limits[c, 1], value)
            limits[c, 2] += value
    limits[:, 2] /= count
    scene = np.array([x / count, y / count, max(1.0, (right - left) / 2)])
    powers, terms, squares = np.zeros((5, 5)), np.ones(TERMS), 0.0
    for k in range(count):
        row, column = inside[k] // width, inside[k] % width
        u, v = (column - scene[0]) / scene[2], (row - scene[1]) / scene[2]
        terms[1], terms[2], terms[3], terms[4], terms[5] = u, v, u * u, u * v, v * v
        of_u = 1.0
        for i in range(5):
            power = of_u
            for j in range(5 - i):
                powers[i, j] += power
                power *= v
            of_u *= u
        for c in range(channels):
            value = image[c, row, column] - limits[c, 2]  # squares of what is about 0 are exact
            squares += value * value
            for term in range(TERMS):
                moments[c, term] += value * terms[term]
    return scene, limits, powers, moments, squares


def _fitted(gram: Array, moments: Array, squares: float) -> Array:
    """Coefficients (channels, 6) of the polynomial that fits values of mean 0, from its normal equations."""
    count, residual, best = gram[0, 0], squares, np.zeros(moments.shape)
    gram.flat[:: TERMS + 1] += RIDGE * count
    for terms in (LINEAR, TERMS):
        if count < MIN_A_TERM * terms:
            break
        solved = np.linalg.solve(gram[:terms, :terms], moments[:, :terms].T).T
        spread = squares - float((solved * moments[:, :terms]).sum())
        if spread < (1 - EXPLAINED) * residual:
            best[:, :terms], residual = solved, spread
    return best


@kernel(nogil=True)
def _drawn(best: Array, scene: Array, limits: Array, height: int, width: int) -> Image:
    """The polynomial (channels, h, w) within its limits; the arguments are as :func:`_sums` gives them."""
    shade = np.empty((len(best), height, width), dtype=np.float32)
    across = (np.arange(width) - scene[0]) / scene[2]
    for c in range(len(best)):
        lowest, highest, level = limits[c]
        for y in range(height):
            v = (y - scene[1]) / scene[2]
            constant = level + best[c, 0] + v * (best[c, 2] + v * best[c, 5])
            slope, bend = best[c, 1] + v * best[c, 4], best[c, 3]
            for x in range(width):
                value = constant + across[x] * (slope + across[x] * bend)
                shade[c, y, x] = min(max(value, lowest), highest)
    return shade
