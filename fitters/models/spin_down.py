"""A disc or a wheel that spins freely and runs down, by dry friction and by one in proportion to its speed."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.starting_values import line, samples
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory

STANDSTILL = 1e-3  # rad/s, about which dry friction turns over smoothly


def rhs(t: float, state: tuple[float], params: tuple[float, float]) -> tuple[float]:
    """Give omega' = -friction omega / |omega| - damping omega."""
    (omega,) = state
    friction, damping = params
    return (-friction * omega / np.sqrt(omega * omega + STANDSTILL * STANDSTILL) - damping * omega,)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """All of the mean deceleration is dry friction."""
    t_s, omega = samples(trajectory, "omega")
    start, slope = line(t_s, omega)
    return {"friction": abs(slope), "omega_0": start}


MODEL = OdeModel(
    name="spin-down",
    summary="a disc or a wheel that spins freely and runs down by friction",
    equation=r"\dot\omega = -a_f\,\mathrm{sgn}\,\omega - c\,\omega",
    source="Coulomb (1785), Theorie des machines simples; Stokes (1851), Trans. Camb. Phil. Soc. 9, 8",
    states=(Quantity("omega", "rad/s", r"\omega"),),
    parameters=(
        Parameter("friction", "rad/s^2", "a_f"),
        Parameter("damping", "1/s", "c", default=0.0, role="damping"),
    ),
    observed=(Quantity("omega", "rad/s", r"\omega"),),
    rhs=rhs,
    guess=guess,
    typical="a bicycle's wheel in the air: 0.1 rad/s^2; a spinner with ball bearings: 1 rad/s^2",
    example=ModelExample({"friction": 0.3, "damping": 0.05, "omega_0": 20.0}, samples=600, rate_hz=30.0),
)
