"""More to set in motion than the equation knows of: all accelerations are smaller by one factor."""

from __future__ import annotations


def slowed(t: float, position: float, velocity: float, speed: float, base: float, params: tuple[float]) -> float:
    """The base acceleration over 1 + k, less itself.

    Parameters
    ----------
    t, position, velocity, speed
        Not used: as every effect's acceleration takes them.
    base
        The acceleration without the effect.
    params
        k, the inertia left out over the inertia that the equation has.
    """
    (inertia,) = params
    return base * (1.0 / (1.0 + inertia) - 1.0)
