"""Robust least squares by iteratively reweighted Gauss-Newton, with the noise estimated from the residuals."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array
from trackers._frames.arrays import MAD_TO_SD

ROUNDS = ((8, 3.0), (8, 0.5), (6, 0.03))  # most steps of each, and the step over standard error that ends it sooner
HUBER = 1.5  # standard deviations from which a residual counts linearly: the second round
TUKEY = 6.0  # standard deviations from which a residual does not count: 98 % efficient on normal noise
INLIER, TRUNCATION = 3.0, 0.9866  # standard deviation of a normal distribution cut at +-3 sigma
MIN_IN_ZONE = 8  # pixels from which a zone has its own noise
MIN_KNOWN = 1e-15  # of the largest eigenvalue of the information: smaller eigenvalues count as zero
RIDGE = 1e-12  # of the diagonal: a parameter that the pixels do not show stays where it is

Labels = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class Pixels:
    """Data of a fit: values (n,) and the noise (n,) known of them, grey levels, and the zone (n,) of each.

    Each zone has its own scale of the noise: inside, outside and on an edge, residuals differ.
    """

    values: Array
    noise: Array
    zone: Labels


@dataclass(frozen=True, eq=False, slots=True)
class Equations:
    """Normal equations of some parameters: information of each zone (z, p, p), residual and weight (n,) of pixels."""

    of_zones: Array
    residual: Array
    weight: Array

    @property
    def information(self) -> Array:
        """That of all pixels (p, p)."""
        return np.asarray(self.of_zones.sum(axis=0))


@dataclass(frozen=True, eq=False, slots=True)
class Start:
    """Parameters (p,) to start from, the longest step (p,) of each at once, and the lowest value (p,) of each."""

    parameters: Array
    longest_step: Array
    lowest: Array


@dataclass(frozen=True, eq=False, slots=True)
class Rest:
    """Where the steps of one round ended: parameters (p,), the last step (p,) and the equations before it."""

    parameters: Array
    last_step: Array
    equations: Equations
    sigma: Array


class Model(Protocol):
    """What is fitted."""

    def equations(self, parameters: Array, pixels: Pixels, sigma: Array, number: int) -> Equations:
        """The normal equations for parameters (p,), with the weights of a round and noise ``sigma`` (n,)."""

    def round(self, start: Start, pixels: Pixels, sigma: Array, number: int) -> Rest:
        """Gauss-Newton steps with the weights of one round, as many as its :data:`ROUNDS` say."""

    def jacobian(self) -> Array:
        """Derivatives (n, p) of the prediction for the parameters of the latest equations."""


@dataclass(frozen=True, eq=False, slots=True)
class RobustSolution:
    """Parameters (p,), their information matrix (p, p), and of each pixel its jacobian (n, p), residual, sigma, weight.

    ``sigma`` (n,) is the noise as measured by the residuals of the zone; ``last_step`` (p,) is the one that was
    made last.
    """

    parameters: Array
    information: Array
    jacobian: Array
    residual: Array
    sigma: Array
    weight: Array
    last_step: Array

    @property
    def covariance(self) -> Array:
        """Inverse information (p, p): the covariance for white noise. In the product of the units of two parameters."""
        return _inverse(self.information)

    def scores(self, count: int) -> Array:
        """How much each pixel's noise of one sigma moves each of the first ``count`` parameters (n, count)."""
        return (self.weight / self.sigma)[:, np.newaxis] * (self.jacobian @ self.covariance[:, :count])


def robust_fit(model: Model, start: Start, pixels: Pixels, few: tuple[Model, Pixels] | None = None) -> RobustSolution:
    """Fit a model to pixels; some of them may show other objects.

    The first round takes every pixel as it is; the second counts large residuals linearly (Huber), the third
    not at all (Tukey's biweight; a few steps from a robust start are as good as all, P. Rousseeuw and A. Leroy,
    "Robust Regression", 1987, ch. 4). The noise of each zone is measured by the residuals in between, at least
    that which is known. Raises numpy.linalg.LinAlgError when the pixels cannot determine the model.

    Parameters
    ----------
    model
        Prediction and jacobian for parameters.
    start
        Start values, and bounds of the steps.
    pixels
        Data of the fit.
    few
        The same for some of the pixels, evenly spread: the first two rounds, which only lead near, are about these.
    """
    near, some = few or (model, pixels)
    rest = near.round(start, some, some.noise, 0)
    rest = near.round(replace(start, parameters=rest.parameters), some, _measured_noise(rest.equations, some), 1)
    seen = model.equations(rest.parameters, pixels, pixels.noise, 1) if few else rest.equations
    rest = model.round(replace(start, parameters=rest.parameters), pixels, _measured_noise(seen, pixels), 2)
    found = rest.equations
    return RobustSolution(
        rest.parameters, found.information, model.jacobian(), found.residual, rest.sigma, found.weight, rest.last_step
    )


def _inverse(information: Array) -> Array:
    """The pseudo-inverse (p, p) of an information matrix."""
    values, vectors = np.linalg.eigh(information)
    known = values > MIN_KNOWN * values[-1]
    return np.asarray((vectors[:, known] / values[known]) @ vectors[:, known].T, dtype=np.float64)


def _measured_noise(equations: Equations, pixels: Pixels) -> Array:
    """Noise of each pixel: that of its zone by the residuals, corrected for the parameters; at least the known."""
    covariance = _inverse(equations.information)
    ratio, factors = np.abs(equations.residual) / pixels.noise, np.ones(len(equations.of_zones))
    for zone, information in enumerate(equations.of_zones):
        count, scale = inlier_scale(ratio, pixels.zone, zone)
        if count >= MIN_IN_ZONE:
            taken_up = float((information * covariance).sum()) / count  # mean of the leverages
            factors[zone] = max(1.0, scale / np.sqrt(np.clip(1.0 - taken_up, 0.2, 1.0)))
    return np.asarray(pixels.noise * factors[pixels.zone])


def inlier_scale(ratio: Array, zone: Labels, number: int) -> tuple[int, float]:
    """How many residuals (n,) one zone has, and their standard deviation by those within 3 sigma by the median."""
    inside = ratio[zone == number]
    if not inside.size:
        return 0, 0.0
    inliers = inside[inside <= INLIER * MAD_TO_SD * np.median(inside)]
    return inside.size, float(np.sqrt((inliers**2).mean())) / TRUNCATION
