"""The damped pendulum at any amplitude."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fitters.models._gravity import GRAVITY
from fitters.models._pendulum import swing_guess
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory

# A ball's moment of inertia about its centre over m r^2: 2/5 solid to 2/3 hollow; the middle is right to 0.13.
ROUNDNESS = 8 / 15


def rhs(t: float, state: tuple[float, float], params: tuple[float, ...]) -> tuple[float, float]:
    """Give theta'' = -damping theta' - (gravity / length) sin theta."""
    theta, omega = state
    length, damping, gravity, _, _, _, _ = params
    return omega, -damping * omega - gravity / length * np.sin(theta)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take gravity / length and damping from theta'' regressed on sin theta and theta' in weak form."""
    return swing_guess(trajectory, np.sin)


def energy(states: Array, params: Array) -> Array:
    """Energy per mass and length squared, omega^2 / 2 + (gravity / length)(1 - cos theta), in 1/s^2.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    theta, omega = states.T
    length, gravity = params[0], params[2]
    return np.asarray(omega**2 / 2 + gravity / length * (1.0 - np.cos(theta)))


def observe(t_s: Array, states: Array, params: Array) -> Array:
    """Give theta as seen from what is taken for the pivot, and from what is taken for the vertical.

    ``t_s`` (n,), s; ``states`` (n, s) and what is observed (n, d) in the units that the model declares.
    """
    theta = states[:, :1]
    vertical, across, along = params[4:7]
    if across == 0 and along == 0:  # as in most fits: saves a sine and a cosine of each sample
        return theta + vertical
    return theta + vertical - across * np.cos(theta) - along * np.sin(theta)


def rope(values: Mapping[str, float]) -> Mapping[str, float]:
    """Length of the cord up to a ball of known radius r; NaN where the radius is not known.

    A ball that turns with its cord has the length L = l + k r^2 / l of a point bob, where l is cord + r and
    k m r^2 its moment of inertia, so l = (L + sqrt(L^2 - 4 k r^2)) / 2.
    """
    length, radius = values["length"], values["ball_radius"]
    root = math.sqrt(max(length**2 - 4 * ROUNDNESS * radius**2, 0.0))
    return {"rope_length": (length + root) / 2 - radius}


def _off_pivot(name: str, symbol: str, direction: str) -> Parameter:
    return Parameter(
        name, "1", symbol, lower=-0.3, upper=0.3, default=0.0, constant=True,
        source=f"how far {direction} the true pivot is from the one taken, over the arc's radius",
    )  # fmt: skip


MODEL = OdeModel(
    name="pendulum",
    summary="a bob on a cord, damped in proportion to its speed, exact for large angles",
    equation=r"\ddot\theta + \zeta\,\dot\theta + \frac{g}{L}\,\sin\theta = 0",
    source="Baker and Blackburn (2005), The Pendulum, section 3.3; linear damping after Stokes",
    states=(Quantity("theta", "rad", r"\theta"), Quantity("omega", "rad/s", r"\omega")),
    parameters=(
        Parameter("length", "m", "L", lower=1e-3, upper=200.0),
        # A damping of zero must not be a bound: estimates scatter about it, and so must their intervals.
        Parameter("damping", "1/s", r"\zeta", lower=-2.0, upper=50.0, default=0.0, role="damping"),
        GRAVITY,
        Parameter("ball_radius", "m", "r", constant=True, source="not known: the cord's length needs it"),
        # What a camera leaves open: an angle from a table is measured from the true vertical about the true pivot.
        Parameter(
            "vertical",
            "rad",
            r"\theta_v",
            lower=-0.7,
            upper=0.7,
            default=0.0,
            constant=True,
            source="angle at rest: 0 where angles are measured from the true vertical",
            role="vertical",
        ),
        _off_pivot("pivot_across", "p_x", "sideways"),
        _off_pivot("pivot_along", "p_z", "upwards"),
    ),
    observed=(Quantity("theta", "rad", r"\theta"),),
    rhs=rhs,
    guess=guess,
    observe=observe,
    derived=(Quantity("rope_length", "m", "l"),),
    derive=rope,
    first_integral=energy,
    dissipative=("damping",),
    typical="0.25 m swings in 1.0 s, 1 m in 2.0 s; an amplitude that halves in a minute has a damping of 0.023 1/s",
    example=ModelExample({"length": 0.6, "damping": 0.08, "theta_0": 1.2, "omega_0": 0.3}, samples=600, rate_hz=60.0),
)
