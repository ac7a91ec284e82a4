"""A reading comes late: a long exposure, a slow sensor, a filter."""

from __future__ import annotations

import numpy as np

from fitters.effects._domain import several_bodies
from iris_sysid.types import Array, Effect, EffectExample, OdeModel, Parameter

ALL = -1.0  # all quantities lag


def applies(model: OdeModel) -> bool:
    """Where an input or another body's reading fixes the clock: else the initial state imitates a lag."""
    return bool(model.inputs) or several_bodies(model)


def observe(t_s: Array, observed: Array, velocity: Array, params: Array) -> Array:
    """Observed - lag * velocity, of all quantities or of one.

    ``observed`` and ``velocity`` (n, d): in the observed unit, and per second; ``params`` (k,).
    """
    lag, which = params
    late = np.full(observed.shape[1], True) if which < 0 else np.arange(observed.shape[1]) == round(which)
    return np.asarray(observed - lag * late * velocity)


def trials(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """All quantities, and each by itself where there are several. ``t_s`` (n,), s; ``observed`` (n, d)."""
    each = range(observed.shape[1]) if observed.shape[1] > 1 else ()
    return [(ALL,), *((float(k),) for k in each)]


EFFECT = Effect(
    name="exposure-lag",
    summary="a reading that lags behind the motion",
    equation=r"x_\mathrm{seen} = x - \tau\,\dot x",
    source="first-order expansion of a delay, and of a sensor of the first order",
    parameters=(
        Parameter("exposure_lag", "s", r"\tau", lower=-1.0, upper=1.0, default=0.0),
        Parameter(
            "lagging_quantity",
            "1",
            "j",
            lower=ALL,
            default=ALL,
            constant=True,
            source="number of the quantity that lags, -1 for all; a diagnosis tries each",
        ),
    ),
    component="reading-of-velocity",
    applies=applies,
    cause="measurement",
    plausibility=0.2,
    observe=observe,
    alike="rolling-shutter, for bodies at different heights in the picture; the initial state, where nothing is driven",
    trials=trials,
    typical="times of the beginning of an exposure instead of its middle: half of it, 0.008 s at 1/60 s",
    example=EffectExample("coupled-oscillators", size=0.05),
)
