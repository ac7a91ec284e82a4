"""A vehicle that rolls out freely: its speed falls by rolling resistance and by the resistance of the air."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.starting_values import line, samples
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory

STANDSTILL = 1e-3  # m/s, about which the rolling resistance turns over smoothly


def rhs(t: float, state: tuple[float], params: tuple[float, float]) -> tuple[float]:
    """Give v' = -rolling v / |v| - air v |v|."""
    (speed,) = state
    rolling, air = params
    return (-rolling * speed / np.sqrt(speed * speed + STANDSTILL * STANDSTILL) - air * speed * abs(speed),)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """All of the mean deceleration is rolling resistance."""
    t_s, speed = samples(trajectory, "v")
    start, slope = line(t_s, speed)
    return {"rolling": abs(slope), "v_0": start}


MODEL = OdeModel(
    name="coast-down",
    summary="a vehicle that rolls out on level ground, slowed by rolling resistance and by the air",
    equation=r"\dot v = -a_r\,\mathrm{sgn}\,v - c\,v|v|",
    source="ISO 10521-1 (2006), road load by coast-down; White and Korst (1972), SAE 720099",
    states=(Quantity("v", "m/s", "v"),),
    parameters=(
        Parameter("rolling", "m/s^2", "a_r"),
        Parameter("air", "1/m", "c", default=0.0),
    ),
    observed=(Quantity("v", "m/s", "v"),),
    rhs=rhs,
    guess=guess,
    typical="a car: 0.1 m/s^2 and 0.0004 1/m; a bicycle: 0.05 m/s^2 and 0.003 1/m",
    example=ModelExample({"rolling": 0.1, "air": 2e-3, "v_0": 20.0}, samples=600, rate_hz=10.0),
)
