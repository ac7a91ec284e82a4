"""The damped linear oscillator, for whatever quantity swings."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from fitters.models._reading import shifted
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import Array, OdeModel, Parameter, Quantity, Trajectory


def rhs(t: float, state: tuple[float, float], params: tuple[float, ...]) -> tuple[float, float]:
    """Give y'' = -damping y' - stiffness y."""
    position, velocity = state
    stiffness, damping = params[0], params[1]
    return velocity, -damping * velocity - stiffness * position


def energy(states: Array, params: Array) -> Array:
    """Energy per inertia, y'^2 / 2 + stiffness y^2 / 2.

    In the squared unit of y per s^2. ``states`` (n, s); one value for each sample (n,).
    """
    position, velocity = states.T
    return np.asarray(velocity**2 / 2 + params[0] * position**2 / 2)


def guess(position: str, velocity: str, trajectory: Trajectory) -> Mapping[str, float]:
    """Take the place of rest from y'' regressed on y, 1 and y' in weak form; the rest about it."""
    t_s, values = samples(trajectory, position)
    (stiffness, force, _), _ = weak_regression(t_s, values, np.column_stack([-values, np.ones_like(values)]))
    determined = np.isfinite(stiffness) and stiffness > 0
    rest = float(np.clip(force / stiffness, values.min(), values.max())) if determined else 0.0
    about = trajectory.with_(position=trajectory.position - rest, smoothed=None)
    return {**guess_about_rest(position, velocity, about), "rest": rest}


def guess_about_rest(position: str, velocity: str, trajectory: Trajectory) -> Mapping[str, float]:
    """Stiffness and damping by regression of the weak form, and the initial states, by the names of the states."""
    t_s, values = samples(trajectory, position)
    (stiffness, friction), half_width_s = weak_regression(t_s, values, -values[:, None])
    if not np.isfinite(stiffness):
        stiffness, friction = (np.pi / 2 / (t_s[-1] - t_s[0])) ** 2, 0.0
    start = start_of(t_s, values, min(half_width_s, 0.5 / np.sqrt(max(abs(stiffness), 1e-12))))
    return {
        "stiffness": float(stiffness),
        "damping": float(np.clip(-friction, -1.0, 50.0)),
        f"{position}_0": float(start[0]),
        f"{velocity}_0": float(start[1]),
    }


def rest_position(name: str, unit: str, symbol: str) -> Parameter:
    """What is observed of a body at rest.

    Parameters
    ----------
    name, unit, symbol
        Of the parameter.
    """
    source = "what is observed at rest: 0 unless the motion is about another place"
    return Parameter(name, unit, symbol, -1e6, 1e6, default=0.0, constant=True, source=source, role="offset")


def linear_oscillator(name: str, summary: str, position: Quantity, velocity: Quantity) -> OdeModel:
    """Make the oscillator that observes one quantity.

    Parameters
    ----------
    name, summary
        Of the model.
    position, velocity
        What swings, and its rate.
    """
    symbol = position.symbol
    return OdeModel(
        name=name,
        summary=summary,
        equation=rf"\ddot {symbol} + \beta\,\dot {symbol} + \alpha\,{symbol} = 0",
        source="IRIS benchmark, table of equations; Landau and Lifshitz, Mechanics, section 25",
        states=(position, velocity),
        # Neither may end at zero: estimates of none scatter about it, and so must their intervals.
        parameters=(
            Parameter("stiffness", "1/s^2", r"\alpha", lower=-1e6, upper=1e9),
            Parameter("damping", "1/s", r"\beta", lower=-1e2, upper=1e4, role="damping"),
            rest_position("rest", position.unit, f"{symbol}_r"),
        ),
        observed=(position,),
        rhs=rhs,
        observe=partial(shifted, 1, 2),
        guess=partial(guess, position.name, velocity.name),
        first_integral=energy,
        dissipative=("damping",),
    )
