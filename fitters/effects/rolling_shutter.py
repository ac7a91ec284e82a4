"""Rows of the image are read one after the other, so that the time depends on the position."""

from __future__ import annotations

from fitters.effects._domain import is_filmed
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + velocity * delay * observed, to first order in the delay.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    return observed + velocity * params[0] * observed


EFFECT = Effect(
    name="rolling-shutter",
    summary="a time of exposure that depends on the position in the image",
    equation=r"x_\mathrm{seen} = x(t + \tau\,x)",
    source="Liang, Chang and Chen (2008), IEEE Trans. Image Process. 17, 1323",
    parameters=(Parameter("rolling_shutter", "s/{x}", r"\tau", default=0.0),),
    applies=is_filmed,
    cause="measurement",
    observe=observe,
    alike="quadratic forces, weakly",
    example=EffectExample("pendulum", size=0.05),
)
