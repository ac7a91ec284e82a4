"""Exponential decay, e.g. of the light of a lamp that was switched off."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._reading import shifted
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float], params: tuple[float, float]) -> tuple[float]:
    """Give I' = -decay_rate I, for the part of the intensity that decays."""
    (intensity,) = state
    decay_rate, _ = params
    return (-decay_rate * intensity,)


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take the decay rate and the background from I' regressed on I and a constant in weak form."""
    t_s, intensity = samples(trajectory, "intensity")
    terms = np.column_stack([intensity, np.ones_like(intensity)])
    (slope, supply), half_width_s = weak_regression(t_s, intensity, terms, order=1)
    rate = -float(slope) if np.isfinite(slope) else 1.0 / float(t_s[-1] - t_s[0])
    background = float(supply) / rate if rate > 0 and np.isfinite(supply) else 0.0
    start = start_of(t_s, intensity, half_width_s, degree=2)
    return {
        "decay_rate": float(np.clip(rate, -1e3, 1e5)),
        "background": background,
        "intensity_0": float(start[0]) - background,
    }


MODEL = OdeModel(
    name="exponential-decay",
    summary="a quantity that decays in proportion to itself, above a background",
    equation=r"\dot I = -\gamma\,I",
    source="Rutherford (1900), Phil. Mag. 49, 1, for the law; IRIS benchmark for the lamp",
    states=(Quantity("intensity", "1", "I"),),
    parameters=(
        Parameter("decay_rate", "1/s", r"\gamma", lower=-1e4, upper=1e6),
        Parameter("background", "1", "I_b", default=0.0, role="offset"),
    ),
    observed=(Quantity("intensity", "1", "I"),),
    rhs=rhs,
    guess=guess,
    observe=partial(shifted, 1, 1),
    typical="a capacitor of 100 µF through 10 kΩ: 1 1/s",
    example=ModelExample({"decay_rate": 0.9, "background": 0.1, "intensity_0": 1.0}, samples=600, rate_hz=200.0),
)
