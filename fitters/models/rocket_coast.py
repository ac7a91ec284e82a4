"""A rocket that coasts upwards after its motor has burnt out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._gravity import GRAVITY, STANDARD_GRAVITY
from fitters.starting_values import parabola, samples
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, float, float]) -> tuple[float, float]:
    """Give z'' = -gravity - drag exp(-z / scale height) z' |z'|."""
    height, speed = state
    drag, scale_height, gravity = params
    return speed, -gravity - drag * np.exp(-height / scale_height) * speed * abs(speed)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """The drag is what a parabola's acceleration has beyond gravity."""
    t_s, height = samples(trajectory, "z")
    start, speed, acceleration = parabola(t_s, height)
    mean_square = float(np.mean((speed + acceleration * (t_s - t_s[0])) ** 2))
    drag = max(-acceleration - STANDARD_GRAVITY, 0.0) / max(mean_square, 1e-12)
    return {"drag": drag, "z_0": start, "vz_0": speed}


MODEL = OdeModel(
    name="rocket-coast",
    summary="a rocket that coasts upwards after burnout, slowed by gravity and by air that thins out with the height",
    equation=r"\ddot z = -g - c\,e^{-z/H}\,\dot z|\dot z|",
    source="Newton (1687), Principia, book 2; Barrowman (1967), NASA; ISO 2533 (1975), standard atmosphere",
    states=(Quantity("z", "m", "z"), Quantity("vz", "m/s", "v_z")),
    parameters=(
        Parameter("drag", "1/m", "c"),
        Parameter(
            "scale_height",
            "m",
            "H",
            lower=1.0,
            default=10_300.0,
            constant=True,
            source="of the density in the lowest 1 km of the standard atmosphere; the ground is at z = 0",
        ),
        GRAVITY,
    ),
    observed=(Quantity("z", "m", "z"),),
    rhs=rhs,
    guess=guess,
    typical="c = density times C_d area / 2 m: C_d 0.5, 100 mm and 15 kg give 0.00016 1/m, 40 mm and 0.5 kg 0.0008",
    example=ModelExample({"drag": 4e-4, "z_0": 250.0, "vz_0": 180.0}, samples=240, rate_hz=20.0),
)
