"""A body that slides down a board with dry friction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._gravity import GRAVITY, MAGNIFICATION
from fitters.models._reading import magnified
from fitters.starting_values import parabola, samples
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, float, float, float]) -> tuple[float, float]:
    """Give s'' = acceleration, s along the board, downhill."""
    _, velocity = state
    acceleration, _, _, _ = params
    return velocity, acceleration


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A parabola through all samples."""
    t_s, way = samples(trajectory, "s")
    start, velocity, acceleration = parabola(t_s, way)
    return {"acceleration": acceleration, "s_0": start, "v_0": velocity}


def friction(values: Mapping[str, float]) -> Mapping[str, float]:
    """Coefficient of friction tan(angle) - acceleration / (gravity cos(angle)); NaN when the angle is not known."""
    angle = values["angle"]
    return {"friction": math.tan(angle) - values["acceleration"] / (values["gravity"] * math.cos(angle))}


def energy(states: Array, params: Array) -> Array:
    """Kinetic energy less the work done, per mass: v^2 / 2 - acceleration s, in m^2/s^2.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    way, velocity = states.T
    return np.asarray(velocity**2 / 2 - params[0] * way)


MODEL = OdeModel(
    name="incline",
    summary="a body that slides along a board at constant acceleration, gravity against dry friction",
    equation=r"\ddot s = a = g\,(\sin\alpha - \mu\cos\alpha)",
    source="Coulomb (1785); Halliday, Resnick and Walker, Fundamentals of Physics, section 6-1",
    states=(Quantity("s", "m", "s"), Quantity("v", "m/s", "v")),
    parameters=(
        Parameter("acceleration", "m/s^2", "a"),
        GRAVITY,
        Parameter("angle", "rad", r"\alpha", constant=True, source="not known: friction needs it", role="inclination"),
        MAGNIFICATION,
    ),
    observed=(Quantity("s", "m", "s"),),
    rhs=rhs,
    guess=guess,
    observe=partial(magnified, 1, 3),
    derived=(Quantity("friction", "1", r"\mu"),),
    derive=friction,
    first_integral=energy,
    typical="30°, coefficient of friction 0.3: 2.4 m/s^2; without friction 4.9 m/s^2",
    example=ModelExample({"acceleration": 2.1, "s_0": 0.05, "v_0": 0.2}, samples=300, rate_hz=300.0),
)
