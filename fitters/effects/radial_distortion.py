"""The lens magnifies differently off its axis."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import FILMED, lies_in_image
from iris_sysid.types import Array, Effect, EffectExample, Parameter, View


def image(t_s: Array, points_px: Array, params: Array, view: View) -> Array:
    """Points whose distance from the optical axis is r (1 + k r^2), r in focal lengths.

    ``t_s`` (n,) s; ``points_px`` (n, 2) px; ``params`` (k,).
    """
    away = points_px - np.array(view.axis_px)
    square = np.sum(away**2, axis=1, keepdims=True) / view.focal_px**2
    return np.asarray(np.array(view.axis_px) + away * (1.0 + params[0] * square))


EFFECT = Effect(
    name="radial-distortion",
    summary="a scale that changes away from the optical axis",
    equation=r"\mathbf{p}_\mathrm{seen} = \mathbf{p}\,(1 + k\,|\mathbf{p}|^2 / f^2)",
    source="Brown (1971), Photogrammetric Engineering 37, 855, first radial term",
    parameters=(Parameter("radial_distortion", "1", "k", default=0.0),),
    component="reading-of-position",
    absorbs=True,
    applies=lies_in_image,
    cause="measurement",
    plausibility=0.1,
    sensors=FILMED,
    image=image,
    alike="cubic-stiffness",
    typical="k1 of OpenCV: phones 0.05 or less, action cameras -0.2 to -0.4",
    example=EffectExample("pendulum", size=0.05),
)
