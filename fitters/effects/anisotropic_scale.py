"""Across and along have not the same scale: pixels that are not square, a camera that looks from one side."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import swings
from iris_sysid.types import Array, Effect, EffectExample, OdeModel, Parameter


def applies(model: OdeModel) -> bool:
    """Where both directions matter: angles, and motion in a plane."""
    in_plane = [quantity.name for quantity in model.observed] == ["x", "z"]
    return swings(model) or in_plane


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """What is across, times 1 + e.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    wider = 1.0 + params[0]
    if observed.shape[1] == 1:  # an angle from the vertical
        turns = np.round(observed / (2 * np.pi)) * 2 * np.pi
        return np.asarray(np.arctan2(wider * np.sin(observed), np.cos(observed)) + turns)
    return observed * np.array([wider, 1.0])


EFFECT = Effect(
    name="anisotropic-scale",
    summary="another scale across than along",
    equation=r"x_\mathrm{seen} = (1 + e)\,x",
    source="Hartley and Zisserman (2004), Multiple View Geometry, section 6.1: pixels that are not square",
    parameters=(Parameter("anisotropic_scale", "1", "e", lower=-0.9, default=0.0),),
    applies=applies,
    cause="measurement",
    observe=observe,
    alike="radial-distortion and cubic-stiffness, for swings; horizontal speed, for throws",
    example=EffectExample("projectile", size=0.05),
)
