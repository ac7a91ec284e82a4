"""Across and along have not the same scale: pixels that are not square, a picture that was resized."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import FILMED, lies_in_image, on_a_line, swings
from iris_sysid.types import Array, Effect, EffectExample, OdeModel, Parameter, View


def applies(model: OdeModel) -> bool:
    """Where both directions matter: angles, and motion in a plane."""
    return lies_in_image(model) and (swings(model) or not on_a_line(model))


def image(t_s: Array, points_px: Array, params: Array, view: View) -> Array:
    """Points of a picture that is 1 + params[0] times as wide.

    ``t_s`` (n,) s; ``points_px`` (n, 2) px.
    """
    wider = np.array([1.0 + params[0], 1.0])
    return np.asarray(np.array(view.axis_px) + (points_px - np.array(view.axis_px)) * wider)


EFFECT = Effect(
    name="anisotropic-scale",
    summary="another scale across than along",
    equation=r"(u, v)_\mathrm{seen} = ((1 + e)\,u, v)",
    source="Hartley and Zisserman (2004), Multiple View Geometry, section 6.1: pixels that are not square",
    parameters=(Parameter("anisotropic_scale", "1", "e", lower=-0.9, default=0.0),),
    component="reading-of-position",
    absorbs=True,
    applies=applies,
    cause="measurement",
    plausibility=0.3,
    sensors=FILMED,
    image=image,
    alike="radial-distortion and cubic-stiffness, for swings; horizontal speed, for throws",
    typical=(
        "pixels of digital video that are not square: 12/11 (0.09) and 10/11 (-0.09); a clip stretched from 4:3 to "
        "16:9: 0.33"
    ),
    example=EffectExample("projectile", size=0.05),
)
