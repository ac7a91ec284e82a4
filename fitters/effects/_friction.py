"""Speeds that shape a friction, relative to the motion, so that no result depends on the unit of length."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Parameter, ParameterRole

TURNOVER = 0.01  # of the largest speed, within which dry friction turns over so that the solution is differentiable
ASSUMED = 3e-2  # unit/s: 1 % of a speed of 3 rad/s or 3 m/s
SHARPER = 10.0  # the factor to the next turnover that is tried: a body at rest creeps in a wide one
STRETCHES = 100  # of the clip, over which speeds are averaged, so that noise does not make them


def largest_speed(t_s: Array, observed: Array) -> float:
    """The largest speed in a clip, per second: 95 % of its stretches are slower. NaN samples are left out.

    ``t_s`` (n,), s; ``observed`` (n, d), in the observed unit.
    """
    known = np.isfinite(observed).all(axis=1)
    times, position = t_s[known], observed[known]
    every = max(1, times.size // STRETCHES)
    moved, passed_s = position[every:] - position[:-every], times[every:] - times[:-every]
    return float(np.quantile(np.max(np.abs(moved), axis=1) / passed_s, 0.95)) if passed_s.size else ASSUMED / TURNOVER


def turnover(t_s: Array, observed: Array) -> float:
    """The speed, per second, within which dry friction turns over in a clip; arguments as for largest_speed."""
    return TURNOVER * largest_speed(t_s, observed) or ASSUMED


def turnovers(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """That speed, per second, as the only value to try; arguments as for largest_speed."""
    return [(turnover(t_s, observed),)]


def sharper(t_s: Array, shape: tuple[float, ...]) -> list[tuple[float, ...]]:
    """A turnover within a smaller speed: a fit finds its way with a wide one, and ends with what the data show."""
    return [(shape[0] / SHARPER,)]


def turnover_parameter(name: str, role: ParameterRole = "shape") -> Parameter:
    """The speed within which dry friction turns over smoothly about standstill; a ``form`` where it may be wide."""
    return Parameter(
        name, "{x}/s", "v_0", lower=1e-12, default=ASSUMED, constant=True, role=role,
        source="assumed; a diagnosis takes 1 % of the largest speed",
    )  # fmt: skip
