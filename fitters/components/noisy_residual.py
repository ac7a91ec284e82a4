"""A residual with its noise, and as independent noise would have it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array

UNDETERMINED = 1e-9  # relative strength of a fitted value below which the data do not determine it


@dataclass(frozen=True, eq=False, slots=True)
class NoisyResidual:
    """What a fit leaves, with its noise, at n used samples.

    ``t_s`` (n,) s; ``values`` (n, d) in observed units; ``jacobian`` (n, d, p) of the prediction by the fitted values;
    ``noise`` (n, d) standard deviations of independent noise, up to a common factor.
    """

    t_s: Array
    values: Array
    jacobian: Array
    noise: Array

    def at(self, rows: NDArray[np.intp]) -> NoisyResidual:
        """The same at some of the samples."""
        return NoisyResidual(self.t_s[rows], self.values[rows], self.jacobian[rows], self.noise[rows])

    def whitened(self, responses: Array, rho: float) -> Whitened:
        """The residual and responses (n, d, k) for noise that is correlated by ``rho`` over the median time step."""
        kept, scale = _memory(self.t_s, rho)
        jacobian = _white(self.jacobian / self.noise[:, :, None], kept, scale)
        basis, triangle = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))
        strength = np.abs(np.diag(triangle))
        basis = basis[:, strength > UNDETERMINED]
        values = _white((self.values / self.noise)[:, :, None], kept, scale)[:, 0]
        columns = _white(responses / self.noise[:, :, None], kept, scale)
        volume = np.sum(np.log(np.maximum(np.abs(np.diag(triangle)), 1e-300)))
        volume += np.sum(np.log(np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)))
        return Whitened(
            values - basis @ (basis.T @ values),
            columns - basis @ (basis.T @ columns),
            max(values.size - basis.shape[1], 1),
            self.values.shape[1] * float(np.sum(np.log(scale))),
            float(volume),
        )


def white_noise_series(series: Array, t_s: Array, rho: float) -> Array:
    """Innovations (n * d, k) of a series (n, d, k), for noise correlated by ``rho`` over the median step of ``t_s``."""
    return _white(series, *_memory(t_s, rho))


def _memory(t_s: Array, rho: float) -> tuple[Array, Array]:
    """How much of the noise of each sample the next one keeps (n - 1,), and the scale of its innovations (n,)."""
    steps = np.diff(t_s) / np.median(np.diff(t_s))
    kept = rho**steps if rho > 0 else np.zeros_like(steps)
    return kept, np.concatenate([[1.0], 1.0 / np.sqrt(1.0 - kept**2)])


def _white(series: Array, kept: Array, scale: Array) -> Array:
    """Innovations (n * d, k) of a series (n, d, k), of the same variance as the series itself."""
    rest = series.copy()
    rest[1:] -= kept[:, None, None] * series[:-1]
    return np.asarray((rest * scale[:, None, None]).reshape(len(series) * series.shape[1], series.shape[2]))


@dataclass(frozen=True, eq=False)
class Whitened:
    """A residual (q,) and responses (q, k), as independent noise has them, without what fitted values can imitate.

    ``degrees`` is q less the number of fitted values; ``log_scale`` is what the change of variables adds to the log
    likelihood, ``volume`` what the fitted values take from it (restricted likelihood).
    """

    residual: Array
    responses: Array
    degrees: int
    log_scale: float
    volume: float

    @cached_property
    def information(self) -> Array:
        """Products of the responses (k, k)."""
        return np.asarray(self.responses.T @ self.responses)

    @cached_property
    def components(self) -> Array:
        """Products (k,) of the residual with the responses."""
        return np.asarray(self.responses.T @ self.residual)

    @cached_property
    def squares(self) -> float:
        """Sum of squares of the residual."""
        return float(self.residual @ self.residual)
