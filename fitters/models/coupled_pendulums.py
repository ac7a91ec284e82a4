"""Two pendulums with a continuous coupling, as the IRIS benchmark has them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._gravity import GRAVITY, STANDARD_GRAVITY
from fitters.models._pendulum import PAIR_STATES
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Trajectory


def rhs(
    t: float, state: tuple[float, float, float, float], params: tuple[float, ...]
) -> tuple[float, float, float, float]:
    """Give theta_i'' = -damping_i theta_i' - (gravity / length_i) sin theta_i - coupling (theta_i - theta_j)."""
    theta_1, theta_2, omega_1, omega_2 = state
    length_1, length_2, damping_1, damping_2, coupling, gravity = params
    pull = coupling * (theta_1 - theta_2)
    return (
        omega_1,
        omega_2,
        -damping_1 * omega_1 - gravity / length_1 * np.sin(theta_1) - pull,
        -damping_2 * omega_2 - gravity / length_2 * np.sin(theta_2) + pull,
    )


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take each pendulum's acceleration regressed on sin theta, the difference of the angles and the speed."""
    t_s, theta_1 = samples(trajectory, "theta1")
    _, theta_2 = samples(trajectory, "theta2")
    values, couplings = {}, []
    for body, own, other in (("1", theta_1, theta_2), ("2", theta_2, theta_1)):
        terms = np.column_stack([-np.sin(own), other - own])
        (stiffness, coupling, friction), half_width_s = weak_regression(t_s, own, terms)
        if not stiffness > 0:  # e.g. barely moving: take the clip for a quarter of a period
            stiffness, coupling, friction = (np.pi / 2 / (t_s[-1] - t_s[0])) ** 2, 0.0, 0.0
        start = start_of(t_s, own, min(half_width_s, 0.5 / np.sqrt(stiffness)))
        values[f"length_{body}"] = STANDARD_GRAVITY / float(stiffness)
        values[f"damping_{body}"] = float(np.clip(-friction, 0.0, 2.0))
        values[f"theta{body}_0"], values[f"omega{body}_0"] = float(start[0]), float(start[1])
        couplings.append(float(coupling))
    return {**values, "coupling": float(np.mean(couplings))}


def energy(states: Array, params: Array) -> Array:
    """Sum of the energies per mass and length squared, with that of the coupling, in 1/s^2.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    theta, omega = states[:, :2], states[:, 2:]
    stiffness = params[5] / params[:2]
    swing = np.sum(omega**2 / 2 + stiffness * (1.0 - np.cos(theta)), axis=1)
    return np.asarray(swing + params[4] * (theta[:, 0] - theta[:, 1]) ** 2 / 2)


MODEL = OdeModel(
    name="coupled-pendulums",
    summary="two pendulums that pull at one another in proportion to the difference of their angles",
    equation=r"\ddot\theta_i + \zeta_i\,\dot\theta_i + \frac{g}{L_i}\,\sin\theta_i + \kappa\,(\theta_i - \theta_j) = 0",
    source="IRIS benchmark, equation of the two pendulums, with sin theta in place of theta",
    states=PAIR_STATES,
    parameters=(
        Parameter("length_1", "m", "L_1", lower=1e-3, upper=200.0),
        Parameter("length_2", "m", "L_2", lower=1e-3, upper=200.0),
        Parameter("damping_1", "1/s", r"\zeta_1", lower=-2.0, upper=50.0, default=0.0, role="damping"),
        Parameter("damping_2", "1/s", r"\zeta_2", lower=-2.0, upper=50.0, default=0.0, role="damping"),
        Parameter("coupling", "1/s^2", r"\kappa", lower=-1e4, upper=1e6, default=0.0),
        GRAVITY,
    ),
    observed=PAIR_STATES[:2],
    rhs=rhs,
    guess=guess,
    first_integral=energy,
    dissipative=("damping_1", "damping_2"),
    typical="two pendulums of 0.5 m that exchange their motion and take it back in 10 s: coupling 2.8 1/s^2",
    example=ModelExample(
        {
            "length_1": 0.5,
            "length_2": 0.45,
            "damping_1": 0.1,
            "damping_2": 0.15,
            "coupling": 2.0,
            "theta1_0": 1.0,
            "theta2_0": -0.3,
            "omega1_0": 0.0,
            "omega2_0": 0.2,
        },
        samples=600,
        rate_hz=60.0,
    ),
)
