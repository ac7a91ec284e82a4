"""A coordinate driven by white jerk: how it moves, how it starts without prior knowledge, how likely its data are.

The state is (value, rate, second derivative). Between samples a time ``dt`` apart it moves by ``F`` and gathers the
noise ``Q`` (Bar-Shalom, Li and Kirubarajan 2001, Estimation with Applications to Tracking and Navigation, 6.2.3)::

    F = [1 dt dt²/2]        Q = q [dt⁵/20 dt⁴/8 dt³/6]
        [0  1   dt ]              [dt⁴/8  dt³/3 dt²/2]
        [0  0    1 ]              [dt³/6  dt²/2 dt   ]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from iris_sysid.io.kernels import kernel
from iris_sysid.types import Array

ORDER = 3  # numbers in the state: as many samples fix it when nothing is known beforehand
_BACKWARDS = np.array([1.0, -1.0, 1.0])  # value, rate, second derivative of the same motion when time runs backwards


def transition(dt: ArrayLike) -> Array:
    """F (..., 3, 3) over times dt (...); dt < 0 goes back.

    Times are in s; the state is a position, velocity and acceleration in a unit, and that per s and s^2.
    """
    dt = np.asarray(dt, dtype=np.float64)
    ones, zeros = np.ones_like(dt), np.zeros_like(dt)
    return _stacked([[ones, dt, dt**2 / 2], [zeros, ones, dt], [zeros, zeros, ones]])


def process_noise(dt: ArrayLike, psd: float) -> Array:
    """Q (..., 3, 3) gathered over times dt (...) >= 0 by jerk of power spectral density psd.

    Times are in s; psd is in the squared unit of the position per s^5.
    """
    dt = np.asarray(dt, dtype=np.float64)
    q00, q01, q02, q11, q12 = dt**5 / 20, dt**4 / 8, dt**3 / 6, dt**3 / 3, dt**2 / 2
    return psd * _stacked([[q00, q01, q02], [q01, q11, q12], [q02, q12, dt]])


def _stacked(rows: list[list[Array]]) -> Array:
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


@dataclass(frozen=True, eq=False, slots=True)
class SmootherStart:
    """The state after the first three measurements without prior knowledge (an exactly diffuse start).

    ``state`` (3,) and ``covariance`` (3, 3) hold at the third measurement. Given the state there, an earlier
    state is ``offset + matrix @ state`` with covariance ``spread``: see :meth:`earlier`.
    """

    t: Array
    z: Array
    variance: Array
    psd: float
    state: Array
    covariance: Array

    def earlier(self, t: float, state: Array, covariance: Array) -> tuple[Array, Array]:
        """State (3,) and covariance (3, 3) at a time before the third measurement, from those smoothed there.

        The time is in the unit of ``self.t``.
        """
        before = self.t[2] - self.t[:2]
        design = np.array([transition(-dt)[0] for dt in before])
        noise = _values_covariance(before, self.psd) + np.diag(self.variance[:2])
        step = self.t[2] - t
        cross = np.array([_shared_noise(step, dt, self.psd)[:, 0] for dt in before]).T
        gain = np.linalg.solve(noise, cross.T).T
        matrix = transition(-step) - gain @ design
        spread = _shared_noise(step, step, self.psd) - gain @ cross.T
        return matrix @ state + gain @ self.z[:2], spread + matrix @ covariance @ matrix.T


def diffuse_start(t: Array, z: Array, variance: Array, psd: float) -> SmootherStart:
    """Solve for the state at the third measurement: three equations, three unknowns, and their covariance.

    Times are in s, variances in the squared unit of the measurements.

    The limit of a prior without information (de Jong 1991, Ann. Statist. 19, 1073), with no large numbers in it.

    Parameters
    ----------
    t
        (n,) times of the measurements, n >= 3.
    z, variance
        (n,) measurements and the variance of each.
    psd
        Power spectral density of the jerk.
    """
    before = t[2] - t[:3]
    inverse = np.linalg.inv(np.array([transition(-dt)[0] for dt in before]))
    noise = _values_covariance(before, psd) + np.diag(variance[:3])
    return SmootherStart(t[:3], z[:3], variance[:3], psd, inverse @ z[:3], inverse @ noise @ inverse.T)


def _shared_noise(first: float, second: float, psd: float) -> Array:
    """Covariance (3, 3) of the noise gathered going back by ``first`` and by ``second`` from the same state."""
    common = _BACKWARDS[:, None] * process_noise(min(first, second), psd) * _BACKWARDS
    if first >= second:
        return transition(second - first) @ common
    return common @ transition(first - second).T


def _values_covariance(before: Array, psd: float) -> Array:
    return np.array([[_shared_noise(first, second, psd)[0, 0] for second in before] for first in before])


@kernel(error_model="python")
def innovations(
    t: Array, z: Array, variance: Array, psd: float, state: Array, covariance: Array
) -> tuple[Array, Array]:  # pragma: no cover - compiled
    """Innovation and its variance at each measurement after the third, by the Kalman filter written out in scalars.

    Times are in s, variances in the squared unit of the measurements.

    Parameters
    ----------
    t
        (n,) times of the measurements; a gap is a longer step.
    z, variance
        (n,) measurements and the variance of each.
    psd
        Power spectral density of the jerk.
    state, covariance
        (3,) and (3, 3) at the third measurement, from :func:`diffuse_start`.

    Returns
    -------
    innovation, innovation_variance : (n - 3,)
    """
    count = z.size - 3
    innovation, innovation_variance = np.empty(count), np.empty(count)
    x0, x1, x2 = state
    p00, p01, p02 = covariance[0]
    p11, p12, p22 = covariance[1, 1], covariance[1, 2], covariance[2, 2]
    for k in range(count):
        dt = t[k + 3] - t[k + 2]
        half = dt * dt / 2
        x0, x1 = x0 + dt * x1 + half * x2, x1 + dt * x2
        a00, a01, a02 = p00 + dt * p01 + half * p02, p01 + dt * p11 + half * p12, p02 + dt * p12 + half * p22
        a11, a12 = p11 + dt * p12, p12 + dt * p22
        p00 = a00 + dt * a01 + half * a02 + psd * dt**5 / 20
        p01 = a01 + dt * a02 + psd * dt**4 / 8
        p02 = a02 + psd * dt**3 / 6
        p11 = a11 + dt * a12 + psd * dt**3 / 3
        p12 = a12 + psd * dt**2 / 2
        p22 = p22 + psd * dt
        s = p00 + variance[k + 3]
        y = z[k + 3] - x0
        g0, g1, g2 = p00 / s, p01 / s, p02 / s
        x0, x1, x2 = x0 + g0 * y, x1 + g1 * y, x2 + g2 * y
        p11, p12, p22 = p11 - g1 * p01, p12 - g1 * p02, p22 - g2 * p02
        p00, p01, p02 = p00 * variance[k + 3] / s, p01 * variance[k + 3] / s, p02 * variance[k + 3] / s
        innovation[k], innovation_variance[k] = y, s
    return innovation, innovation_variance
