"""The latent pipeline's losses and integrators, minimised exactly on a tracked angle instead of a learned latent.

A latent pipeline's error has two sources: the encoder, and the loss function of the physics. Here the loss is the
publication's and the observable is measured, so the remaining error is that of the loss.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import least_squares

from iris_sysid.types import Array

START = np.array([0.5, 0.05])  # gamma_0 and gamma_1 before training, app:physics_block
WEIGHTS = np.array([1.0, 1.0, 0.5, 0.5, 0.25])  # of the horizons 1 to 5, from the publication
HORIZONS: Mapping[str, int] = {"one-step": 1, "five-step": 5}

Pull = Callable[[Array, Array], Array]
Step = Callable[[Array, Array, float, Pull], tuple[Array, Array]]


def without_acceleration(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Explicit Euler step: the position is updated without the acceleration.

    ``z`` and ``v`` (n,): position, in any unit, and velocity, in that unit per second.

    Parameters
    ----------
    z, v
        Position and velocity.
    dt
        Time step in s.
    pull
        Acceleration by position and velocity.
    """
    return z + dt * v, v + dt * pull(z, v)


def euler_cromer(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Euler-Cromer step, the publication's correction: the position is updated with the new velocity.

    ``z`` and ``v`` (n,): position, in any unit, and velocity, in that unit per second.

    Parameters
    ----------
    z, v, dt, pull
        As for :func:`without_acceleration`.
    """
    v = v + dt * pull(z, v)
    return z + dt * v, v


def stoermer_verlet(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Stoermer-Verlet step: half a velocity update, a position update, half a velocity update.

    ``z`` and ``v`` (n,): position, in any unit, and velocity, in that unit per second.

    Parameters
    ----------
    z, v, dt, pull
        As for :func:`without_acceleration`.
    """
    half = v + dt / 2 * pull(z, v)
    z = z + dt * half
    return z, half + dt / 2 * pull(z, half)


def runge_kutta(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Classical Runge-Kutta step of order 4.

    ``z`` and ``v`` (n,): position, in any unit, and velocity, in that unit per second.

    Parameters
    ----------
    z, v, dt, pull
        As for :func:`without_acceleration`.
    """
    k1, l1 = v, pull(z, v)
    k2, l2 = v + dt / 2 * l1, pull(z + dt / 2 * k1, v + dt / 2 * l1)
    k3, l3 = v + dt / 2 * l2, pull(z + dt / 2 * k2, v + dt / 2 * l2)
    k4, l4 = v + dt * l3, pull(z + dt * k3, v + dt * l3)
    return z + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4), v + dt / 6 * (l1 + 2 * l2 + 2 * l3 + l4)


def yoshida(z: Array, v: Array, dt: float, pull: Pull) -> tuple[Array, Array]:
    """Three Stoermer-Verlet steps of order 4 (Yoshida 1990, Phys. Lett. A 150, 262).

    ``z`` and ``v`` (n,): position, in any unit, and velocity, in that unit per second.

    Parameters
    ----------
    z, v, dt, pull
        As for :func:`without_acceleration`.
    """
    outer = 1 / (2 - 2 ** (1 / 3))
    for part in (outer, 1 - 2 * outer, outer):
        z, v = stoermer_verlet(z, v, part * dt, pull)
    return z, v


INTEGRATORS: Mapping[str, Step] = {
    "no acceleration in z": without_acceleration,
    "Euler-Cromer": euler_cromer,
    "Stoermer-Verlet": stoermer_verlet,
    "RK4": runge_kutta,
    "Yoshida-4": yoshida,
}
BENDS: Mapping[str, Callable[[Array], Array]] = {"linear": np.asarray, "sine": np.sin}


def misses(gamma: Array, theta: Array, dt: float, step: Step, horizons: int, bend: Callable[[Array], Array]) -> Array:
    """Weighted differences of all windows: the angle after 1 to ``horizons`` steps minus the tracked angle.

    The velocity at the start of a window is the backward difference of the tracked angle.

    Parameters
    ----------
    gamma
        g/L in 1/s^2 and the damping in 1/s.
    theta
        Tracked angles (n,) in rad at equal steps.
    dt
        Time step in s.
    step
        Integrator.
    horizons
        Number of predicted steps, 1 to 5.
    bend
        The angle itself for the linear equation, its sine for the exact one.
    """
    z, v = theta[1 : theta.size - horizons], np.diff(theta)[: theta.size - horizons - 1] / dt
    parts = []
    for k in range(1, horizons + 1):
        z, v = step(z, v, dt, lambda z, v: -gamma[1] * v - gamma[0] * bend(z))
        parts.append(np.sqrt(WEIGHTS[k - 1]) * (z - theta[1 + k : theta.size - horizons + k]))
    return np.concatenate(parts)


def stiffness_of(theta: Array, dt: float, step: Step, horizons: int, bend: Callable[[Array], Array]) -> float:
    """The g/L in 1/s^2 that minimises a loss, from the publication's start; NaN where g/L stays at its start.

    ``theta`` (n,), rad.

    Parameters
    ----------
    theta, dt, step, horizons, bend
        As for :func:`misses`.
    """
    solution = least_squares(misses, START, args=(theta, dt, step, horizons, bend), x_scale="jac")
    return np.nan if np.allclose(solution.x[0], START[0], rtol=1e-6) else float(solution.x[0])
