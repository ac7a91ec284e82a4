"""Noise correlation between neighbouring pixels, measured from residuals, and the variance of sums over pixels."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from iris_sysid.types import Array

LAGS = 2  # px over which the correlation is measured
SIGNIFICANT = 3.0  # standard errors of a correlation


def noise_correlation(images: Iterable[tuple[Array, Array]]) -> Array | None:
    """Correlation (5, 5) of residuals by the distance of two pixels in rows and columns; None when they are white.

    ``images`` are residuals (h, w) over their sigma, zero where unknown, and 1 where known. Texture that a model
    does not follow and compression make neighbours alike. Only significant correlations are kept.
    """
    size = 2 * LAGS + 1
    product, count = np.zeros((size, size)), np.zeros((size, size))
    for residual, known in images:
        product += _lagged(residual)
        count += _lagged(known)
    if count[LAGS, LAGS] == 0 or product[LAGS, LAGS] == 0:
        return None
    correlation = product / np.maximum(count, 1.0)
    correlation /= correlation[LAGS, LAGS]
    correlation[np.abs(correlation) < SIGNIFICANT / np.sqrt(np.maximum(count, 1.0))] = 0.0
    return correlation if np.count_nonzero(correlation) > 1 else None


def _lagged(image: Array) -> Array:
    """Sums of products (5, 5) of an image with itself, shifted."""
    padded = np.pad(image, LAGS)
    shifts = range(-LAGS, LAGS + 1)
    shifted = [[np.roll(padded, (row, column), (0, 1)) for column in shifts] for row in shifts]
    return np.array([[float((padded * image).sum()) for image in line] for line in shifted])


def variance_of_sum(weights: Array, correlation: Array | None) -> float:
    """Variance of a sum over pixels with ``weights`` (h, w) of noise of unit variance; never below that of white noise.

    ``correlation`` (2m + 1, 2m + 1) is that of two pixels by their distance, None when the noise is white.
    """
    white = float((weights**2).sum())
    if correlation is None:
        return white
    spread = cv2.filter2D(weights, cv2.CV_64F, correlation, borderType=cv2.BORDER_CONSTANT)
    return max(white, float((weights * spread).sum()))
