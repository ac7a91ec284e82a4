"""Free fall along a vertical line."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from fitters.models._gravity import GRAVITY, MAGNIFICATION
from fitters.models._reading import magnified
from fitters.starting_values import parabola, samples
from iris_sysid.types import Array, ModelExample, OdeModel, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, float]) -> tuple[float, float]:
    """Give z'' = -gravity, z upwards."""
    _, vz = state
    gravity, _ = params
    return vz, -gravity


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A parabola through all samples."""
    t_s, height = samples(trajectory, "z")
    start, velocity, acceleration = parabola(t_s, height)
    return {"gravity": -acceleration, "z_0": start, "vz_0": velocity}


def energy(states: Array, params: Array) -> Array:
    """Energy per mass, vz^2 / 2 + gravity z, in m^2/s^2.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    height, vz = states.T
    return np.asarray(vz**2 / 2 + params[0] * height)


MODEL = OdeModel(
    name="free-fall",
    summary="a body that falls along a vertical line without drag; gravity is estimated",
    equation=r"\ddot z = -g",
    source="Galilei (1638), Discorsi, third day; Halliday, Resnick and Walker, Fundamentals of Physics, section 2-5",
    states=(Quantity("z", "m", "z"), Quantity("vz", "m/s", "v_z")),
    # Negative values must be allowed: an estimate of no gravity scatters about zero.
    parameters=(replace(GRAVITY, lower=-1e6, constant=False), MAGNIFICATION),
    observed=(Quantity("z", "m", "z"),),
    rhs=rhs,
    guess=guess,
    observe=partial(magnified, 1, 1),
    first_integral=energy,
    typical="g on the ground: 9.76 to 9.83 m/s^2; on the Moon 1.62 m/s^2",
    example=ModelExample({"gravity": 9.79, "z_0": 1.5, "vz_0": -0.3}, samples=300, rate_hz=500.0),
)
