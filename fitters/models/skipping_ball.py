"""A thrown ball that skips along a floor: restitution, and friction that slows it and sets it spinning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._gravity import GRAVITY, MAGNIFICATION
from fitters.models._impacts import bounces
from fitters.models._reading import PLANE, PLANE_STATES, magnified
from fitters.starting_values import line, samples
from iris_sysid.types import Event, ModelExample, OdeModel, Parameter, Quantity, Trajectory

SETTLING_S = 1e-4  # of fall make a rebound so slow that the ball stays on the floor: it would rise by 50 nm

Six = tuple[float, float, float, float, float, float]


def rhs(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, ...]:
    """Give x'' = 0, z'' = -gravity in the air, z upwards; on the floor the ball rolls on evenly."""
    _, _, vx, vz, _, on_floor = state
    if on_floor == 1.0:
        return vx, 0.0, 0.0, 0.0, 0.0
    return vx, vz, 0.0, -params[4], 0.0


def height(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Height of the centre above where it is when the ball touches the floor."""
    return 1.0 if state[5] == 1.0 else state[1] - params[2]


def bounce(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> Six:
    """Newton's restitution upwards; along the floor Coulomb's friction, or as much as stops the slip if that is less.

    The last of many bounces leaves the ball rolling.
    """
    x, z, vx, vz, rim, _ = state
    restitution, friction, _, inertia = params[0], params[1], params[2], params[3]
    if vz > 0.0:  # it starts below the floor and rises
        return x, z, vx, vz, rim, 0.0
    slip = vx - rim
    grip = abs(slip) * inertia / (1.0 + inertia)
    settles = -restitution * vz < SETTLING_S * params[4]
    loss = grip if settles else min(friction * (1.0 + restitution) * -vz, grip)
    along = -math.copysign(loss, slip)
    return x, z, vx + along, 0.0 if settles else -restitution * vz, rim - along / inertia, 1.0 if settles else 0.0


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """As of a ball that bounces; the speed that the first bounce costs along the floor gives the friction.

    The ball is taken not to spin at first.
    """
    (t_s, x), (_, z) = samples(trajectory, "x"), samples(trajectory, "z")
    values, flights = bounces(t_s, z)
    along = [line(t_s[flight], x[flight]) for flight in flights[:2]]
    values |= {"x_0": along[0][0], "vx_0": along[0][1], "rim_0": 0.0}
    lost = abs(along[0][1] - along[-1][1])
    landing = math.sqrt(2 * values["gravity"] * max(float(np.max(z[flights[0]])) - values["floor"], 1e-12))
    if lost > 0:
        values["friction"] = float(np.clip(lost / ((1 + values["restitution"]) * landing), 0.01, 2.0))
    return values


MODEL = OdeModel(
    name="skipping-ball",
    summary="a thrown ball that bounces along a floor, whose friction slows it and sets it spinning",
    equation=(
        r"\ddot x = 0,\ \ddot z = -g,\quad \dot z^+ = -e\,\dot z^-,\ "
        r"|\Delta\dot x| = \min\left(\mu (1 + e)|\dot z^-|,\ \tfrac{\alpha}{1 + \alpha}|\dot x - R\omega|\right)"
        r"\text{ where } z = z_f"
    ),
    source="Garwin (1969), Am. J. Phys. 37, 88; Cross (2002), Am. J. Phys. 70, 1093",
    states=(*PLANE_STATES, Quantity("rim", "m/s", r"R\omega")),
    parameters=(
        Parameter("restitution", "1", "e", lower=0.0, upper=1.5, default=0.8),
        Parameter("friction", "1", r"\mu", lower=0.0, upper=10.0, default=0.1),
        Parameter("floor", "m", "z_f", default=0.0),
        Parameter(
            "inertia", "1", r"\alpha", lower=0.01, upper=1.0, default=0.4, constant=True,
            source="moment of inertia over m R^2 of a solid ball; 2/3 of a hollow one",
        ),
        GRAVITY,
        MAGNIFICATION,
    ),
    observed=PLANE,
    rhs=rhs,
    guess=guess,
    observe=partial(magnified, 2, 5),
    events=(Event("impact", height, bounce),),
    typical="restitution: 0.5 to 0.9; friction: 0.1 to 0.5; inertia: 0.4 of a solid ball, 0.67 of a hollow one",
    example=ModelExample(
        {
            "restitution": 0.8, "friction": 0.08, "floor": 0.03, "x_0": 0.1, "z_0": 1.0, "vx_0": 3.0,
            "vz_0": -0.2, "rim_0": 0.0,
        },
        samples=300,
        rate_hz=100.0,
    ),
)  # fmt: skip
