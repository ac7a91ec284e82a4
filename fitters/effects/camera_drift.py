"""The camera, or the zero of the scale, moves slowly."""

from __future__ import annotations

from fitters.effects._domain import on_a_line
from fitters.effects._times import first_time, start_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + rate * (time - start).

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    return observed + params[0] * (t_s - params[1])[:, None]


EFFECT = Effect(
    name="camera-drift",
    summary="a camera that moves slowly",
    equation=r"x_\mathrm{seen} = x + u\,(t - t_0)",
    source="first-order expansion of a slow movement of the camera",
    parameters=(Parameter("camera_drift", "{x}/s", "u", default=0.0), start_parameter("camera_start")),
    applies=on_a_line,
    cause="measurement",
    observe=observe,
    trials=first_time,
    alike="initial velocity, where nothing pulls back",
    example=EffectExample("pendulum", size=0.05),
)
