"""The lens magnifies differently off its axis."""

from __future__ import annotations

from fitters.effects._domain import is_filmed
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed * (1 + k observed^2).

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    return observed * (1.0 + params[0] * observed**2)


EFFECT = Effect(
    name="radial-distortion",
    summary="a scale that changes away from the middle",
    equation=r"x_\mathrm{seen} = x\,(1 + k\,x^2)",
    source="Brown (1971), Photogrammetric Engineering 37, 855, first radial term",
    parameters=(Parameter("radial_distortion", "1/{x}^2", "k", default=0.0),),
    applies=is_filmed,
    cause="measurement",
    observe=observe,
    alike="cubic-stiffness",
    example=EffectExample("pendulum", size=0.05),
)
