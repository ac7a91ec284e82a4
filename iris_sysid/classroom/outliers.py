"""Which values of a class stand out, given their own errors and the scatter between the groups."""

from __future__ import annotations

import math

import numpy as np

from fitters.noise.random_effects import random_effects
from iris_sysid.types import Array, Mask, student_ppf

MIN_GROUPS = 4  # groups: of three, none can be said to be the one that is wrong
NORMAL_MAD = 1.4826  # median absolute deviation to standard deviation of a normal
FIRST = 5.0  # standard deviations from the median at which a value is left out of the first estimate of the scatter
FALSE_ALARM = 0.01  # chance that any group of a class without faults is called an outlier
ROUNDS = 20  # two or three are usual


def deviations(values: Array, stderrs: Array) -> tuple[Array, Mask]:
    """How far each value lies from those that belong together, and which are outliers.

    The values that belong together have a common mean and a scatter between groups, both by restricted maximum
    likelihood; starting from those near the median (distance 5 median absolute deviations), a value is an outlier
    where its distance from their mean exceeds Student's quantile with a false alarm in 1 % of all classes
    (Bonferroni), and every value within it belongs to them, until nothing changes.

    Parameters
    ----------
    values
        (c,) one a group; NaN where there is none.
    stderrs
        (c,) their standard errors, in the same unit.

    Returns
    -------
    in_errors : numpy.ndarray
        (c,) distance from the mean in standard errors, the scatter between groups included; NaN without a value.
    outlying : numpy.ndarray
        (c,) true for outliers; none among fewer than four groups.
    """
    known = np.isfinite(values) & np.isfinite(stderrs) & (stderrs > 0)
    distance, outlying = np.full(values.size, math.nan), np.zeros(values.size, dtype=np.bool_)
    if known.sum() < MIN_GROUPS:
        return distance, outlying
    distance[known], outlying[known] = _deviations(values[known], stderrs[known])
    return distance, outlying


def _deviations(values: Array, stderrs: Array) -> tuple[Array, Mask]:
    middle = float(np.median(values))
    spread = NORMAL_MAD * float(np.median(np.abs(values - middle)))
    alike = np.abs(values - middle) <= FIRST * np.hypot(spread, stderrs)
    distance = np.abs(values - middle) / np.hypot(spread, stderrs)
    for _ in range(ROUNDS):
        if alike.sum() < MIN_GROUPS - 1:
            break
        distance = _distances(values, stderrs, alike)
        limit = student_ppf(1 - FALSE_ALARM / (2 * values.size), int(alike.sum()) - 1)
        now = np.abs(distance) <= limit
        if np.array_equal(now, alike):
            break
        alike = now
    return distance, ~alike


def _distances(values: Array, stderrs: Array, alike: Mask) -> Array:
    """Distance (c,) of each value from the mean of those that are ``alike``, itself left out, in standard errors."""
    every = random_effects(values[alike], stderrs[alike], "")
    distance = np.empty(values.size)
    for k, (value, stderr) in enumerate(zip(values, stderrs, strict=True)):
        others = alike.copy()
        others[k] = False
        population = random_effects(values[others], stderrs[others], "") if alike[k] and others.sum() > 2 else every
        scale = math.sqrt(stderr**2 + population.between.value**2 + population.mean.stderr**2)
        distance[k] = (value - population.mean.value) / scale
    return distance
