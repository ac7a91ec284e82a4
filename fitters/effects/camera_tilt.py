"""The camera does not look square at the plane of motion: one side is nearer, and larger."""

from __future__ import annotations

from fitters.effects._domain import is_filmed
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed / (1 + k observed).

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    return observed / (1.0 + params[0] * observed)


EFFECT = Effect(
    name="camera-tilt",
    summary="a camera that does not look square at the motion",
    equation=r"x_\mathrm{seen} = x / (1 + k\,x)",
    source="Hartley and Zisserman (2004), Multiple View Geometry, section 2.4: projective map of a line",
    parameters=(Parameter("camera_tilt", "1/{x}", "k", default=0.0),),
    applies=is_filmed,
    cause="measurement",
    observe=observe,
    alike="quadratic forces; zero-offset, for small swings",
    example=EffectExample("pendulum", size=0.05),
)
