"""The speed of a motion, as a scale for forces that depend on it: a result must not depend on the unit of length."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array

SLOWEST = 1e-300  # added to a speed whose power is taken


def usual_speed(t_s: Array, observed: Array) -> float:
    """Median speed, in the observed unit per second, of a motion (n, d) at times (n,) s; 1 for a body at rest."""
    rates = np.gradient(observed, t_s, axis=0) if t_s.size > 1 else np.zeros_like(observed)
    speed = float(np.nanmedian(np.linalg.norm(rates, axis=1)))
    return speed if speed > 0 else 1.0


def first_power(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """A drag in proportion to the speed, and the usual speed: ``t_s`` (n,) s; ``observed`` (n, d), in its unit."""
    return [(1.0, usual_speed(t_s, observed))]


def second_power(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """A drag with the square of the speed, and the usual speed: ``t_s`` (n,) s; ``observed`` (n, d), in its unit."""
    return [(2.0, usual_speed(t_s, observed))]
