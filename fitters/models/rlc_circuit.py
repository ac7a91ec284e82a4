"""Resistor, coil and capacitor in series under a known voltage."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._inputs import gain, multisine, pushed
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(
    t: float, state: tuple[float, float], params: tuple[float, float, float], inputs: tuple[float]
) -> tuple[float, float]:
    """Give y'' = resonance^2 (gain u - y) - decay y'."""
    voltage, slope = state
    resonance, decay, gain = params
    return slope, resonance * resonance * (gain * inputs[0] - voltage) - decay * slope


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Resonance and decay by regression of the weak form."""
    per_square, damping, stiffness, start = pushed(trajectory, "y", "dy", lambda y: y)
    square = abs(stiffness) / per_square or 1.0 / per_square
    return {"resonance": float(np.sqrt(square)), "decay": damping / per_square, **start}


MODEL = OdeModel(
    name="rlc-circuit",
    summary="resistor, coil and capacitor in series under a known voltage; that of the capacitor is measured",
    equation=r"\ddot y = \omega_0^2\,(k_u u - y) - \gamma\,\dot y,\quad \omega_0^2 = 1/LC,\ \gamma = R/L",
    source="Kirchhoff (1845), Ann. Phys. 64, 497; Thomson (1853), Phil. Mag. 5, 393",
    states=(Quantity("y", "V", "y"), Quantity("dy", "V/s", r"\dot y")),
    parameters=(
        Parameter("resonance", "rad/s", r"\omega_0", lower=0.0),
        Parameter("decay", "1/s", r"\gamma", role="damping"),
        gain("V"),
    ),
    observed=(Quantity("y", "V", "y"),),
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "V", "u"),),
    typical="10 mH and 1 uF: 10,000 rad/s; with 10 Ohm 1000 1/s. One of R, L and C that is known gives the others",
    example=ModelExample({"resonance": 8.0, "decay": 1.2, "y_0": 0.5, "dy_0": -1.0}, 500, 50.0, inputs=multisine),
)
