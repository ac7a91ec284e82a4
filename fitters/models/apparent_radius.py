"""A ball that falls away from a camera above it, seen by its apparent radius."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitters.models._gravity import GRAVITY, STANDARD_GRAVITY
from fitters.starting_values import parabola, samples
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, float]) -> tuple[float, float]:
    """Give h'' = gravity for the distance h from the camera."""
    _, velocity = state
    _, gravity = params
    return velocity, gravity


def observe(t_s: Array, states: Array, params: Array) -> Array:
    """Give the apparent radius r0 f / h of a pinhole camera.

    ``t_s`` (n,), s; ``states`` (n, s) and what is observed (n, d) in the units that the model declares.
    """
    return params[0] / states[:, :1]


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Take 1 / r = h / (r0 f) for a parabola, whose curvature is gravity / (r0 f)."""
    t_s, radius_px = samples(trajectory, "r")
    start, slope, curvature = parabola(t_s, 1.0 / radius_px)
    scale = STANDARD_GRAVITY / curvature if curvature > 0 else 1.0 / start
    return {"r0_f": scale, "h_0": scale * start, "v_0": scale * slope, "gravity": STANDARD_GRAVITY}


def at_release(values: Mapping[str, float]) -> Mapping[str, float]:
    """Distance from the camera at which the ball was at rest, h_0 - v_0^2 / (2 gravity)."""
    return {"h0": values["h_0"] - values["v_0"] ** 2 / (2 * values["gravity"])}


def energy(states: Array, params: Array) -> Array:
    """Energy per mass, v^2 / 2 - gravity h, in m^2/s^2.

    ``states`` (n, s) in the model's units; one value for each sample (n,).
    """
    distance, velocity = states.T
    return np.asarray(velocity**2 / 2 - params[1] * distance)


MODEL = OdeModel(
    name="apparent-radius",
    summary="a ball that falls away from the camera: its radius in the image shrinks with the distance",
    equation=r"r = \frac{r_0 f}{h},\quad \ddot h = g",
    source="IRIS benchmark, table of equations (falling ball), with the speed at the first sample left free",
    states=(Quantity("h", "m", "h"), Quantity("v", "m/s", "v")),
    parameters=(Parameter("r0_f", "px m", "r_0 f", lower=1e-9, upper=1e9), GRAVITY),
    observed=(Quantity("r", "px", "r"),),
    rhs=rhs,
    guess=guess,
    observe=observe,
    derived=(Quantity("h0", "m", "h_0"),),
    derive=at_release,
    first_integral=energy,
    typical="a ball of 20 mm radius before a camera of 1000 px focal length: 20 px m",
    example=ModelExample({"r0_f": 60.0, "h_0": 0.8, "v_0": 0.3}, samples=400, rate_hz=600.0),
)
