"""Measurement noise of four kinds: white, autocorrelated, quantised to pixels, and with outliers."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# (clean (n, d), sigma, rng) -> measured (n, d)
Noise = Callable[[Array, float, np.random.Generator], Array]

CORRELATION = 0.7  # between neighbouring samples of AR(1) noise
STEP = 3.0  # quantisation step in standard deviations of the noise: 0.3 px, for noise of 0.1 px
OUTLIERS = 0.01  # share of samples
FAR = 15.0  # standard deviations that an outlier lies off


def white(clean: Array, sigma: float, rng: np.random.Generator) -> Array:
    """Independent normal noise."""
    return clean + sigma * rng.standard_normal(clean.shape)


def autocorrelated(clean: Array, sigma: float, rng: np.random.Generator) -> Array:
    """AR(1) noise of that standard deviation."""
    steps = rng.standard_normal(clean.shape)
    series = np.empty_like(steps)
    series[0] = steps[0]
    for k in range(1, len(steps)):
        series[k] = CORRELATION * series[k - 1] + np.sqrt(1.0 - CORRELATION**2) * steps[k]
    return clean + sigma * series


def quantised(clean: Array, sigma: float, rng: np.random.Generator) -> Array:
    """White noise, then rounded to steps as an encoder or whole pixels do."""
    step = STEP * sigma
    return np.round(white(clean, sigma, rng) / step) * step


def with_outliers(clean: Array, sigma: float, rng: np.random.Generator) -> Array:
    """White noise, and a few samples far off."""
    measured = white(clean, sigma, rng)
    hit = rng.random(len(clean)) < OUTLIERS
    signs = rng.choice([-1.0, 1.0], size=(int(hit.sum()), clean.shape[1]))
    measured[hit] += signs * sigma * rng.uniform(0.7 * FAR, 1.3 * FAR, size=signs.shape)
    return measured


NOISES: Mapping[str, Noise] = {
    "white": white,
    "autocorrelated": autocorrelated,
    "quantised": quantised,
    "with outliers": with_outliers,
}


def whitened(series: Array, kind: str, sigma: float) -> Array:
    """A signal (n, ...) in units of independent noise of that kind, for what can be detected in it."""
    if kind == "autocorrelated":
        rest = (series[1:] - CORRELATION * series[:-1]) / (sigma * np.sqrt(1.0 - CORRELATION**2))
        return np.concatenate([series[:1] / sigma, rest])
    spread = sigma * np.sqrt(1.0 + STEP**2 / 12.0) if kind == "quantised" else sigma
    return series / spread
