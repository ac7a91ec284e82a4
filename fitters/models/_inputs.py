"""What driven models share: the gain of the input, guesses by the weak form, and the inputs of the examples."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import Array, Parameter, Trajectory

SINES = ((1.0, 0.9, 0.0), (0.7, 2.3, 1.0), (0.4, 7.1, 2.0), (0.3, 17.0, 0.5))  # amplitude, rad/s, phase


def gain(unit: str) -> Parameter:
    """The factor from the input's number to what acts: 1 where the input is in the unit that the model declares."""
    source = f"the input is in {unit}; state it where the input is a voltage or a command"
    return Parameter("gain", "1", "k_u", default=1.0, constant=True, source=source)


def pump(unit: str) -> Parameter:
    """What the level of a tank gains of one unit of the input."""
    return Parameter("pump", unit, "k_u", lower=0.0)


def input_of(trajectory: Trajectory, t_s: Array) -> Array:
    """The first input (n,) at times ``t_s`` (n,) s, in its unit; zero where the trajectory has none."""
    known = trajectory.inputs_at(t_s)
    return np.zeros(t_s.size) if known is None else np.nan_to_num(known[:, 0])


def pushed(
    trajectory: Trajectory, position: str, velocity: str, force: Callable[[Array], Array] | None = None
) -> tuple[float, float, float, Mapping[str, float]]:
    """Inertia, damping and the size of a force from y'' = (u - size force(y) - damping y') / inertia, and the start.

    Parameters
    ----------
    trajectory
        Of one position and one input, whose gain is taken for 1.
    position, velocity
        Names of the states.
    force
        ``force(y (n,))`` (n,); none if None.
    """
    t_s, values = samples(trajectory, position)
    terms = [input_of(trajectory, t_s), *([] if force is None else [force(values)])]
    found, half_width_s = weak_regression(t_s, values, np.column_stack(terms))
    determined = np.isfinite(found).all() and found[0] != 0
    inertia, *sizes = (1.0 / found[0], *(-found[1:] / found[0])) if determined else (1.0, *[0.0] * len(terms))
    start = start_of(t_s, values, half_width_s)
    first = {f"{position}_0": float(start[0]), f"{velocity}_0": float(start[1])}
    return abs(float(inertia)), float(sizes[-1]), float(sizes[0]), first


def multisine(t_s: Array) -> Array:
    """A sum of sines of many frequencies as inputs (n, 1) at ``t_s`` (n,) s, in the unit of the model's input."""
    parts = [size * np.sin(rate * np.asarray(t_s) + phase) for size, rate, phase in SINES]
    return np.sum(parts, axis=0)[:, None]


def slow_pump(t_s: Array) -> Array:
    """The same sum, thirty times slower and about 2.5, as a pump's voltage (n, 1) at ``t_s`` (n,) s."""
    return 2.5 + 0.8 * multisine(np.asarray(t_s) / 30.0)
