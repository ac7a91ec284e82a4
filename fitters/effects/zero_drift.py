"""The zero of a sensor moves slowly: it warms up, it slips. Of a camera, that is camera-drift."""

from __future__ import annotations

from fitters.effects._domain import CONTACT, on_a_line
from fitters.effects._times import first_time, start_parameter
from iris_sysid.types import Array, Effect, EffectExample, Parameter


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed + rate * (time - start).

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    return observed + params[0] * (t_s - params[1])[:, None]


EFFECT = Effect(
    name="zero-drift",
    summary="a sensor whose zero moves slowly",
    equation=r"x_\mathrm{seen} = x + u\,(t - t_0)",
    source="first-order expansion of a slow drift of a sensor",
    parameters=(Parameter("zero_drift", "{x}/s", "u", default=0.0), start_parameter("zero_drift_start")),
    component="zero-wander",
    absorbs=True,
    applies=on_a_line,
    plausibility=0.3,
    cause="measurement",
    sensors=CONTACT,
    observe=observe,
    trials=first_time,
    alike="initial velocity, where nothing pulls back",
    recurrence="anew",
    typical="gauges: 0.01 % to 0.1 % of full scale for each kelvin, in data sheets",
    example=EffectExample("exponential-decay", size=0.05),
)
