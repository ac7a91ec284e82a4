"""A mass on a spring with a damper, pushed by a known force: the plant of many a course on control."""

from __future__ import annotations

from collections.abc import Mapping

from fitters.models._inputs import gain, multisine, pushed
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(
    t: float, state: tuple[float, float], params: tuple[float, float, float, float], inputs: tuple[float]
) -> tuple[float, float]:
    """Give m z'' = gain u - damping z' - stiffness z."""
    position, velocity = state
    mass, damping, stiffness, gain = params
    return velocity, (gain * inputs[0] - damping * velocity - stiffness * position) / mass


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Mass, damping and stiffness by regression of the weak form."""
    mass, damping, stiffness, start = pushed(trajectory, "z", "vz", lambda z: z)
    return {"mass": mass, "damping": damping, "stiffness": stiffness, **start}


MODEL = OdeModel(
    name="driven-oscillator",
    summary="a mass on a spring with a damper, pushed by a known force",
    equation=r"m\ddot z = k_u u - c\,\dot z - k z",
    source="Newton; Hooke (1678); Ljung (1999), System Identification, section 4.3",
    states=(Quantity("z", "m", "z"), Quantity("vz", "m/s", "v_z")),
    # A damping of zero is not a bound: estimates scatter about it, and so must their intervals.
    parameters=(
        Parameter("mass", "kg", "m", lower=0.0),
        Parameter("damping", "N s/m", "c", role="damping"),
        Parameter("stiffness", "N/m", "k"),
        gain("N"),
    ),
    observed=(Quantity("z", "m", "z"),),
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "N", "u"),),
    typical="a trolley of 0.5 kg on a spring of 20 N/m swings in 1 s",
    example=ModelExample(
        {"mass": 0.5, "damping": 0.4, "stiffness": 20.0, "z_0": 0.1, "vz_0": -0.3},
        samples=400,
        rate_hz=50.0,
        inputs=multisine,
    ),
)
