"""Motions with known events, as a tracker would see them."""

import numpy as np
from scipy.integrate import solve_ivp

from iris_sysid import Quantity, Trajectory


def in_plane(t_s, position, sigma, valid=None, unit="px", rng=None, **more):
    """A trajectory of x and z; white noise of the stated sigma is added when a generator is given."""
    position = np.asarray(position, float)
    if rng is not None:
        position = position + sigma * rng.standard_normal(position.shape)
    valid = np.ones(len(t_s), bool) if valid is None else np.asarray(valid)
    position = np.where(valid[:, None], position, np.nan)
    return Trajectory(
        t_s, (Quantity("x", unit), Quantity("z", unit)), position, np.broadcast_to(sigma, position.shape), valid, **more
    )


def pendulum_angle(t_s, amplitude_rad, length_m=1.0, damping=0.05):
    """Angle of a pendulum released at rest, by integration."""

    def slope(t, state):
        return state[1], -damping * state[1] - 9.81 / length_m * np.sin(state[0])

    return solve_ivp(slope, (0.0, t_s[-1]), (amplitude_rad, 0.0), t_eval=t_s, rtol=1e-9, atol=1e-9).y[0]


def on_arc(theta, radius, pivot=(0.0, 0.0)):
    return np.column_stack([pivot[0] + radius * np.sin(theta), pivot[1] - radius * np.cos(theta)])


def bouncing_ball(t_s, height, gravity, restitution=0.7, speed_x=0.0, launch=0.0):
    """Positions (n, 2) of a ball over a floor at z = 0, and the times of its bounces."""
    z0, v0, t0, z, bounces = height, launch, 0.0, np.empty(t_s.size), []
    for k, t in enumerate(t_s):
        while (hit := t0 + (v0 + np.sqrt(v0**2 + 2 * gravity * z0)) / gravity) <= t:
            z0, v0, t0 = 0.0, restitution * np.sqrt(v0**2 + 2 * gravity * z0), hit
            bounces.append(hit)
        z[k] = z0 + v0 * (t - t0) - gravity * (t - t0) ** 2 / 2
    return np.column_stack([speed_x * t_s, z]), bounces


def down_a_board(t_s, start_s, acceleration, angle_rad, length):
    """At rest until ``start_s``, then down a straight board, then stopped at its end."""
    distance = 0.5 * acceleration * np.clip(t_s - start_s, 0.0, None) ** 2
    return np.minimum(distance, length)[:, None] * np.array([np.cos(angle_rad), -np.sin(angle_rad)])
