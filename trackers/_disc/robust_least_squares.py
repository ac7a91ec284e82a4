"""Robust least squares by iteratively reweighted Gauss-Newton, with the noise estimated from the residuals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array
from trackers._frames.arrays import MAD_TO_SD

ROUNDS = ((8, 3.0), (8, 0.5), (6, 0.03))  # most steps of each, and the step over standard error that ends it sooner
LEAST_SHARE = 0.1  # of a step that goes back
HUBER = 1.5  # standard deviations from which a residual counts linearly: the second round
TUKEY = 6.0  # standard deviations from which a residual does not count: 98 % efficient on normal noise
INLIER, TRUNCATION = 3.0, 0.9866  # standard deviation of a normal distribution cut at +-3 sigma
FEWEST_IN_ZONE = 8  # pixels from which a zone has its own noise
RIDGE = 1e-12  # of the diagonal: a parameter that the pixels do not show stays where it is

Labels = NDArray[np.int64]
Model = Callable[[Array], tuple[Array, Array]]  # parameters (p,) -> prediction (n,), jacobian (n, p)


@dataclass(frozen=True, eq=False, slots=True)
class Pixels:
    """Data of a fit: values (n,) and the noise (n,) known of them, grey levels, and the zone (n,) of each.

    Each zone has its own scale of the noise: inside, outside and on an edge, residuals differ.
    """

    values: Array
    noise: Array
    zone: Labels


@dataclass(frozen=True, eq=False, slots=True)
class Start:
    """Parameters (p,) to start from, the longest step (p,) of each at once, and the lowest value (p,) of each."""

    parameters: Array
    longest_step: Array
    lowest: Array


@dataclass(frozen=True, eq=False, slots=True)
class Solution:
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
        return np.asarray(np.linalg.pinv(self.information, hermitian=True), dtype=np.float64)

    def scores(self) -> Array:
        """How much each pixel's noise of one sigma moves each parameter (n, p)."""
        return (self.weight / self.sigma)[:, np.newaxis] * self.jacobian @ self.covariance


def robust_fit(model: Model, start: Start, pixels: Pixels) -> Solution:
    """Fit a model to pixels of which some show something else.

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
    """
    solution = _Fit(model, start, pixels).round(start.parameters, pixels.noise, 0)
    for number in range(1, len(ROUNDS)):
        solution = _Fit(model, start, pixels).round(solution.parameters, _measured_noise(solution, pixels), number)
    return solution


@dataclass(frozen=True, eq=False, slots=True)
class _Fit:
    """Constants of all rounds."""

    model: Model
    start: Start
    pixels: Pixels

    def round(self, parameters: Array, sigma: Array, number: int) -> Solution:
        """Gauss-Newton steps with the weights of one round."""
        most, settled = ROUNDS[number]
        damping, solution = _Damping(), None
        for _ in range(most):
            predicted, jacobian = self.model(parameters)
            residual = self.pixels.values - predicted
            weight = _weight(np.abs(residual) / sigma, number)
            information = ((weight / sigma**2)[:, np.newaxis] * jacobian).T @ jacobian
            solution = Solution(parameters, information, jacobian, residual, sigma, weight, np.zeros_like(parameters))
            step = damping.applied(_step(solution, self.start), solution)
            parameters = np.maximum(parameters + step, self.start.lowest)
            solution = replace(solution, parameters=parameters, last_step=step)
            if (np.abs(step) * np.sqrt(np.diag(information)) <= settled).all():
                break
        assert solution is not None
        return solution


@dataclass(eq=False, slots=True)
class _Damping:
    """Shortens steps that go to and fro, and lengthens them again."""

    share: float = 1.0
    before: Array | None = None

    def applied(self, step: Array, solution: Solution) -> Array:
        """The step as it should be made."""
        scaled = step * np.sqrt(np.diag(solution.information))
        back = self.before is not None and float(scaled @ self.before) < 0
        self.share = max(LEAST_SHARE, self.share / 2) if back else min(1.0, self.share * 1.5)
        self.before = scaled
        return self.share * step


def _weight(ratio: Array, number: int) -> Array:
    """Weight of residuals over sigma: one in the first round, Huber's in the second, Tukey's biweight in the third."""
    if number == 0:
        return np.ones_like(ratio)
    return HUBER / np.maximum(ratio, HUBER) if number == 1 else np.maximum(0.0, 1.0 - (ratio / TUKEY) ** 2) ** 2


def _step(solution: Solution, start: Start) -> Array:
    """A Gauss-Newton step; a parameter at its lowest value stays there while it is pushed down."""
    gradient = solution.jacobian.T @ (solution.weight / solution.sigma**2 * solution.residual)
    free = (solution.parameters > start.lowest) | (gradient > 0)
    information = solution.information[np.ix_(free, free)]
    step = np.zeros_like(gradient)
    step[free] = np.linalg.solve(information + RIDGE * np.diag(np.diag(information)), gradient[free])
    return np.clip(step, -start.longest_step, start.longest_step)


def _measured_noise(solution: Solution, pixels: Pixels) -> Array:
    """Noise of each pixel: that of its zone by the residuals, corrected for the parameters; at least the known."""
    taken_up = np.einsum("ij,ij->i", solution.scores(), solution.jacobian) / solution.sigma
    noise = pixels.noise.copy()
    ratio = np.abs(solution.residual) / pixels.noise
    for zone in np.unique(pixels.zone):
        inside = pixels.zone == zone
        if np.count_nonzero(inside) >= FEWEST_IN_ZONE:
            left = np.clip(1.0 - taken_up[inside].mean(), 0.2, 1.0)
            noise[inside] *= max(1.0, _scale(ratio[inside]) / np.sqrt(left))
    return noise


def _scale(ratio: Array) -> float:
    """Standard deviation of residuals of which some are foreign: that of those within 3 sigma by the median."""
    cut = INLIER * MAD_TO_SD * float(np.median(ratio))
    return float(np.sqrt((ratio[ratio <= cut] ** 2).mean())) / TRUNCATION
