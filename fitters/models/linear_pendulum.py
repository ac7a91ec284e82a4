"""The pendulum with its angle in place of the sine: right for small angles only."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._gravity import GRAVITY
from fitters.models._pendulum import swing_guess
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, float, float]) -> tuple[float, float]:
    """Give theta'' = -damping theta' - (gravity / length) theta."""
    theta, omega = state
    length, damping, gravity = params
    return omega, -damping * omega - gravity / length * theta


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take gravity / length and damping from theta'' regressed on theta and theta' in weak form."""
    return swing_guess(trajectory, np.asarray)


def energy(states: Array, params: Array) -> Array:
    """Energy per mass and length squared, (omega^2 + (gravity / length) theta^2) / 2, in 1/s^2.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    theta, omega = states.T
    return np.asarray((omega**2 + params[2] / params[0] * theta**2) / 2)


MODEL = OdeModel(
    name="linear-pendulum",
    summary="the pendulum for small angles: the length comes out too large by about theta_0^2 / 8, 8 % at 45 degrees",
    equation=r"\ddot\theta + \zeta\,\dot\theta + \frac{g}{L}\,\theta = 0",
    source="IRIS benchmark, table of equations; its error: Baker and Blackburn (2005), The Pendulum, eq. 3.21",
    states=(Quantity("theta", "rad", r"\theta"), Quantity("omega", "rad/s", r"\omega")),
    parameters=(
        Parameter("length", "m", "L", lower=1e-3, upper=200.0),
        Parameter("damping", "1/s", r"\zeta", lower=-2.0, upper=50.0, default=0.0, role="damping"),
        GRAVITY,
    ),
    observed=(Quantity("theta", "rad", r"\theta"),),
    rhs=rhs,
    guess=guess,
    first_integral=energy,
    dissipative=("damping",),
    typical="0.25 m swings in 1.0 s, 1 m in 2.0 s; an amplitude that halves in a minute has a damping of 0.023 1/s",
    example=ModelExample({"length": 0.6, "damping": 0.08, "theta_0": 0.2, "omega_0": 0.3}, samples=600, rate_hz=60.0),
)
