"""Shading of a body: a polynomial in x and y through its pixels, continued over its window."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array
from trackers._frames.arrays import Image

INSIDE = 0.5  # px: a pixel deeper than this counts in the fit of the shading
TERMS, LINEAR = 6, 3  # of the quadratic polynomial, and of its linear part
BY_POWERS = np.array([[0, 1, 3], [2, 4, 6], [5, 6, 6]])  # number of the term by its powers of y and x; 6 where none is
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
    height, width = depth.shape
    rows, columns = np.divmod(inside[:: -(-inside.size // MAX_SHADED)], width)
    values = image[:, rows, columns].astype(np.float64, order="C")
    lowest, highest, level = values.min(axis=1), values.max(axis=1), values.sum(axis=1) / rows.size
    values -= level[:, np.newaxis]  # squares of what is about 0 are exact
    x, y = columns.sum() / rows.size, rows.sum() / rows.size
    scale = max(1.0, (columns.max() - columns.min()) / 2)
    best = _fitted((columns - x) / scale, (rows - y) / scale, values)
    best[:, 0] += level
    across, down = (np.vander((np.arange(size) - at) / scale, 3, True) for size, at in ((width, x), (height, y)))
    shade = (down @ best[:, BY_POWERS] @ across.T).astype(np.float32).reshape(len(image), -1)
    lowest, highest = (limit.astype(np.float32)[:, np.newaxis] for limit in (lowest, highest))
    return np.minimum(np.maximum(shade, lowest, out=shade), highest, out=shade).reshape(image.shape)


def _fitted(u: Array, v: Array, values: Array) -> Array:
    """Coefficients (channels, 7) of the polynomial that fits values (channels, n) of mean 0; the last of them is 0."""
    channels, count = values.shape
    powers = np.array([np.ones(count), u, v, u * u, u * v, v * v])
    gram, moments = powers @ powers.T, values @ powers.T
    gram.flat[:: TERMS + 1] += RIDGE * count
    best, squares = np.zeros((channels, TERMS + 1)), float(np.vdot(values, values))
    residual = squares
    for terms in (LINEAR, TERMS):
        if count < MIN_A_TERM * terms:
            break
        solved = np.linalg.solve(gram[:terms, :terms], moments[:, :terms].T).T
        spread = squares - float((solved * moments[:, :terms]).sum())
        if spread < (1 - EXPLAINED) * residual:
            best[:, :terms], residual = solved, spread
    return best
