"""An arm that a known torque turns against gravity: a pendulum with a motor."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._gravity import GRAVITY, STANDARD_GRAVITY
from fitters.models._inputs import gain, multisine, pushed
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(
    t: float, state: tuple[float, float], params: tuple[float, float, float, float, float], inputs: tuple[float]
) -> tuple[float, float]:
    """Give J theta'' = gain u - moment gravity sin(theta) - damping theta'."""
    theta, omega = state
    inertia, moment, damping, gain, gravity = params
    return omega, (gain * inputs[0] - moment * gravity * np.sin(theta) - damping * omega) / inertia


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Inertia, moment and damping by regression of the weak form, under standard gravity."""
    inertia, damping, weight, start = pushed(trajectory, "theta", "omega", np.sin)
    return {"inertia": inertia, "moment": weight / STANDARD_GRAVITY, "damping": damping, **start}


MODEL = OdeModel(
    name="driven-pendulum",
    summary="an arm that a known torque turns against gravity, damped in proportion to its speed",
    equation=r"J\ddot\theta = k_u u - m c\,g\sin\theta - d\,\dot\theta",
    source="Newton and Euler; Wiebe et al. (2022), J. Open Source Software 7, 3884, the torque-limited pendulum",
    states=(Quantity("theta", "rad", r"\theta"), Quantity("omega", "rad/s", r"\omega")),
    parameters=(
        Parameter("inertia", "kg m^2", "J", lower=0.0),
        Parameter("moment", "kg m", "mc"),
        Parameter("damping", "N m s", "d", role="damping"),
        gain("N m"),
        GRAVITY,
    ),
    observed=(Quantity("theta", "rad", r"\theta"),),
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "N m", "u"),),
    typical="a quasi-direct drive with 0.5 kg at 0.5 m: 0.06 kg m^2, 0.1 kg m times gravity, 0.05 N m s",
    example=ModelExample(
        {"inertia": 0.06, "moment": 0.5, "damping": 0.05, "theta_0": 0.3, "omega_0": -0.5},
        samples=400,
        rate_hz=50.0,
        inputs=multisine,
    ),
)
