"""Forces that grow with a power of the speed or the depth: the exponent is a form, the motion's own scale a shape."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Parameter

MIN_BASE = 1e-300  # added to a speed or a depth whose power is taken
SCALE = Parameter(
    "speed",
    "{x}/s",
    "v_1",
    lower=MIN_BASE,
    default=1.0,
    constant=True,
    source="the usual speed; another power gives the same force there",
    role="shape",
)


def power(effect: str, usual: float, bounds: tuple[float, float], source: str) -> Parameter:
    """The exponent of an effect, held at its usual value unless the data call for another."""
    low, high = bounds
    name = f"{effect}_power"
    return Parameter(name, "1", "p", low, high, default=usual, constant=True, source=source, role="form")


def at_usual_speed(exponent: float, t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """A drag with a power of the speed, and the usual speed: ``t_s`` (n,) s; ``observed`` (n, d), in its unit."""
    return [(exponent, usual_speed(t_s, observed))]


def usual_speed(t_s: Array, observed: Array) -> float:
    """Median speed, in the observed unit per second, of a motion (n, d) at times (n,) s; 1 for a body at rest."""
    rates = np.gradient(observed, t_s, axis=0) if t_s.size > 1 else np.zeros_like(observed)
    speed = float(np.nanmedian(np.linalg.norm(rates, axis=1)))
    return speed if speed > 0 else 1.0
