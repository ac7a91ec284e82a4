"""Means over short blocks of a long record, for the score tests: they need no more samples than the motion has detail.

A score is a sum over samples of residual times sensitivity. Where a sensitivity changes little from one sample to the
next, the sum over blocks of mean residual times mean sensitivity is the same sum: no information is lost, and a test
costs what the number of blocks costs. Where many effects must be refitted to say which explain the record at all, one
sample of each block does. The refits that decide, sizes and errors use every sample.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitters.image_effects import view_of
from iris_sysid.types import Array, FitResult, Trajectory

MIN_BLOCKS = 10_000  # samples up to which every one is used, and blocks that a longer record has at least
RANKED, SEARCHED = 300, 1000  # the same of the samples by which effects are ranked, and by which they are searched
DRIVEN = 4000  # samples by which a driven record of twice as many is searched
BLURRED = 0.01  # largest share of the motion's variance inside blocks: changes means by half of it, a size by no more


@dataclass(frozen=True, eq=False, slots=True)
class Residuals:
    """A fit, what it was fitted to, and of each sample used the ``noise`` and the ``stated`` errors (n_used, d)."""

    fitted: FitResult
    trajectory: Trajectory
    noise: Array
    stated: Array


def block_means(given: Residuals) -> Residuals:
    """The means over blocks of samples used; unchanged where the record is short, or the motion too fast for blocks.

    The noise is that of the mean of independent samples. Stated errors stay those of a sample: they may be correlated.

    Parameters
    ----------
    given
        A fit with all its samples.
    """
    starts = _starts(given.fitted, MIN_BLOCKS)
    if starts is None:
        return given
    fitted, used = given.fitted, given.fitted.used
    counts = np.diff(np.append(starts, fitted.n))

    def means(values: Array) -> Array:
        shape = (counts.size, *(1,) * (values.ndim - 1))
        return np.asarray(np.add.reduceat(values, starts, axis=0) / counts.reshape(shape))

    d, free = given.noise.shape[1], len(fitted.free)
    t_s, every = means(fitted.t_s[used]), np.ones(counts.size, dtype=np.bool_)
    short = replace(
        fitted,
        t_s=t_s,
        used=every,
        predicted=means(fitted.predicted[used]),
        residual=means(fitted.residual[used]),
        jacobian=means(fitted.jacobian.reshape(-1, d, free)).reshape(-1, free),
    )
    clip = given.trajectory
    inputs = None if clip.inputs is None else means(clip.inputs[used])
    trajectory = clip.with_(
        t_s=t_s,
        position=means(clip.position[used]),
        sigma=means(clip.sigma[used]),
        valid=every,
        inputs=inputs,
        segments=(),
        smoothed=None,
        systematic={},
        view=view_of(clip, fitted.model),
    )
    noise = np.sqrt(means(given.noise**2) / counts[:, None])
    return Residuals(short, trajectory, noise, means(given.stated))


def one_a_block(fitted: FitResult, trajectory: Trajectory, few: int) -> NDArray[np.intp]:
    """Indices (m,) of the first sample used of each block; of all used where blocks have one sample.

    Of a long driven record they are its first DRIVEN samples: between samples an input is known by the samples alone.

    Parameters
    ----------
    fitted, trajectory
        A fit, and what it was fitted to.
    few
        Number of samples up to which all are used, and of blocks that a longer record has at least.
    """
    used = np.flatnonzero(fitted.used)
    if trajectory.inputs is not None:
        return first_samples(used)
    starts = _starts(fitted, few)
    return used if starts is None else used[starts]


def first_samples(used: NDArray[np.intp]) -> NDArray[np.intp]:
    """The first DRIVEN of the indices (m,) of a driven record's samples, where there are twice as many; else all."""
    return used[:DRIVEN] if used.size >= 2 * DRIVEN else used


def at_samples(trajectory: Trajectory, which: NDArray[np.intp]) -> Trajectory:
    """The trajectory with some of its samples alone, all in one segment, and without what their errors have in common.

    One with inputs keeps all its rows; the others are not valid.

    Parameters
    ----------
    trajectory
        Has these samples.
    which
        Indices (m,), increasing.
    """
    if trajectory.inputs is not None:
        return trajectory.with_(valid=np.isin(np.arange(trajectory.n), which))
    return trajectory.with_(
        t_s=trajectory.t_s[which],
        position=trajectory.position[which],
        sigma=trajectory.sigma[which],
        valid=trajectory.valid[which],
        segments=(),
        smoothed=None,
        first_frame=None,
    )


def _starts(fitted: FitResult, few: int) -> NDArray[np.intp] | None:
    """Indices (m,), among the samples used, at which blocks of equal duration begin; None for blocks of one sample."""
    seen, t_s = fitted.predicted[fitted.used], fitted.t_s[fitted.used]
    size = fitted.n // few
    while size > 1:
        number = np.floor((t_s - t_s[0]) / (size * np.median(np.diff(t_s))) * (1 + 1e-9))
        starts = np.flatnonzero(np.diff(number, prepend=-1.0))
        if _inside(seen, starts) < BLURRED:
            return starts
        size //= 2
    return None


def _inside(values: Array, starts: NDArray[np.intp]) -> float:
    """Share of the variance of values (n, d) that lies inside blocks, of the quantity where it is largest."""
    counts = np.diff(np.append(starts, len(values)))[:, None]
    about = values - values.mean(axis=0)
    between = np.sum(np.add.reduceat(about, starts, axis=0) ** 2 / counts, axis=0)
    total = np.sum(about**2, axis=0)
    return float(np.max(1.0 - between / np.where(total > 0, total, 1.0), where=total > 0, initial=0.0))
