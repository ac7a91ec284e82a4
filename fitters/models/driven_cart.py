"""A cart or a linear drive that a known force moves against friction in proportion to its speed."""

from __future__ import annotations

from collections.abc import Mapping

from fitters.models._inputs import gain, multisine, pushed
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(
    t: float, state: tuple[float, float], params: tuple[float, float, float], inputs: tuple[float]
) -> tuple[float, float]:
    """Give m s'' = gain u - damping s'."""
    _, velocity = state
    mass, damping, gain = params
    return velocity, (gain * inputs[0] - damping * velocity) / mass


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Mass and damping by regression of the weak form."""
    mass, damping, _, start = pushed(trajectory, "q", "v")
    return {"mass": mass, "damping": damping, **start}


MODEL = OdeModel(
    name="driven-cart",
    summary="a cart or a linear drive, moved by a known force against friction in proportion to its speed",
    equation=r"m\ddot q = k_u u - c\,\dot q",
    source="Newton; Janot, Gautier and Brunot (2019), the electro-mechanical positioning system, without dry friction",
    states=(Quantity("q", "m", "q"), Quantity("v", "m/s", "v")),
    parameters=(
        Parameter("mass", "kg", "m", lower=0.0),
        Parameter("damping", "N s/m", "c", role="damping"),
        gain("N"),
    ),
    observed=(Quantity("q", "m", "q"),),
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "N", "u"),),
    typical="a linear drive: 95 kg, 200 N s/m, a voltage times 35 N/V",
    example=ModelExample({"mass": 2.0, "damping": 1.5, "q_0": 0.1, "v_0": 0.2}, 400, 50.0, inputs=multisine),
)
