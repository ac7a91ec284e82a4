"""Excess scatter of samples about a smooth time series, beyond their standard errors, by local polynomials.

Errors from compression, flicker and the template are common to all pixels of a frame, so that a single frame does not
show them; the time series does. Local polynomials follow whatever is smooth; their residual is the scatter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array
from trackers._frames.arrays import MAD_TO_SD

DEGREE, HIGHER = 4, 6  # of the polynomial through a window, and of one that shows whether that follows the time series
HALF_WINDOWS = (25, 15, 8)  # samples on either side: the longest through which the polynomial follows the time series
FOLLOWS = 0.8  # of the residual remains after the higher degree where the lower one follows the time series
HALF_MEAN = 20  # samples on either side over which the scatter is averaged
OUTLIER = 6.0  # standard deviations: a sample farther off, e.g. at a kink, counts as one that far off
MIN_SAMPLES = 12  # least number of samples for an estimate
BLOCK = 1000  # samples at once


def excess_scatter(t_s: Array, values: Array, sigma: Array, longest: int = 0) -> Array:
    """Scatter of samples (n,) about a smooth time series, over their ``sigma`` (n,): factors (n,), 1 or more.

    A polynomial of degree 4 is fitted to each sample's neighbourhood; the residual at its middle, over its own
    standard deviation for white noise, is squared and averaged over the neighbours. All arrays are of samples that
    are known, in order of time. ``longest`` samples on either side are tried as well, for what is slow throughout.
    """
    n = values.size
    if n < MIN_SAMPLES:
        return np.ones(n)
    for half in sorted({min(half, (n - 1) // 2) for half in (*HALF_WINDOWS, longest) if half}, reverse=True):
        ratio = _residuals(t_s, values, sigma, half, DEGREE)
        if _scale(_residuals(t_s, values, sigma, half, HIGHER)) > FOLLOWS * _scale(ratio):
            break
    square = np.minimum(ratio**2, (OUTLIER * max(_scale(ratio), 1.0)) ** 2)
    return np.asarray(np.sqrt(np.maximum(_averaged(square), 1.0)))


def _scale(ratio: Array) -> float:
    return MAD_TO_SD * float(np.median(np.abs(ratio)))


def _averaged(values: Array) -> Array:
    """Mean (n,) over the neighbours, the near ones counting more."""
    weight = np.hanning(2 * min(HALF_MEAN, (values.size - 1) // 2) + 3)[1:-1]
    return np.asarray(np.convolve(values, weight, "same") / np.convolve(np.ones(values.size), weight, "same"))


def _residuals(t_s: Array, values: Array, sigma: Array, half: int, degree: int) -> Array:
    """Residual (n,) of each sample from the polynomial through its window, over its standard deviation."""
    n = values.size
    blocks = [np.arange(start, min(start + BLOCK, n)) for start in range(0, n, BLOCK)]
    return np.concatenate([_residuals_of(t_s, values, sigma, block, half, degree) for block in blocks])


def _residuals_of(t_s: Array, values: Array, sigma: Array, which: NDArray[np.int64], half: int, degree: int) -> Array:
    first = np.clip(which - half, 0, values.size - 2 * half - 1)
    window = first[:, np.newaxis] + np.arange(2 * half + 1)
    u = t_s[window] - t_s[which][:, np.newaxis]
    u /= np.abs(u).max(axis=1, keepdims=True)
    terms = u[..., np.newaxis] ** np.arange(min(degree, 2 * half - 1) + 1) / sigma[window][..., np.newaxis]
    inverse = np.linalg.pinv(terms)  # (k, p, w)
    level = np.einsum("kw,kw->k", inverse[:, 0], values[window] / sigma[window])
    own = (window == which[:, np.newaxis]).argmax(axis=1)
    # the polynomial's value at the sample is its constant term; how much of it comes from the sample itself
    leverage = inverse[np.arange(which.size), 0, own] / sigma[which]
    return np.asarray((values[which] - level) / (sigma[which] * np.sqrt(np.maximum(1 - leverage, 1e-3))))


def pooled(sigma: Array) -> Array:
    """Standard errors (n,) with each variance averaged over its neighbours: few blocks or strips determine it badly.

    In px.
    """
    return np.asarray(np.sqrt(_averaged(sigma**2)))


def persistent(sigma: Array) -> Array:
    """Standard errors (n,) raised to their median where they are below it.

    In px.

    Where a time series is slow, a compressed image stays behind it as far as elsewhere, but smoothly: nothing scatters.
    """
    return np.asarray(np.maximum(sigma, np.median(sigma)))
