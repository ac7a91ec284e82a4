"""Motion model of the bodies: Kalman prediction at constant velocity, and velocities after an impact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iris_sysid.types import Array, Mask

ACCELERATION = 0.15  # radii per frame squared, standard deviation: hands, gravity, cords
FIRST_SPEED = 1.0  # radii per frame, standard deviation before anything is known
MEASURED = 0.05  # radii, standard deviation of a centre at the size of the search
STRUCK = 0.5  # radii per frame, standard deviation of what a contact may change
TOUCHING = 1.25  # times the sum of the radii: nearer than that two bodies may strike each other
RESTITUTION = 0.5  # assumed of an impact: the frames after it correct the velocity
OVERLAP = 0.97  # times the sum of the radii: bodies cannot come nearer
SWEEPS = 6  # through the contacts of a pile


@dataclass(eq=False, slots=True)
class MotionStates:
    """States of n bodies in units of px and frames: position and velocity (n, 2), covariance of each axis (n, 2, 2).

    The filter is Kalman's for white acceleration (Bar-Shalom, Li and Kirubarajan 2001, section 6.3.2); the
    axes are independent and alike.
    """

    position: Array
    velocity: Array
    covariance: Array
    radius: Array

    @classmethod
    def at(cls, position: Array, radius: Array) -> MotionStates:
        """Bodies (n, 2) px of those radii (n,) px with unknown velocity."""
        covariance = np.zeros((len(position), 2, 2))
        covariance[:, 0, 0], covariance[:, 1, 1] = (MEASURED * radius) ** 2, (FIRST_SPEED * radius) ** 2
        return cls(position.copy(), np.zeros_like(position), covariance, radius)

    def advance(self, frames: float) -> None:
        """Predict the states a number of frames later; a contact lets the velocity change at once."""
        struck = STRUCK * self.radius * self.touching()
        step = np.array([[1.0, frames], [0.0, 1.0]])
        noise = np.array([[frames**4 / 4, frames**3 / 2], [frames**3 / 2, frames**2]])
        self.covariance[:, 1, 1] += struck**2
        self.position = self.position + frames * self.velocity
        growth = (ACCELERATION * self.radius) ** 2
        self.covariance = step @ self.covariance @ step.T + growth[:, np.newaxis, np.newaxis] * noise

    def correct(self, measure_bodies: Array, seen: Mask, doubt: Array) -> None:
        """Take in centres (n, 2) px of the bodies that are ``seen`` (n,), ``doubt`` (n,) times as unsure as usual."""
        variance = self.covariance[:, 0, 0] + (MEASURED * self.radius * doubt) ** 2
        gain = np.where(seen[:, np.newaxis], self.covariance[:, :, 0] / variance[:, np.newaxis], 0.0)
        innovation = measure_bodies - self.position
        self.position = self.position + np.where(seen[:, np.newaxis], gain[:, :1] * innovation, 0.0)
        self.velocity = self.velocity + np.where(seen[:, np.newaxis], gain[:, 1:] * innovation, 0.0)
        self.covariance = self.covariance - gain[:, :, np.newaxis] * self.covariance[:, np.newaxis, 0, :]

    def touching(self) -> Mask:
        """Which bodies are near enough to another to strike it. Shape (bodies,)."""
        near = self._apart() < TOUCHING * (self.radius[:, np.newaxis] + self.radius)
        np.fill_diagonal(near, False)
        return np.asarray(near.any(axis=1))

    def _apart(self) -> Array:
        return np.linalg.norm(self.position[:, np.newaxis] - self.position, axis=-1)

    def after_impacts(self, frames: float) -> Array:
        """Positions (n, 2) after a number of frames in which bodies that would overlap strike each other.

        Pair by pair the normal velocities are exchanged as for solid balls of one material,
        v_i' = v_i - (1 + e) m_j / (m_i + m_j) ((v_i - v_j).n) n, until no pair approaches; then what
        still overlaps is moved apart.
        """
        mass, velocity = self.radius**3, self.velocity.copy()
        pairs = np.argwhere(np.triu(self._apart() < 2 * TOUCHING * (self.radius[:, np.newaxis] + self.radius), 1))
        position = self.position + frames * velocity
        for _ in range(SWEEPS):
            for i, j in pairs:
                way = position[j] - position[i]
                distance = float(np.hypot(*way))
                least = OVERLAP * (self.radius[i] + self.radius[j])
                if distance >= least or distance == 0:
                    continue
                normal = way / distance
                closing = float((velocity[i] - velocity[j]) @ normal)
                share = np.array([mass[j], mass[i]]) / (mass[i] + mass[j])
                if closing > 0:
                    velocity[i] -= (1 + RESTITUTION) * share[0] * closing * normal
                    velocity[j] += (1 + RESTITUTION) * share[1] * closing * normal
                position[i] = position[i] - share[0] * (least - distance) * normal
                position[j] = position[j] + share[1] * (least - distance) * normal
        return position
