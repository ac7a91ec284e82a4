"""The bob swings sideways as well: its ellipse turns, and the camera sees less and less of the swing."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

from fitters.effects._domain import hangs_freely
from fitters.effects._times import own_rate_parameter, own_rates
from iris_sysid.types import Array, Effect, EffectExample, Parameter

PRECESSION = 3 / 8  # turn of the ellipse in a time, over frequency, length and width (angles) of the ellipse


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """The swing as seen along a fixed line: its length axis lies in the plane of the picture at the first sample.

    With e^2 = params[0] the ellipse turns by (3/8) omega e times the integral of x^2 + (v / omega)^2, the square of
    the amplitude, so that it turns the slower the more the swing is damped. ``observed`` and ``velocity`` (n, d):
    rad, rad/s; ``t_s`` (n,) s; ``params`` (k,). Below zero, which no ellipse is, the formulas are continued.
    """
    square, rate = params
    across = velocity / rate
    turn = PRECESSION * rate * cumulative_trapezoid(observed**2 + across**2, t_s, axis=0, initial=0)
    ratio = np.emath.sqrt(square)
    return np.asarray((observed * np.cos(ratio * turn) + across * ratio * np.sin(ratio * turn)).real)


def sensible(t_s: Array, params: Sequence[float]) -> bool:
    """Whether it is an ellipse. ``t_s`` (n,), s, is not used."""
    return params[0] > 0


EFFECT = Effect(
    name="elliptical-swing",
    summary="a swing that is an ellipse, which turns; e is its width over its length",
    equation=r"x_\mathrm{seen} = x \cos\Phi + e\,(\dot x / \omega) \sin\Phi,"
    r"\quad \dot\Phi = \frac{3}{8}\,\omega\,e\,A^2",
    source="Olsson (1978), Am. J. Phys. 46, 1118, and (1981), Am. J. Phys. 49, 531: the precessing spherical pendulum",
    parameters=(
        Parameter("elliptical_swing", "1", "e^2", lower=-0.5, upper=0.5, default=0.0),
        own_rate_parameter("swing_rate"),
    ),
    component="own-force-drift",
    absorbs=True,
    applies=hangs_freely,
    plausibility=0.2,
    sensors=frozenset({"camera", "gauge", "unknown"}),  # an axle with an encoder holds the plane
    observe=observe,
    alike="a damping that is not in proportion to the speed; parameter-drift",
    trials=own_rates,
    sensible=sensible,
    recurrence="anew",
    typical="e is the short half axis over the long one: 5 % give 0.0025, 20 % give 0.04",
    example=EffectExample("pendulum", size=0.05),
)
