"""A motor that turns a load through an elastic shaft; only the motor's angle is observed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._inputs import gain, multisine, pushed
from fitters.models._pendulum import PAIR_STATES
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(
    t: float, state: tuple[float, float, float, float], params: tuple[float, ...], inputs: tuple[float]
) -> tuple[float, float, float, float]:
    """Give J1 theta1'' = gain u - damping theta1' - shaft and J2 theta2'' = shaft, shaft = k twist + d twist'."""
    theta1, theta2, omega1, omega2 = state
    inertia1, inertia2, stiffness, loss, damping, gain = params
    shaft = stiffness * (theta1 - theta2) + loss * (omega1 - omega2)
    return omega1, omega2, (gain * inputs[0] - damping * omega1 - shaft) / inertia1, shaft / inertia2


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """The inertia of motor and load together, in halves, on a shaft that is neither stiff nor soft in the record."""
    inertia, damping, _, start = pushed(trajectory, "theta1", "omega1")
    step_s, whole_s = float(np.median(np.diff(trajectory.t_s))), float(np.ptp(trajectory.t_s))
    angular = np.sqrt(2 * np.pi / whole_s * np.pi / step_s)  # rad/s, the middle of what the record can show
    half = inertia / 2
    load = {"theta2_0": start["theta1_0"], "omega2_0": start["omega1_0"]}
    shaft = {"stiffness": half / 2 * angular**2, "shaft_damping": 0.1 * half * angular}
    return {"motor_inertia": half, "load_inertia": half, "damping": damping, **shaft, **start, **load}


MODEL = OdeModel(
    name="two-mass-drive",
    summary="a motor that turns a load through an elastic shaft; the motor's angle is measured, the load is hidden",
    equation=r"J_1\ddot\theta_1 = k_u u - c\,\dot\theta_1 - \tau,\quad J_2\ddot\theta_2 = \tau,\quad "
    r"\tau = k(\theta_1 - \theta_2) + d(\dot\theta_1 - \dot\theta_2)",
    source="Newton and Hooke; Isermann and Muenchhof (2011), Identification of Dynamic Systems, section 22.2",
    states=PAIR_STATES,
    parameters=(
        Parameter("motor_inertia", "kg m^2", "J_1", lower=0.0),
        Parameter("load_inertia", "kg m^2", "J_2", lower=0.0),
        Parameter("stiffness", "N m", "k", lower=0.0),
        Parameter("shaft_damping", "N m s", "d", role="damping"),
        Parameter("damping", "N m s", "c", role="damping"),
        gain("N m"),
    ),
    observed=PAIR_STATES[:1],
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "N m", "u"),),
    typical="a laboratory drive of 0.05 and 0.1 kg m^2 on 4 N m per rad resonates at 1.7 Hz",
    example=ModelExample(
        {
            "motor_inertia": 0.05,
            "load_inertia": 0.1,
            "stiffness": 4.0,
            "shaft_damping": 0.02,
            "damping": 0.2,
            "theta1_0": 0.1,
            "theta2_0": 0.15,
            "omega1_0": 0.0,
            "omega2_0": 0.3,
        },
        samples=800,
        rate_hz=100.0,
        inputs=multisine,
    ),
)
