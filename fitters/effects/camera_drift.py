"""The camera turns or moves slowly, and the picture with it."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import FILMED, lies_in_image, on_a_line
from fitters.effects._times import first_time, start_parameter
from iris_sysid.types import Array, Effect, EffectExample, OdeModel, Parameter, View


def applies(model: OdeModel) -> bool:
    """Where one place is observed: in a plane, a drift is a velocity."""
    return on_a_line(model) and lies_in_image(model)


def image(t_s: Array, points_px: Array, params: Array, view: View) -> Array:
    """Points that move evenly: along a line, or to the right by params[0] levers a second about a pivot.

    Where nothing is known of the image of a pivot, it is the angle's zero that moves. ``t_s`` (n,) s; ``points_px``
    (n, 2) px.
    """
    way = params[0] * (t_s - params[1])
    if view.kind == "angle" and not view.measured:
        (x, y), cos, sin = (points_px - np.array(view.origin_px)).T, np.cos(way), np.sin(way)
        return np.array(view.origin_px) + np.column_stack([x * cos + y * sin, y * cos - x * sin])
    return np.asarray(points_px + np.outer(way, view.right_px))


EFFECT = Effect(
    name="camera-drift",
    summary="a camera that moves slowly",
    equation=r"\mathbf{p}_\mathrm{seen} = \mathbf{p} + \mathbf{u}\,(t - t_0)",
    source="first-order expansion of a slow movement of the camera",
    parameters=(Parameter("camera_drift", "{x}/s", "u", default=0.0), start_parameter("camera_start")),
    component="zero-wander",
    absorbs=True,
    applies=applies,
    cause="measurement",
    plausibility=0.3,
    sensors=FILMED,
    image=image,
    trials=first_time,
    alike="initial velocity, where nothing pulls back",
    recurrence="anew",
    typical="a tripod that sinks by a pixel in 10 s, at 1 mm a pixel: 0.0001 m/s",
    example=EffectExample("pendulum", size=0.05),
)
