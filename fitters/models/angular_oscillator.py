"""The damped linear oscillator of an angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from fitters.models._oscillator import linear_oscillator
from fitters.starting_values import samples, weak_regression
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory


def about_rest() -> OdeModel:
    """The oscillator whose angle is counted from its direction of rest."""
    return linear_oscillator(
        "angular-oscillator",
        "an arm that turns against a linear torque, damped in proportion to its speed: the rotating cone",
        Quantity("phi", "rad", r"\varphi"),
        Quantity("omega", "rad/s", r"\omega"),
    )


def observe(t_s: Array, states: Array, params: Array) -> Array:
    """Give phi as counted from another direction than that of rest.

    ``t_s`` (n,), s; ``states`` (n, s) and what is observed (n, d) in the units that the model declares.
    """
    return states[:, :1] + params[2]


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take the direction of rest from phi'' regressed on phi, 1 and phi' in weak form; the rest about it."""
    t_s, phi = samples(trajectory, "phi")
    (stiffness, torque, _), _ = weak_regression(t_s, phi, np.column_stack([-phi, np.ones_like(phi)]))
    determined = np.isfinite(stiffness) and stiffness > 0
    rest = float(np.clip(torque / stiffness, phi.min(), phi.max())) if determined else 0.0
    about = trajectory.with_(position=trajectory.position - rest, smoothed=None)
    return {**about_rest().guess(about), "rest": rest}


MODEL = replace(
    about_rest(),
    parameters=(
        *about_rest().parameters,
        Parameter(
            "rest",
            "rad",
            r"\varphi_r",
            lower=-1e4,
            upper=1e4,
            default=0.0,
            constant=True,
            source="angle at rest: 0 where angles are measured from there",
            role="offset",
        ),
    ),
    observe=observe,
    guess=guess,
    example=ModelExample({"stiffness": 0.1, "damping": 0.05, "phi_0": 6.3, "omega_0": 0.0}, samples=900, rate_hz=60.0),
)
