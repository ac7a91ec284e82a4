"""A tank that a pump fills and that drains through a hole."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._inputs import input_of, pump, slow_pump
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float], params: tuple[float, float], inputs: tuple[float]) -> tuple[float]:
    """Give h' = pump u - outflow sqrt(h); an empty tank gives nothing."""
    (level,) = state
    outflow, pump = params
    return (pump * inputs[0] - outflow * np.sqrt(max(level, 0.0)),)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Both by regression of the weak form."""
    t_s, level = samples(trajectory, "h")
    terms = np.column_stack([-np.sqrt(np.maximum(level, 0.0)), input_of(trajectory, t_s)])
    (outflow, filling), half_width_s = weak_regression(t_s, level, terms, order=1)
    return {"outflow": abs(outflow), "pump": filling, "h_0": float(start_of(t_s, level, half_width_s, degree=2)[0])}


MODEL = OdeModel(
    name="pumped-tank",
    summary="a tank of constant cross-section that a pump fills and that drains through a hole",
    equation=r"\dot h = k_u u - k\,\sqrt{h},\quad h \geq 0",
    source="Torricelli (1644), De motu gravium; Johansson (2000), IEEE Trans. Control Syst. Technol. 8, 456",
    states=(Quantity("h", "m", "h"),),
    parameters=(Parameter("outflow", "m^0.5/s", "k", lower=0.0), pump("m/s/V")),
    observed=(Quantity("h", "m", "h"),),
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "V", "u"),),
    typical="28 cm^2 with a hole of 0.07 cm^2: 0.011 m^0.5/s; a pump of 3.3 cm^3/s at 1 V: 0.0012 m/s/V",
    example=ModelExample({"outflow": 0.011, "pump": 0.0012, "h_0": 0.1}, 600, 2.0, inputs=slow_pump),
)
