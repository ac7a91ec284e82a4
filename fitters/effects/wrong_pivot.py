"""The angle was computed about a point that is not the pivot: it is off by an amount that depends on the angle."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import swings
from iris_sysid.types import Array, Effect, EffectExample, Parameter

FARTHEST = 0.3  # of the lever; a point that is farther off is taken for no pivot
DIRECTIONS = (0.0, 0.25 * np.pi, 0.5 * np.pi, 0.75 * np.pi)  # across, and along the cord at rest


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """The angle about a point that lies the distance params[0], in levers, from the pivot, in the direction params[1].

    Direction 0 is to the side of positive angles, pi / 2 is up, against the cord at rest. ``t_s`` (n,) s; ``observed``
    and ``velocity`` (n, d): rad, rad/s; ``params`` (k,).
    """
    distance, direction = params
    across, up = distance * np.cos(direction), distance * np.sin(direction)
    sin, cos = np.sin(observed), np.cos(observed)
    outward = 1.0 - across * sin + up * cos  # components of the lever about that point along the cord and across it
    sideways = -across * cos - up * sin
    return np.asarray(observed + np.arctan2(sideways, outward))


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Directions, rad. ``t_s`` (n,), s, and ``observed`` (n, d), rad, are not used."""
    return [(direction,) for direction in DIRECTIONS]


EFFECT = Effect(
    name="wrong-pivot",
    summary="an angle that was read about a point beside the pivot",
    equation=r"\tan\theta_\mathrm{seen} = \frac{\sin\theta - d \cos\psi}{\cos\theta + d \sin\psi}",
    source="plane geometry; to first order a cosine and a sine of the angle, as of a dial that is off its centre",
    parameters=(
        Parameter("wrong_pivot", "1", "d", lower=-FARTHEST, upper=FARTHEST, default=0.0),
        Parameter("pivot_direction", "rad", r"\psi", default=0.0),
    ),
    component="reading-of-position",
    applies=swings,
    cause="measurement",
    plausibility=0.2,
    sensors=frozenset({"camera", "unknown", "encoder"}),  # of an encoder, a disc that is off its axis
    measured=frozenset({"pivot_across", "pivot_along"}),  # a circle through the arc of a film
    observe=observe,
    alike="camera-tilt; zero-offset, for small swings; the pivot of the model, where that is estimated",
    trials=trials,
    typical="a pivot marked 5 mm off, on a pendulum of 0.5 m: 0.01",
    example=EffectExample("pendulum", size=0.05),
)
