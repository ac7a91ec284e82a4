r"""A small force of unknown form along a fitted motion, with its error: Gaussian process regression.

The residual y responds linearly to a small force a(t) and to small changes dp of the fitted values,
y = R a + J dp + noise, where R follows from the transition matrices of the fitted motion (a latent force model:
Alvarez, Luengo and Lawrence 2013, IEEE Trans. PAMI 35, 2693). The prior of a is a Gaussian process with Matern kernels
of order 3/2 (Rasmussen and Williams 2006, eq. 4.17) in the time, in the state, or in both; that of dp is flat; the
noise is an autoregression of first order. Kernel, size of the force, and autocorrelation and size of the noise are
integrated out over a grid, each point weighed by its restricted likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.special import logsumexp

from fitters.effect_sensitivity import Motion
from fitters.latent_force.linear_response import NoisyResidual, Whitened, responses
from iris_sysid.types import Array

NODES = 100  # times at which the force is estimated, over all degrees of freedom
NODES_A_RADIAN = 2.0  # of the motion: 12 in a period
NEARLY_ALL = 0.75  # of a clip: then the nodes lie a little farther apart and cover it all
MOST_SAMPLES = 3000  # beyond, every second (third, ...) sample is used
MEMORIES = 4  # lengths of the prior's memory, from two nodes to the clip
LENGTHS = (0.5, 2.0)  # of the prior's memory in the state, in root mean squares of it
SIZES = np.logspace(-1.0, 10.0, 34)  # variance of the response to the force over that of the noise
CORRELATIONS = (0.0, 0.45, 0.8)  # of the noise from sample to sample
NEGLIGIBLE = 1e-3  # posterior probability of a grid point that is left out
NEGLIGIBLE_VARIANCE = 1e-5  # relative variance of a direction of the prior that is left out


@dataclass(frozen=True, eq=False, slots=True)
class LatentForce:
    """A force at k nodes ``t_s`` (k,) s: its ``mean`` (f * k,), degree of freedom by degree, and ``covariance``.

    ``log_odds`` is the log of the Bayes factor of a force over none; ``rho`` the likeliest correlation of the noise,
    ``noise_variance`` its variance in units of the stated one, the force deducted.
    """

    t_s: Array
    mean: Array
    covariance: Array
    log_odds: float
    rho: float
    noise_variance: float


@dataclass(frozen=True, eq=False, slots=True)
class _Posterior:
    """The force under one kernel and correlation of the noise, for each size of the prior.

    ``root`` (k, r) maps independent coordinates to forces; ``values`` and ``along`` (r,) are eigenvalues of the
    information and the data's components along its eigenvectors; ``squares`` and ``log_likelihood`` one a size.
    """

    root: Array
    values: Array
    along: Array
    sizes: Array
    squares: Array
    log_likelihood: Array
    degrees: int

    @classmethod
    def of(cls, white: Whitened, root: Array) -> _Posterior:
        values, vectors = eigh(root.T @ white.information @ root)
        values = np.maximum(values, 0.0)
        along = vectors.T @ (root.T @ white.components)
        sizes = SIZES / max(float(values[-1]), 1e-300)
        shrink = sizes[:, None] / (1.0 + sizes[:, None] * values)
        squares = white.squares - np.sum(shrink * along**2, axis=1)
        volume = 0.5 * np.sum(np.log1p(sizes[:, None] * values), axis=1)
        likelihood = white.log_likelihood(squares) - volume
        return cls(root @ vectors, values, along, sizes, squares, likelihood, white.degrees)

    def moments(self, weights: Array) -> tuple[Array, Array]:
        """Weighted sums over the sizes: of the mean (k,), and of covariance plus mean times mean (k, k)."""
        shrink = self.sizes[:, None] / (1.0 + self.sizes[:, None] * self.values)
        means = (shrink * self.along) @ self.root.T
        spread = weights * np.maximum(self.squares, 0.0) / self.degrees
        covariance = (self.root * (spread @ shrink)) @ self.root.T
        return weights @ means, covariance + (means.T * weights) @ means


def latent_force(motion: Motion, residual: NoisyResidual) -> LatentForce:
    """Estimate the force on a motion that explains the residual of its fit.

    Parameters
    ----------
    motion
        A fitted motion with the inverse of its transition matrices.
    residual
        Of the fit, at the samples used.
    """
    nodes, count = _nodes(motion), motion.model.degrees_of_freedom
    rows = _rows(motion, nodes[-1])
    part, shown = residual.at(rows), responses(motion, _hats(motion.grid, nodes, count), rows)
    whites = [part.whitened(shown, rho) for rho in CORRELATIONS]
    roots = [np.asarray(np.kron(np.eye(count), root), dtype=np.float64) for root in _prior_roots(motion, nodes)]
    posteriors = [_Posterior.of(white, root) for white in whites for root in roots]
    mean, covariance = _mixture(posteriors)
    none = [float(white.log_likelihood(white.squares)) for white in whites]
    likelihoods = np.array([posterior.log_likelihood for posterior in posteriors])
    best, size = np.unravel_index(int(np.argmax(likelihoods)), likelihoods.shape)
    return LatentForce(
        nodes,
        mean,
        covariance,
        _log_mean(likelihoods) - _log_mean(np.array(none)),
        CORRELATIONS[int(best) // len(roots)],
        float(posteriors[int(best)].squares[int(size)] / posteriors[int(best)].degrees),
    )


def _log_mean(logs: Array) -> float:
    return float(logsumexp(logs)) - float(np.log(logs.size))


def _mixture(posteriors: Sequence[_Posterior]) -> tuple[Array, Array]:
    """Mean (k,) and covariance (k, k) over all kernels and sizes."""
    # uniform in the standard deviation (Gelman 2006): uniform in its logarithm, small forces have too narrow a band
    logs = np.array([posterior.log_likelihood + 0.5 * np.log(SIZES) for posterior in posteriors])
    weights = np.exp(logs - logsumexp(logs))
    kept = [
        posterior.moments(weight)
        for posterior, weight in zip(posteriors, weights, strict=True)
        if weight.sum() > NEGLIGIBLE
    ]
    mean = np.sum([first for first, _ in kept], axis=0)
    return mean, np.sum([second for _, second in kept], axis=0) - np.outer(mean, mean)


def _nodes(motion: Motion) -> Array:
    """The times (k,) of the nodes, s: over the clip, or as much of its beginning as they resolve."""
    count = max(min(NODES // motion.model.degrees_of_freedom, motion.at_samples.size), 2)
    start_s, end_s = motion.grid[0], motion.grid[-1]
    resolved_s = (count - 1) * _time_scale(motion) / NODES_A_RADIAN
    span_s = end_s - start_s if resolved_s > NEARLY_ALL * (end_s - start_s) else resolved_s
    return np.asarray(np.linspace(start_s, start_s + span_s, count))


def _time_scale(motion: Motion) -> float:
    """Time in which the motion changes, s: spread of the states over that of their rates, the fastest counts."""
    count = motion.model.degrees_of_freedom
    states, slopes = motion.states[:, -count:], motion.slopes[:, -count:]
    scale = np.std(states, axis=0) / np.maximum(np.sqrt(np.mean(slopes**2, axis=0)), 1e-300)
    return float(np.min(scale[scale > 0], initial=motion.grid[-1] - motion.grid[0]))


def _rows(motion: Motion, end_s: float) -> NDArray[np.intp]:
    """Indices of the used samples up to a time; every second (third, ...) where there are many."""
    inside = np.flatnonzero(motion.grid[motion.at_samples] <= end_s + 1e-9 * (end_s - motion.grid[0]))
    return inside[:: -(-inside.size // MOST_SAMPLES)]


def _hats(grid: Array, nodes: Array, count: int) -> Array:
    """Piecewise linear forces (m, f, f * k): one for each of k nodes and each of f = ``count`` degrees of freedom."""
    one = np.maximum(1.0 - np.abs(grid[:, None] - nodes) / (nodes[1] - nodes[0]), 0.0)
    return np.asarray(np.einsum("mk,fg->mfgk", one, np.eye(count)).reshape(grid.size, count, -1))


def _prior_roots(motion: Motion, nodes: Array) -> list[Array]:
    """Roots (k, r) of the prior's correlations: of a force that depends on the time, on the state, or on both."""
    step_s, span_s = nodes[1] - nodes[0], nodes[-1] - nodes[0]
    elapsed_s = np.abs(nodes[:, None] - nodes)
    states = np.column_stack([np.interp(nodes, motion.grid, column) for column in motion.states.T])
    scaled = states / np.maximum(np.sqrt(np.mean(states**2, axis=0)), 1e-300)
    apart = np.sqrt(np.sum((scaled[:, None] - scaled) ** 2, axis=2) / motion.model.degrees_of_freedom)
    forward = states[:, -motion.model.degrees_of_freedom :] > 0
    same_way = np.mean(forward[:, None] == forward, axis=2)  # dry friction jumps where the velocity turns
    memories_s = np.geomspace(2.0 * step_s, max(span_s, 4.0 * step_s), MEMORIES)
    kernels = [_matern(elapsed_s / memory_s) for memory_s in memories_s]
    kernels += [_matern(apart / length) for length in LENGTHS]
    kernels += [_matern(apart / length) * same_way for length in LENGTHS]
    kernels += [_matern(apart / length) * _matern(elapsed_s / span_s) for length in LENGTHS]
    return [_root(kernel) for kernel in kernels]


def _matern(distance: Array) -> Array:
    """Correlation (k, k) at distances (k, k) in units of the memory."""
    scaled = np.sqrt(3.0) * distance
    return np.asarray((1.0 + scaled) * np.exp(-scaled))


def _root(kernel: Array) -> Array:
    """Root (k, r) of a correlation (k, k), without its negligible directions."""
    values, vectors = eigh(kernel)
    kept = values > NEGLIGIBLE_VARIANCE * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))
