"""The zero of the scale is not where the motion has its centre: a tilted camera, a pivot a little off."""

from __future__ import annotations

from fitters.effects._domain import on_a_line
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + offset.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    return observed + params[0]


EFFECT = Effect(
    name="zero-offset",
    summary="a constant offset of what is observed",
    equation=r"x_\mathrm{seen} = x + x_0",
    source="a tilt of the camera about its axis by x_0, for an angle",
    parameters=(Parameter("zero_offset", "{x}", "x_0", default=0.0),),
    component="reading-of-position",
    applies=on_a_line,
    cause="measurement",
    observe=observe,
    alike="camera-tilt, constant-force",
    typical="a phone that leans by 1°: 0.017 rad; a ruler read to half a division: 0.5 mm",
    example=EffectExample("pendulum", size=0.05),
)
