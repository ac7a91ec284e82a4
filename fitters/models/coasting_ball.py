"""A ball that rolls along a level floor and is slowed in proportion to its speed: one body of the chain, alone."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.starting_values import parabola, samples
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float]) -> tuple[float, float]:
    """Give s'' = -damping s'."""
    _, velocity = state
    (damping,) = params
    return velocity, -damping * velocity


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A parabola through all samples; its curvature over the speed halfway is the damping."""
    t_s, way = samples(trajectory, "s")
    start, velocity, acceleration = parabola(t_s, way)
    halfway = velocity + acceleration * float(t_s[-1] - t_s[0]) / 2
    damping = -acceleration / halfway if halfway else 0.0
    return {"damping": float(np.clip(damping, -1.0, 20.0)), "s_0": start, "v_0": velocity}


def observe(t_s: Array, states: Array, params: Array) -> Array:
    """The way. ``t_s`` (n,), s; ``states`` (n, s) and what is observed (n, d) in the units that the model declares."""
    return states[:, :1]


def reach(states: Array, params: Array) -> Array:
    """Speed plus damping times way, in m/s: the same throughout, v + damping s.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    way, velocity = states.T
    return np.asarray(velocity + params[0] * way)


MODEL = OdeModel(
    name="coasting-ball",
    summary="a ball that rolls along a level floor, slowed in proportion to its speed, and touches nothing",
    equation=r"\ddot s + \zeta\,\dot s = 0",
    source="IRIS benchmark, table of equations (hitting cones), a body that touches no other",
    states=(Quantity("s", "m", "s"), Quantity("v", "m/s", "v")),
    # A damping of zero must not be a bound: estimates scatter about it, and so must their intervals.
    parameters=(Parameter("damping", "1/s", r"\zeta", lower=-2.0, upper=50.0, default=0.0, role="damping"),),
    observed=(Quantity("s", "m", "s"),),
    rhs=rhs,
    guess=guess,
    observe=observe,
    first_integral=reach,
    typical="a ball that loses half of its speed in 5 s: 0.14 1/s",
    example=ModelExample({"damping": 0.4, "s_0": 0.1, "v_0": 1.7}, samples=300, rate_hz=240.0),
)
