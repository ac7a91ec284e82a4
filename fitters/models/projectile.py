"""Free fall in a vertical plane."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._gravity import GRAVITY, MAGNIFICATION
from fitters.models._reading import PLANE, PLANE_STATES, magnified
from fitters.starting_values import line, parabola, samples
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(
    t: float, state: tuple[float, float, float, float], params: tuple[float, ...]
) -> tuple[float, float, float, float]:
    """Give x'' = 0, z'' = -gravity; x to the right, z upwards."""
    _, _, vx, vz = state
    gravity, _, _ = params
    return vx, vz, 0.0, -gravity


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A line through x and a parabola through z."""
    t_s, x = samples(trajectory, "x")
    _, z = samples(trajectory, "z")
    x_start, vx = line(t_s, x)
    z_start, vz, acceleration = parabola(t_s, z)
    return {"gravity": -acceleration, "x_0": x_start, "z_0": z_start, "vx_0": vx, "vz_0": vz}


def launch(values: Mapping[str, float]) -> Mapping[str, float]:
    """Speed, and elevation above the horizontal (to either side), where the throw began.

    That is at the first sample used, or at the height ``launch_z`` where that is known: the flight is followed
    back to it, vz^2 = vz_0^2 + 2 g (z_0 - launch_z).
    """
    vx, vz, height = values["vx_0"], values["vz_0"], values["launch_z"]
    if not math.isnan(height):
        square = vz**2 + 2 * values["gravity"] * (values["z_0"] - height / values["magnification"])
        vz = math.copysign(math.sqrt(square), vz) if square >= 0 else math.nan
    return {"launch_speed": math.hypot(vx, vz), "launch_angle": math.atan2(vz, abs(vx))}


def energy(states: Array, params: Array) -> Array:
    """Energy per mass, (vx^2 + vz^2) / 2 + gravity z, in m^2/s^2.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    _, height, vx, vz = states.T
    return np.asarray((vx**2 + vz**2) / 2 + params[0] * height)


MODEL = OdeModel(
    name="projectile",
    summary="a thrown body without drag, in the plane, with the speed and angle of its launch",
    equation=r"\ddot x = 0,\quad \ddot z = -g",
    source="Galilei (1638), Discorsi, fourth day; Halliday, Resnick and Walker, Fundamentals of Physics, section 4-4",
    states=PLANE_STATES,
    parameters=(
        GRAVITY,
        MAGNIFICATION,
        Parameter("launch_z", "m", "z_l", constant=True, source="not known: the launch is the first sample used"),
    ),
    observed=PLANE,
    rhs=rhs,
    guess=guess,
    observe=partial(magnified, 2, 1),
    derived=(Quantity("launch_speed", "m/s", "v_0"), Quantity("launch_angle", "rad", r"\varphi_0")),
    derive=launch,
    first_integral=energy,
    typical="a ball tossed by hand leaves at 2 to 8 m/s; 5 m/s at 45° reach 2.5 m",
    example=ModelExample({"x_0": 0.1, "z_0": 0.2, "vx_0": 1.8, "vz_0": 2.5}, samples=300, rate_hz=400.0),
)
