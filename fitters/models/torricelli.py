"""A tank that drains through a hole."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._reading import shifted
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float], params: tuple[float, float]) -> tuple[float]:
    """Give h' = -outflow sqrt(h); an empty tank stays empty."""
    (level,) = state
    outflow, _ = params
    return (-outflow * np.sqrt(max(level, 0.0)),)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take the outflow from h' regressed on sqrt(h) in weak form."""
    t_s, level = samples(trajectory, "h")
    (slope,), half_width_s = weak_regression(t_s, level, np.sqrt(np.maximum(level, 0.0))[:, None], order=1)
    start = start_of(t_s, level, half_width_s, degree=2)
    if not np.isfinite(slope):
        slope = (level[-1] - level[0]) / (t_s[-1] - t_s[0]) / np.sqrt(max(level.mean(), 1e-12))
    return {"outflow": float(np.clip(-slope, 1e-6, 1e3)), "h_0": float(start[0])}


MODEL = OdeModel(
    name="torricelli",
    summary="a tank of constant cross-section that drains through a hole in its floor",
    equation=r"\dot h = -k\,\sqrt{h},\quad h \geq 0",
    source="Torricelli (1644), De motu gravium; k = (hole / surface) sqrt(2 g) without losses",
    states=(Quantity("h", "m", "h"),),
    parameters=(
        Parameter("outflow", "m^0.5/s", "k", lower=0.0, upper=1e4),
        Parameter(
            "hole",
            "m",
            "h_h",
            lower=-1e3,
            upper=1e3,
            default=0.0,
            constant=True,
            source="height of the hole: 0 where levels are measured from it",
        ),
    ),
    observed=(Quantity("h", "m", "h"),),
    rhs=rhs,
    guess=guess,
    observe=partial(shifted, 1, 1),
    typical="a hole of 5 mm in a cylinder of 100 mm: 0.0066 m^0.5/s",
    example=ModelExample({"outflow": 0.02, "h_0": 0.25}, samples=600, rate_hz=20.0),
)
