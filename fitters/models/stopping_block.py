"""A block that slides under dry friction, turns or stops, and stays where the friction can hold it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._gravity import GRAVITY, MAGNIFICATION
from fitters.models._reading import magnified
from fitters.starting_values import samples, start_of
from iris_sysid.types import Event, ModelExample, OdeModel, Parameter, Quantity, Trajectory

# Modes: what the friction does.
AGAINST, ALONG, STUCK = 0.0, 1.0, 2.0  # brakes a motion along s, brakes one against s, holds


def rhs(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float]:
    """Give s'' = pull - sign(s') friction while it slides, and nothing while it is held."""
    _, v, mode = state
    pull, friction, _, _ = params
    if mode == STUCK:
        return 0.0, 0.0
    return v, pull - friction if mode == AGAINST else pull + friction


def speed(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> float:
    """Speed in the direction in which it slides."""
    if state[2] == STUCK:
        return 1.0
    return state[1] if state[2] == AGAINST else -state[1]


def stop(t: float, state: tuple[float, ...], params: tuple[float, ...]) -> tuple[float, float, float]:
    """At rest the friction holds if it can; otherwise the block slides the way it is pulled."""
    s, v, _ = state
    pull, friction, _, _ = params
    if abs(v) > 1e-9:  # m/s; it moves the other way from the first sample on
        return s, v, AGAINST if v > 0 else ALONG
    if abs(pull) <= friction:
        return s, 0.0, STUCK
    return s, 0.0, AGAINST if pull > 0 else ALONG


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """A parabola through the part that moves: all of its deceleration is friction."""
    t_s, way = samples(trajectory, "s")
    share = np.abs(way - way[0]) / max(float(np.max(np.abs(way - way[0]))), 1e-12)
    moving = max(int(np.searchsorted(np.maximum.accumulate(share), 0.98)), 6)
    start = start_of(t_s[:moving], way[:moving], np.inf, degree=2)
    return {"friction": abs(float(start[2])), "s_0": float(start[0]), "v_0": float(start[1])}


def coefficient(values: Mapping[str, float]) -> Mapping[str, float]:
    """Coefficient of friction on a level board, friction / gravity."""
    return {"friction_coefficient": values["friction"] / values["gravity"] if values["gravity"] else math.nan}


MODEL = OdeModel(
    name="stopping-block",
    summary="a block that dry friction brings to rest and holds there; exact, where coulomb-friction is smooth",
    equation=r"\ddot s = a - f\,\mathrm{sgn}\,\dot s,\quad \dot s = 0 \text{ while } |a| \leq f",
    source="Coulomb (1785), Theorie des machines simples; sticking as in Filippov (1988), chapter 1",
    states=(Quantity("s", "m", "s"), Quantity("v", "m/s", "v")),
    parameters=(
        Parameter("pull", "m/s^2", "a", default=0.0, constant=True, source="a level board: nothing pulls"),
        Parameter("friction", "m/s^2", "f", lower=0.0, upper=1e6),
        GRAVITY,
        MAGNIFICATION,
    ),
    observed=(Quantity("s", "m", "s"),),
    rhs=rhs,
    guess=guess,
    observe=partial(magnified, 1, 3),
    derived=(Quantity("friction_coefficient", "1", r"\mu"),),
    derive=coefficient,
    events=(Event("stop", speed, stop),),
    typical="wood on wood: 2 to 5 m/s^2; on ice: 0.1 to 0.5 m/s^2",
    example=ModelExample({"friction": 2.5, "s_0": 0.1, "v_0": 1.7}, samples=300, rate_hz=240.0),
)
