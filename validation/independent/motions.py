"""Undisturbed motions, as SciPy integrates them: equations, ranges of their parameters, clip length and noise."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Values = Mapping[str, float]
# the acceleration (or rate) of the undisturbed motion: (t, state, values) -> (d,)
Law = Callable[[float, Array, Values], Array]
# what is added to it: (t, position (d,), velocity (d,), undisturbed acceleration (d,)) -> (d,)
Force = Callable[[float, Array, Array, Array], Array]

RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 1e-10, 1e-12
GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion of d coordinates: its law, what is observed, and the ranges that its truth is drawn from.

    ``order`` is that of the equation; ``observed`` are (name, unit) of each coordinate; ``noise`` is the standard
    deviation of one sample in that unit; ``ranges`` of parameters and of initial values ``x0, v0`` (numbered from 0);
    ``model`` is the name under which the library fits it.
    """

    model: str
    order: int
    observed: tuple[tuple[str, str], ...]
    law: Law
    ranges: Mapping[str, tuple[float, float]]
    seconds: float
    noise: float
    rate_hz: float = 60.0
    dissipative: bool = False

    @property
    def size(self) -> int:
        """Number of coordinates d."""
        return len(self.observed)

    def times(self, start_s: float = 0.0) -> Array:
        """Times (n,) of the samples, s."""
        return start_s + np.arange(round(self.seconds * self.rate_hz)) / self.rate_hz

    def draw(self, rng: np.random.Generator) -> dict[str, float]:
        """Parameters and initial values, drawn uniformly from their ranges."""
        return {name: float(rng.uniform(*ends)) for name, ends in self.ranges.items()}

    def start(self, values: Values) -> Array:
        """The initial state (d,) or (2 d,): positions, then velocities."""
        names = [f"x{k}" for k in range(self.size)] + [f"v{k}" for k in range(self.size)] * (self.order == 2)
        return np.array([values[name] for name in names])


def integrate(
    motion: Motion, values: Values, t_s: Array, force: Force | None = None, kicks: Mapping[float, Array] | None = None
) -> Array:
    """Integrate a motion through kicks of its velocity; positions (n, d) and velocities (n, d), stacked as (n, 2 d).

    Parameters
    ----------
    motion, values
        The law and its numbers.
    t_s
        (n,) s, increasing; the motion starts at the first.
    force
        Added to the acceleration, or to the rate of a motion of first order.
    kicks
        Jump (d,) of the velocity at a time in s.
    """
    d = motion.size

    def rates(t: float, state: Array) -> Array:
        base = motion.law(t, state, values)
        velocity = state[d:] if motion.order == 2 else base
        added = force(t, state[:d], velocity, base) if force is not None else 0.0
        return np.concatenate([state[d:], base + added]) if motion.order == 2 else base + added

    state, pieces = motion.start(values), []
    edges = [t_s[0], *sorted(kicks or {}), t_s[-1]]
    for number, (begin, end) in enumerate(itertools.pairwise(edges)):
        last = number == len(edges) - 2
        inside = t_s[(t_s >= begin) & ((t_s <= end) if last else (t_s < end))]
        points = np.unique([begin, *inside, end])
        solved = solve_ivp(
            rates,
            (begin, end),
            state,
            "DOP853",
            points,
            rtol=RELATIVE_TOLERANCE,
            atol=ABSOLUTE_TOLERANCE,
            max_step=0.02,
        )
        if not solved.success:
            raise ArithmeticError(f"{motion.model}: {solved.message}")
        pieces.append(solved.y.T[np.isin(points, inside)])
        state = solved.y[:, -1].copy()
        if not last:
            state[d:] += (kicks or {})[end]
    states = np.concatenate(pieces)
    if motion.order == 2:
        return states
    slopes = np.array([rates(t, x) for t, x in zip(t_s, states, strict=True)])
    return np.hstack([states, slopes])


def _pendulum(t: float, state: Array, values: Values) -> Array:
    return np.array([-GRAVITY / values["length"] * np.sin(state[0]) - values["damping"] * state[1]])


def _oscillator(t: float, state: Array, values: Values) -> Array:
    return np.array([-values["stiffness"] * state[0] - values["damping"] * state[1]])


def _incline(t: float, state: Array, values: Values) -> Array:
    return np.array([values["acceleration"]])


def _fall(t: float, state: Array, values: Values) -> Array:
    return np.array([-values["gravity"]])


def _throw(t: float, state: Array, values: Values) -> Array:
    return np.array([0.0, -GRAVITY])


def _tank(t: float, state: Array, values: Values) -> Array:
    return np.array([-values["outflow"] * np.sqrt(max(float(state[0]), 0.0))])


def _decay(t: float, state: Array, values: Values) -> Array:
    return np.array([-values["decay_rate"] * (state[0] - values["background"])])


# Noise: 0.1 px of a 720-line picture, as far as the scene needs it; 0.3 of 255 grey levels for a brightness.
MOTIONS: Mapping[str, Motion] = {
    motion.model: motion
    for motion in (
        Motion(
            "pendulum", 2, (("theta", "rad"),), _pendulum,
            {"length": (0.3, 1.0), "damping": (0.01, 0.1), "x0": (0.3, 1.2), "v0": (-0.5, 0.5)},
            10.0, 5e-4, dissipative=True,
        ),
        Motion(
            "linear-oscillator", 2, (("z", "m"),), _oscillator,
            {"stiffness": (9.0, 60.0), "damping": (0.02, 0.2), "x0": (0.1, 0.3), "v0": (-0.2, 0.2)},
            10.0, 2e-4, dissipative=True,
        ),
        Motion(
            "incline", 2, (("s", "m"),), _incline, {"acceleration": (0.5, 2.0), "x0": (0.0, 0.1), "v0": (0.1, 0.5)},
            2.0, 2e-4,
        ),
        Motion(
            "free-fall", 2, (("z", "m"),), _fall, {"gravity": (9.78, 9.83), "x0": (1.5, 2.0), "v0": (-0.2, 0.2)},
            0.6, 2e-4,
        ),
        Motion(
            "projectile", 2, (("x", "m"), ("z", "m")), _throw,
            {"x0": (0.0, 0.1), "x1": (0.5, 0.8), "v0": (1.5, 2.5), "v1": (2.0, 3.5)}, 0.8, 2e-4,
        ),
        Motion(
            "torricelli", 1, (("h", "m"),), _tank, {"outflow": (0.02, 0.035), "x0": (0.2, 0.3)}, 20.0, 2e-4,
        ),
        Motion(
            "exponential-decay", 1, (("intensity", "1"),), _decay,
            {"decay_rate": (0.4, 1.0), "x0": (150.0, 220.0), "background": (0.0, 20.0)}, 5.0, 0.3,
        ),
    )
}  # fmt: skip
