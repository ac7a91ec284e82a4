"""A ship that rolls freely in calm water."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, float, float, float]) -> tuple[float, float]:
    """Give phi'' = -rate^2 (phi - heel) - damping phi' - eddies phi' |phi'|."""
    roll, speed = state
    rate, damping, eddies, heel = params
    return speed, -rate * rate * (roll - heel) - damping * speed - eddies * speed * abs(speed)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """All but the eddies by regression of the weak form."""
    t_s, roll = samples(trajectory, "phi")
    (square, push, slowing), half_width_s = weak_regression(t_s, roll, np.column_stack([-roll, np.ones_like(roll)]))
    start = start_of(t_s, roll, half_width_s)
    found = {"roll_rate": float(np.sqrt(abs(square))), "damping": float(-slowing), "heel": float(push / square)}
    return {**found, "phi_0": float(start[0]), "p_0": float(start[1])}


MODEL = OdeModel(
    name="ship-roll",
    summary="a ship that rolls freely in calm water, damped by waves and by eddies",
    equation=r"\ddot\varphi = -\omega_0^2(\varphi - \varphi_h) - a\,\dot\varphi - b\,\dot\varphi|\dot\varphi|",
    source="Froude (1861), Trans. Inst. Naval Architects 2, 180; ITTC 7.5-02-07-04.5 (2021), roll damping",
    states=(Quantity("phi", "rad", r"\varphi"), Quantity("p", "rad/s", "p")),
    parameters=(
        Parameter("roll_rate", "rad/s", r"\omega_0", lower=0.0),
        Parameter("damping", "1/s", "a", role="damping"),
        Parameter("eddies", "1/rad", "b", default=0.0),
        Parameter("heel", "rad", r"\varphi_h", default=0.0, role="offset"),
    ),
    observed=(Quantity("phi", "rad", r"\varphi"),),
    rhs=rhs,
    guess=guess,
    typical="a ferry: 15 s, which is 0.4 rad/s; damping 0.02 1/s, 0.1 1/s with bilge keels; eddies 0.1 to 0.5 1/rad",
    example=ModelExample(
        {"roll_rate": 0.5, "damping": 0.02, "eddies": 0.3, "heel": 0.01, "phi_0": 0.3, "p_0": 0.02}, 700, 5.0
    ),
)
