"""A capacitor that a known voltage charges through a resistor."""

from __future__ import annotations

from fitters.models._inputs import gain, multisine
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity


def rhs(t: float, state: tuple[float], params: tuple[float, float], inputs: tuple[float]) -> tuple[float]:
    """Give tau y' = gain u - y."""
    (voltage,) = state
    time_constant, gain = params
    return ((gain * inputs[0] - voltage) / time_constant,)


MODEL = OdeModel(
    name="rc-circuit",
    summary="a capacitor that a known voltage charges through a resistor; any lag of first order",
    equation=r"\tau\,\dot y = k_u u - y",
    source="Kirchhoff (1845), Ann. Phys. 64, 497",
    states=(Quantity("y", "V", "y"),),
    parameters=(Parameter("time_constant", "s", r"\tau", lower=0.0), gain("V")),
    observed=(Quantity("y", "V", "y"),),
    rhs=rhs,
    inputs=(Quantity("u", "V", "u"),),
    typical="10 kOhm and 10 uF: 0.1 s",
    example=ModelExample({"time_constant": 0.4, "y_0": 0.2}, samples=400, rate_hz=50.0, inputs=multisine),
)
