"""Polynomials fitted to a few neighbouring samples: the noise, the velocity, what does not fit its neighbours.

All take times ``t_s`` (n,) and positions ``values`` (n, d) of samples without gaps, in time order, evenly or not.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from iris_sysid.types import Array

NORMAL_MAD = 1.4826  # median absolute deviation to standard deviation of a normal
AGREE = 3.0  # the scatter of six samples about their parabola exceeds this many noises once in 10^5 (chi-squared, 3)


def windows(size: int, width: int) -> NDArray[np.int64]:
    """Numbers of the samples in each window (size - width + 1, width); none where there are fewer samples.

    They are indices.
    """
    if size < width:
        return np.empty((0, width), dtype=np.int64)
    return sliding_window_view(np.arange(size), width)


def compact(t_s: Array, around: NDArray[np.int64]) -> NDArray[np.int64]:
    """The windows (k, m) in which no more than a third of the samples are missing: across a gap nothing is local."""
    if not len(around):
        return around
    usual_s = float(np.median(np.diff(t_s))) * (around.shape[1] - 1)
    return around[t_s[around[:, -1]] - t_s[around[:, 0]] < 1.5 * usual_s + 1e-9]


def fit_windows(
    t_s: Array, values: Array, chosen: NDArray[np.int64], at_s: Array, degree: int
) -> tuple[Array, Array, Array]:
    """Fit a polynomial to each window by least squares.

    Parameters
    ----------
    t_s, values
        (n,) s and (n, d).
    chosen
        (k, m) numbers of the samples of each window, m > degree.
    at_s
        (k,) times about which the polynomials are expanded.
    degree
        Of the polynomials.

    Returns
    -------
    coefficients : (k, degree + 1, d)
        Value, rate, half the second derivative, ... at ``at_s``.
    gain : (k, degree + 1)
        Standard error of each coefficient when each sample has standard error 1.
    residual : (k, m, d)
    """
    powers = np.arange(degree + 1)
    elapsed = t_s[chosen] - at_s[:, None]
    unit = np.maximum(np.abs(elapsed).max(axis=1, initial=0.0), np.finfo(float).tiny)
    design = (elapsed / unit[:, None])[:, :, None] ** powers
    transposed = design.transpose(0, 2, 1)
    inverse = np.linalg.solve(transposed @ design, transposed)
    coefficients = inverse @ values[chosen]
    residual = values[chosen] - design @ coefficients
    scale = unit[:, None] ** -powers
    return coefficients * scale[:, :, None], np.sqrt(np.sum(inverse**2, axis=2)) * scale, residual


def noise(t_s: Array, values: Array) -> Array:
    """Standard deviation (d,) of the samples about their neighbours, 0 where there are fewer than six samples.

    It has the unit of ``values`` (n, d); ``t_s`` (n,) is in s.

    Each sample is compared with the cubic through two neighbours on each side, which leaves a fourth difference: a
    smooth motion cancels, noise does not. The median makes it blind to outliers, impacts and rests.
    """
    around = windows(t_s.size, 5)
    if len(around) < 2:
        return np.zeros(values.shape[1])
    coefficients, gain, _ = fit_windows(t_s, values, np.delete(around, 2, axis=1), t_s[around[:, 2]], 3)
    miss = (values[around[:, 2]] - coefficients[:, 0]) / np.hypot(1.0, gain[:, :1])
    return NORMAL_MAD * np.median(np.abs(miss), axis=0)


def velocity(t_s: Array, values: Array, width: int) -> tuple[Array, Array]:
    """Velocity (n, d) from the straight line through ``width`` samples around each, and its error (n,) per unit noise.

    Times (n,) are in s. Each line has fewer samples where there are fewer, and an infinite error for a single one.
    """
    width = min(width, t_s.size)
    if width < 2:
        return np.zeros_like(values), np.full(t_s.size, np.inf)
    around = windows(t_s.size, width)
    nearest = np.clip(np.arange(t_s.size) - width // 2, 0, len(around) - 1)
    coefficients, gain, _ = fit_windows(t_s, values, around, t_s[around].mean(axis=1), 1)
    return coefficients[nearest, 1], gain[nearest, 1]


def outliers(t_s: Array, values: Array, scale: Array, threshold: float) -> NDArray[np.bool_]:
    """One to three samples (n,) that disagree with their neighbours, while these agree with one another.

    A false detection, or times that slipped by a frame. At an impact the neighbours do not agree.

    Parameters
    ----------
    t_s, values
        (n,) s and (n, d).
    scale
        (d,) standard deviation of a sample.
    threshold
        Deviation, in standard deviations, from the parabola through three neighbours on each side.
    """
    outlying = np.zeros(t_s.size, dtype=np.bool_)
    for size in (1, 2, 3):
        kept = np.flatnonzero(~outlying)
        for group in _outlying_groups(t_s[kept], values[kept], scale, threshold, size):
            outlying[kept[group]] = True
    return outlying


def _outlying_groups(t_s: Array, values: Array, scale: Array, threshold: float, size: int) -> NDArray[np.int64]:
    """Numbers (k, size) of the samples of each group of outliers."""
    around = compact(t_s, windows(t_s.size, 6 + size))
    middle, outer = around[:, 3 : 3 + size], np.delete(around, np.arange(3, 3 + size), axis=1)
    if not len(around):
        return middle
    coefficients, gain, residual = fit_windows(t_s, values, outer, t_s[middle].mean(axis=1), 2)
    elapsed = t_s[middle] - t_s[middle].mean(axis=1, keepdims=True)
    miss = np.abs(values[middle] - (elapsed[:, :, None] ** np.arange(3)) @ coefficients)
    usual = NORMAL_MAD * np.median(miss, axis=(0, 1))
    typical = np.hypot(scale * np.hypot(1.0, gain[:, :1]), usual)[:, None]
    rest = np.sqrt(np.sum(residual**2, axis=1) / 3)  # six neighbours, three coefficients
    agree = np.all(rest < AGREE * np.hypot(scale, np.median(rest, axis=0)), axis=1)
    outlying = np.any((miss > threshold * typical) & (miss > threshold * rest[:, None]), axis=2)
    return middle[agree & outlying[:, 0] & outlying[:, -1]]


def jumps(t_s: Array, values: Array, scale: Array, width: int) -> tuple[Array, Array, Array]:
    """How much the velocity changes between each sample and the next, seen from either side.

    One parabola is fitted to ``width`` samples on each side, and both are extrapolated to the middle of the step.

    Parameters
    ----------
    t_s, values
        (n,) s and (n, d).
    scale
        (d,) standard deviation of a sample.
    width
        Samples on each side, at least 4.

    Returns
    -------
    jump : (n - 1, d)
        Change of velocity; NaN where there are not enough samples.
    score : (n - 1,)
        Its size in standard errors, which include how much it typically is in this clip: a smooth curve sampled
        coarsely seems to jump a little everywhere, an impact does so once.
    misfit : (n - 1,)
        Squared residuals of both sides in units of the noise: smallest where the break really is.
    """
    steps = max(t_s.size - 1, 0)
    jump = np.full((steps, values.shape[1]), np.nan)
    score, misfit = np.full(steps, np.nan), np.full(steps, np.nan)
    around = compact(t_s, windows(t_s.size, 2 * width))
    if not len(around):
        return jump, score, misfit
    here = around[:, width - 1]
    middle_s = (t_s[here] + t_s[here + 1]) / 2
    before, gain_before, left = fit_windows(t_s, values, around[:, :width], middle_s, 2)
    after, gain_after, right = fit_windows(t_s, values, around[:, width:], middle_s, 2)
    jump[here] = after[:, 1] - before[:, 1]
    error = np.hypot(gain_before[:, 1], gain_after[:, 1])[:, None] * scale
    typical = NORMAL_MAD * np.median(np.abs(jump[here]), axis=0)
    score[here] = np.sqrt(np.sum(jump[here] ** 2 / (error**2 + typical**2), axis=1))
    misfit[here] = np.sum((left**2 + right**2) / scale**2, axis=(1, 2))
    return jump, score, misfit


def surprises(t_s: Array, values: Array, scale: Array, width: int) -> Array:
    """Distance (n,) of each sample from the parabola through the ``width`` samples before it, in standard errors.

    Parameters
    ----------
    t_s, values
        (n,) s and (n, d).
    scale
        (d,) standard deviation of a sample.
    width
        Samples before; the first ``width`` samples are NaN.
    """
    surprise = np.full(t_s.size, np.nan)
    around = compact(t_s, windows(t_s.size, width + 1))
    if not len(around):
        return surprise
    last = around[:, -1]
    coefficients, gain, _ = fit_windows(t_s, values, around[:, :-1], t_s[last], 2)
    miss = values[last] - coefficients[:, 0]
    typical = NORMAL_MAD * np.median(np.abs(miss), axis=0)
    error = np.hypot(scale * np.hypot(1.0, gain[:, :1]), typical)
    surprise[last] = np.sqrt(np.sum((miss / error) ** 2, axis=1))
    return surprise
