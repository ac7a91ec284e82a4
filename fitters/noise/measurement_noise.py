"""Measurement noise and outliers, estimated from the data before any model is fitted."""

from __future__ import annotations

import numpy as np

from fitters.kept_answers import keeping_answers
from fitters.noise.reading_step import STEP_TO_SD, reading_step
from iris_sysid.types import Array, Mask

MAD_TO_SD = 1.4826  # median absolute deviation to standard deviation of a normal
ORDERS = range(2, 7)
FAR = 6.0  # robust standard deviations from the neighbours: a probability of 2e-9 for normal noise
MAX_SHARE = 0.05  # a larger share of samples is a part of the motion and no outlier
NEIGHBOURS = 5  # samples on each side


def robust_sd(values: Array) -> float:
    """Standard deviation from the median absolute value, unmoved by a few outliers; their rms if that is 0.

    ``values`` (n,) in any unit, which the result has too.
    """
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return float("nan")
    spread = MAD_TO_SD * float(np.median(np.abs(finite)))
    return spread if spread > 0 else float(np.sqrt(np.mean(finite**2)))


def normalised_difference(t_s: Array, values: Array, order: int) -> Array:
    """Divided differences (n - order,) scaled so that white noise keeps its standard deviation.

    A difference of order m is zero for a polynomial of degree m - 1, at uneven times too: its weights are
    1 / prod_j (t_i - t_j) (Newton's divided differences), divided here by their root sum of squares.
    """
    n = t_s.size - order
    times = [t_s[k : k + n] for k in range(order + 1)]
    span_s = times[-1] - times[0]
    weights = np.empty((order + 1, n))
    for i in range(order + 1):
        others = [(times[i] - times[j]) / span_s for j in range(order + 1) if j != i]
        weights[i] = 1.0 / np.prod(others, axis=0)
    difference = np.sum([weights[k] * values[k : k + n] for k in range(order + 1)], axis=0)
    return np.asarray(difference / np.sqrt(np.sum(weights**2, axis=0)))


@keeping_answers
def noise_from_differences(t_s: Array, values: Array) -> float:
    """Standard deviation of white noise on a smooth motion, from differences of neighbouring samples.

    It has the unit of ``values`` (n,); ``t_s`` (n,) is in s.

    The smallest of the robust standard deviations of the differences of orders 2 to 6: too low an order
    still contains the motion, too high an order needs more samples. Noise that is correlated over samples
    is underestimated. NaN with fewer than 8 samples. After von Neumann (1941, Ann. Math. Stat. 12, 367).
    A reading in steps errs by at least its step over sqrt(12), also where neighbours read the same.
    """
    if t_s.size < 8:
        return float("nan")
    scatter = min(robust_sd(normalised_difference(t_s, values, order)) for order in ORDERS)
    return max(scatter, STEP_TO_SD * reading_step(values))


def deviations_from_neighbours(values: Array) -> Array:
    """Each value minus the running median over it and NEIGHBOURS samples on each side.

    ``values`` (n,) and the result (n,) have the same unit.
    """
    width = min(NEIGHBOURS, (values.size - 1) // 2)
    padded = np.pad(values, width, mode="reflect")
    return values - np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1), axis=1)


def outliers_in_residual(residual: Array, floor: float, spikes: Mask | None = None) -> Mask:
    """True where a residual (n, d) is isolated: far from its neighbours, not part of a slow misfit.

    ``floor`` is the smallest deviation that counts. When more than MAX_SHARE are isolated, what is missing in the model
    has sharp parts or the noise has tails, and only those of ``spikes`` (n,) are outliers: they stand out of the data,
    whatever the model (:func:`outliers_in_motion`). Without them none is.
    """
    outliers = np.zeros(residual.shape[0], dtype=np.bool_)
    for column in residual.T:
        deviation = np.abs(deviations_from_neighbours(column))
        outliers |= deviation > max(FAR * robust_sd(deviation), floor)
    if outliers.mean() <= MAX_SHARE:
        return outliers
    return np.zeros_like(outliers) if spikes is None else outliers & spikes


@keeping_answers
def outliers_in_motion(t_s: Array, values: Array) -> Mask:
    """True where a sample (n, d) cannot belong to a smooth motion: every difference that contains it is large.

    ``t_s`` (n,), s; ``values`` in any unit.

    For starting values, it finds far outliers; :func:`outliers_in_residual` finds the others. A kink of the
    motion is not marked, because differences that end at it are small. No sample is an outlier when too many are.
    """
    order = 4
    outliers = np.zeros(t_s.size, dtype=np.bool_)
    if t_s.size < 3 * order:
        return outliers
    for column in values.T:
        size = np.abs(normalised_difference(t_s, column, order))
        smallest = np.lib.stride_tricks.sliding_window_view(np.pad(size, order, constant_values=np.inf), order + 1)
        outliers |= np.min(smallest, axis=1) > FAR * robust_sd(size)
    return outliers if outliers.mean() <= MAX_SHARE else np.zeros_like(outliers)
