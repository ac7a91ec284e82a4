"""What the models of pendulums share: the guess from one swing, and the states of a pair."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from fitters.models._gravity import STANDARD_GRAVITY
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import Array, Quantity, Trajectory

PAIR_STATES = (
    Quantity("theta1", "rad", r"\theta_1"),
    Quantity("theta2", "rad", r"\theta_2"),
    Quantity("omega1", "rad/s", r"\omega_1"),
    Quantity("omega2", "rad/s", r"\omega_2"),
)


def swing_guess(trajectory: Trajectory, restoring: Callable[[Array], Array]) -> Mapping[str, float]:
    """Take gravity / length and damping from theta'' regressed on a restoring term and theta' in weak form.

    ``restoring`` takes angles (n,), rad, to the term (n,), dimensionless: the sine, or the angle itself.
    """
    t_s, theta = samples(trajectory, "theta")
    (stiffness, friction), half_width_s = weak_regression(t_s, theta, -restoring(theta)[:, None])
    if not stiffness > 0:  # nothing swings back: take the clip for a quarter of a period
        stiffness, friction = (np.pi / 2 / (t_s[-1] - t_s[0])) ** 2, 0.0
    start = start_of(t_s, theta, min(half_width_s, 0.5 / np.sqrt(stiffness)))
    return {
        "length": STANDARD_GRAVITY / float(stiffness),
        "damping": float(np.clip(-friction, 0.0, 2.0)),
        "theta_0": float(start[0]),
        "omega_0": float(start[1]) if start.size > 1 else 0.0,
    }
