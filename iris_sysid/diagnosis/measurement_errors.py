"""The errors that a track states of its samples: what they are weighed by, and what no effect is named below.

Errors of tracking hang together: a bias that comes back at the same place of the picture, or that lasts while a body
turns its other side to the light. So a mean over many samples is not better than one of them by the root of their
number, and what moves the trajectory by less than single samples are said to be wrong by may be the tracker's.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.types import Array, FitResult, Trajectory

STANDS_OUT = 3.0  # stated errors of a sample; beyond that they are wrong once in 370 times
FEWEST = 3  # samples that must show it: one or two may be wild


def unit_noise(fitted: FitResult, trajectory: Trajectory) -> Array:
    """What residuals are measured in (n, d): the noise of each quantity, 1 where there is none, by sample as stated.

    Parameters
    ----------
    fitted
        A fit; the stated errors are taken relative to the median of the samples that it used, if all have one.
    trajectory
        What it was fitted to.
    """
    noise = np.where(fitted.noise > 0, fitted.noise, 1.0)
    sigma = _sigma(fitted, trajectory)
    usual = np.median(sigma[fitted.used], axis=0)  # NaN where one is not stated
    relative = sigma / np.where(usual > 0, usual, np.nan)
    return np.asarray(noise * np.where(np.isfinite(relative) & (relative > 0), relative, 1.0))


def stated_errors(fitted: FitResult, trajectory: Trajectory) -> Array:
    """The errors (n, d) that each sample may have: stated, or the noise that is seen where that is more.

    0 where the trajectory states none: then the residual alone tells what its errors are.

    Parameters
    ----------
    fitted, trajectory
        As for :func:`unit_noise`.
    """
    sigma = _sigma(fitted, trajectory)
    known = np.isfinite(sigma) & (sigma > 0)
    return np.where(known, np.maximum(sigma, unit_noise(fitted, trajectory)), 0.0)


def stands_out_from(change: Array, stated: Array) -> float:
    """The size from which a change (n, d) for a unit of it stands out of the stated errors (n, d) of the samples.

    That is from which FEWEST samples change by STANDS_OUT of their errors; 0 where none are stated.

    Parameters
    ----------
    change
        Of the prediction, what the fitted parameters can imitate taken out.
    stated
        From :func:`stated_errors`.
    """
    if not np.all(stated > 0):
        return 0.0
    by_sample = np.sort(np.max(np.abs(change) / stated, axis=1))
    seen = float(by_sample[-min(FEWEST, by_sample.size)])
    return STANDS_OUT / seen if seen > 0 else float("inf")


def stands_out(before: FitResult, after: FitResult, trajectory: Trajectory) -> bool:
    """Whether what is between two fits to one trajectory is more than its stated errors may be, and those in common.

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
    columns = _columns(after, trajectory)
    common = [patterns[:, both][:, :, columns] / stated for patterns in trajectory.systematic.values()]
    return stands_out_from(_without_common(change / stated, common), np.ones_like(stated)) <= 1.0


def _without_common(change: Array, common: Sequence[Array]) -> Array:
    """A change (n, d) less what errors that all samples share (each (r, n, d) for one standard error) make of it.

    Each error as large as it is most likely to be: least squares with one more sample for each, that it is 0 +- 1.
    """
    if not common:
        return change
    patterns = np.concatenate(common).reshape(-1, change.size)
    sizes = np.linalg.solve(patterns @ patterns.T + np.eye(len(patterns)), patterns @ change.ravel())
    return np.asarray(change - (sizes @ patterns).reshape(change.shape))


def _columns(fitted: FitResult, trajectory: Trajectory) -> list[int]:
    """Where the trajectory has what a fit observes."""
    return [trajectory.column(quantity.name) for quantity in fitted.model.observed]


def _sigma(fitted: FitResult, trajectory: Trajectory) -> Array:
    """Stated standard errors (n, d) of what a fit observes."""
    return trajectory.sigma[:, _columns(fitted, trajectory)]
