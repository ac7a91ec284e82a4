"""A motor with brushes under a known voltage, whose speed and current are measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._inputs import input_of, multisine
from fitters.starting_values import samples, weak_regression
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, ...], inputs: tuple[float]) -> tuple[float, float]:
    """Give J omega' = k i - damping omega and L i' = u - R i - k omega."""
    omega, current = state
    resistance, inductance, constant, inertia, damping = params
    torque = constant * current - damping * omega
    return torque / inertia, (inputs[0] - resistance * current - constant * omega) / inductance


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Both equations by regression of the weak form."""
    t_s, omega = samples(trajectory, "omega")
    _, current = samples(trajectory, "i")
    voltage = input_of(trajectory, t_s)
    (per_inertia, slowing), _ = weak_regression(t_s, omega, np.column_stack([current, -omega]), order=1)
    electric = np.column_stack([voltage, -current, -omega])
    (per_inductance, drop, induced), _ = weak_regression(t_s, current, electric, order=1)
    with np.errstate(all="ignore"):
        inductance = 1.0 / per_inductance
        constant = induced * inductance
        inertia = constant / per_inertia
    found = {"resistance": drop * inductance, "inductance": inductance, "motor_constant": constant}
    found |= {"inertia": inertia, "damping": slowing * inertia}
    return {**found, "omega_0": float(omega[0]), "i_0": float(current[0])}


MODEL = OdeModel(
    name="dc-motor",
    summary="a motor with brushes under a known voltage, whose speed and current are measured",
    equation=r"J\dot\omega = k i - c\,\omega,\quad L\,\dot i = u - R i - k\,\omega",
    source="Kirchhoff and Newton; Isermann and Muenchhof (2011), Identification of Dynamic Systems, section 20.1",
    states=(Quantity("omega", "rad/s", r"\omega"), Quantity("i", "A", "i")),
    parameters=(
        Parameter("resistance", "V/A", "R", lower=0.0),
        Parameter("inductance", "V s/A", "L", lower=0.0),
        Parameter("motor_constant", "V s", "k"),
        Parameter("inertia", "kg m^2", "J", lower=0.0),
        Parameter("damping", "N m s", "c", role="damping"),
    ),
    observed=(Quantity("omega", "rad/s", r"\omega"), Quantity("i", "A", "i")),
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "V", "u"),),
    typical="a motor of 100 W: 1 V/A, 1 mV s/A, 0.05 V s, 0.0001 kg m^2",
    example=ModelExample(
        {
            "resistance": 1.5,
            "inductance": 0.08,
            "motor_constant": 0.12,
            "inertia": 2e-3,
            "damping": 1e-3,
            "omega_0": 0.0,
            "i_0": 0.1,
        },
        samples=600,
        rate_hz=100.0,
        inputs=multisine,
    ),
)
