"""The stated errors of a track: weights of its samples, and the smallest size of an effect that they can resolve.

Tracking errors are correlated: a bias returns at the same position in the image, or lasts while the light falls on
another side of a turning body. So averaging n samples does not reduce the error by sqrt(n), and a change of the
trajectory below the stated errors of single samples may come from the tracker.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.types import Array, FitResult, Trajectory

RESOLVED_AT = 3.0  # stated errors of a sample; a normal error exceeds 3 standard errors once in 370 samples
RESOLVED_SAMPLES = 3  # samples that must show the effect: one or two may be outliers


def unit_noise(fitted: FitResult, trajectory: Trajectory) -> Array:
    """The noise (n, d) that residuals are divided by, in observed units: scaled by each sample's stated error.

    Parameters
    ----------
    fitted
        A fit; the stated errors are taken relative to the median of the samples that it used, if all have one. A
        quantity without noise counts as 1 in its unit.
    trajectory
        What it was fitted to.
    """
    noise = np.where(fitted.noise > 0, fitted.noise, 1.0)
    sigma = _sigma(fitted, trajectory)
    typical = np.median(sigma[fitted.used], axis=0)  # NaN where one sample has no stated error
    relative = sigma / np.where(typical > 0, typical, np.nan)
    return np.asarray(noise * np.where(np.isfinite(relative) & (relative > 0), relative, 1.0))


def stated_errors(fitted: FitResult, trajectory: Trajectory) -> Array:
    """The error (n, d) of each sample, in observed units: the stated one, or the noise of the fit where that is larger.

    0 where the trajectory states no errors: then they are known from the residual only.

    Parameters
    ----------
    fitted, trajectory
        As for :func:`unit_noise`.
    """
    sigma = _sigma(fitted, trajectory)
    known = np.isfinite(sigma) & (sigma > 0)
    return np.where(known, np.maximum(sigma, unit_noise(fitted, trajectory)), 0.0)


def resolvable_size(change: Array, stated: Array) -> float:
    """The smallest size at which an effect changes RESOLVED_SAMPLES samples by RESOLVED_AT stated errors.

    0 where no errors are stated.

    Parameters
    ----------
    change
        (n, d) change of the prediction per unit of the size, without the part that the fitted parameters can imitate.
    stated
        (n, d) from :func:`stated_errors`.
    """
    if not np.all(stated > 0):
        return 0.0
    by_sample = np.sort(np.max(np.abs(change) / stated, axis=1))
    largest = float(by_sample[-min(RESOLVED_SAMPLES, by_sample.size)])
    return RESOLVED_AT / largest if largest > 0 else float("inf")


def is_resolved(before: FitResult, after: FitResult, trajectory: Trajectory) -> bool:
    """Whether two fits to one trajectory differ by more than its stated errors, systematic ones included.

    Parameters
    ----------
    before, after
        Without an effect and with it.
    trajectory
        What both were fitted to.
    """
    both = before.used & after.used
    change, stated = (before.predicted - after.predicted)[both], stated_errors(after, trajectory)[both]
    if not np.all(stated > 0):
        return True
    columns = observed_columns(after, trajectory)
    systematic = [patterns[:, both][:, :, columns] / stated for patterns in trajectory.systematic.values()]
    return resolvable_size(_without_systematic(change / stated, systematic), np.ones_like(stated)) <= 1.0


def _without_systematic(change: Array, systematic: Sequence[Array]) -> Array:
    """A change (n, d) less the part that systematic errors, each (r, n, d) for one standard error, can imitate.

    Least squares estimates the size of each systematic error, with the prior 0 +- 1 as one more sample.
    """
    if not systematic:
        return change
    patterns = np.concatenate(systematic).reshape(-1, change.size)
    sizes = np.linalg.solve(patterns @ patterns.T + np.eye(len(patterns)), patterns @ change.ravel())
    return np.asarray(change - (sizes @ patterns).reshape(change.shape))


def observed_columns(fitted: FitResult, trajectory: Trajectory) -> list[int]:
    """The columns of the trajectory that a fit observes."""
    return [trajectory.column(quantity.name) for quantity in fitted.model.observed]


def _sigma(fitted: FitResult, trajectory: Trajectory) -> Array:
    """Stated standard errors (n, d) of what a fit observes."""
    return trajectory.sigma[:, observed_columns(fitted, trajectory)]
