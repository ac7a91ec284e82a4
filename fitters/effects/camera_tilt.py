"""The camera does not look square at the plane of motion: one side is nearer, and larger."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import FILMED, lies_in_image
from iris_sysid.types import Array, Effect, EffectExample, Parameter, View

UNKNOWN_FOCAL = 0.2  # video modes crop: 24 to 35 mm equivalent, about the 26 mm of a phone's main camera
NEAREST = 0.05  # of the plane's distance on the axis: what comes nearer is no longer in front of the camera


def image(t_s: Array, points_px: Array, params: Array, view: View) -> Array:
    """Points of a plane that is turned by params[0] rad about the image's vertical through the optical axis.

    The plane of a motion along a line is turned about the line's normal instead. The focal length is params[1] times
    that of the view. ``t_s`` (n,) s; ``points_px`` (n, 2) px.
    """
    away, along = points_px - np.array(view.axis_px), view.along
    way = away @ along
    depth = np.maximum(1.0 - np.sin(params[0]) * way / (params[1] * view.focal_px), NEAREST)
    turned = away + np.outer((np.cos(params[0]) - 1.0) * way, along)
    return np.asarray(np.array(view.axis_px) + turned / depth[:, None])


EFFECT = Effect(
    name="camera-tilt",
    summary="a camera that does not look square at the motion",
    equation=r"(u, v)_\mathrm{seen} = (u \cos\alpha, v) / (1 - (u / f) \sin\alpha)",
    source="Hartley and Zisserman (2004), Multiple View Geometry, section 8.1.1: a plane in perspective",
    parameters=(
        Parameter("camera_tilt", "rad", r"\alpha", lower=-1.2, upper=1.2, default=0.0),
        Parameter(
            "focal_ratio",
            "1",
            "f / f_0",
            lower=0.1,
            upper=10.0,
            default=1.0,
            constant=True,
            stderr=UNKNOWN_FOCAL,
            source="the focal length over that of a phone's main camera, where none was calibrated",
        ),
    ),
    component="reading-of-position",
    absorbs=True,
    applies=lies_in_image,
    cause="measurement",
    plausibility=0.3,
    sensors=FILMED,
    image=image,
    alike="quadratic forces; zero-offset, for small swings",
    typical="held upright by eye: 1° to 5°, 0.02 to 0.09 rad",
    example=EffectExample("pendulum", size=0.05),
)
