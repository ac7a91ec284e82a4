"""Rows of the image are exposed one after the other, so that the time depends on the row."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import FILMED, lies_in_image
from iris_sysid.types import Array, Effect, EffectExample, Parameter, View

ROUNDS = 3  # of the fixed point for the row at which the body is met; each gains a factor of 10 at 5 pictures/s


def image(t_s: Array, points_px: Array, params: Array, view: View) -> Array:
    """Points at the time at which their row is exposed: that of the optical axis is exposed at the stated time.

    The motion within the delay is followed to second order. ``t_s`` (n,) s; ``points_px`` (n, 2) px; ``params`` (k,).
    """
    if t_s.size < 3:
        return points_px
    velocity = np.gradient(points_px, t_s, axis=0, edge_order=2)
    acceleration = np.gradient(velocity, t_s, axis=0)
    seen = points_px
    for _ in range(ROUNDS):
        delay = (params[0] * (seen[:, 1] - view.axis_px[1]) / view.size_px[1])[:, None]
        seen = points_px + delay * (velocity + 0.5 * delay * acceleration)
    return seen


EFFECT = Effect(
    name="rolling-shutter",
    summary="a time of exposure that depends on the row of the image",
    equation=r"\mathbf{p}_\mathrm{seen}(t) = \mathbf{p}\left(t + \tau\,(v_\mathrm{seen} - v_0) / H\right)",
    source="Liang, Chang and Chen (2008), IEEE Trans. Image Process. 17, 1323",
    parameters=(Parameter("rolling_shutter", "s", r"\tau", lower=-0.2, upper=0.2, default=0.0),),
    component="reading-of-velocity",
    absorbs=True,
    applies=lies_in_image,
    cause="measurement",
    plausibility=0.1,
    sensors=FILMED,
    image=image,
    alike="quadratic forces, weakly",
    typical="phones: 0.008 to 0.035 s from the first row to the last",
    example=EffectExample("pendulum", size=0.05),
)
