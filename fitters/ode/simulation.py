"""Integrate a model at given values: its states, its observed quantities, and their sensitivities to the values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fitters.integrator.initial_value_problem import (
    InitialValueProblem,
    difference_steps,
    initial_value_problem,
    value_names,
)
from fitters.ode.fit_problem import check_names
from fitters.ode.request import NOTHING
from iris_sysid.errors import FitError
from iris_sysid.registry import MODELS
from iris_sysid.types import Array, Discovery, FitResult, Hold, OdeModel, Trajectory, frozen_array, increasing_times


class Simulation(NamedTuple):
    """States (n, s) and observed quantities (n, d) at the given times."""

    states: Array
    observed: Array

    def __repr__(self) -> str:
        return f"Simulation of {self.states.shape[1]} states at {self.states.shape[0]} times"


def simulate(
    model: str | OdeModel | FitResult | Discovery,
    t_s: ArrayLike,
    values: Mapping[str, float] = NOTHING,
    *,
    inputs: ArrayLike | None = None,
    hold: Hold = "linear",
    tolerance: float = 1e-9,
) -> Simulation:
    """Integrate a model from the first of the given times, by Dormand and Prince's method of order 8.

    Parameters
    ----------
    model
        The governing equation, or the name of a registered one. Of a fit or a discovery (its first clip), the fitted
        equation with the estimates, for a motion that begins at the first of the given times;
        :func:`iris_sysid.predict` continues the motion that was measured.
    t_s
        (n,) s, increasing; the spacing may be uneven.
    values
        Parameters and initial states (``theta_0``) by name; constants have their defaults. Derived quantities,
        which a fit also returns, are ignored. Of a fit, only what is to be changed.
    inputs
        (n, m) known inputs at these times, for a model that declares them.
    hold
        Inputs between samples: on a line (``linear``) or held until the next sample (``zero-order``).
    tolerance
        Largest error of each state from the finite time step, relative to the state's size.

    Returns
    -------
    Simulation
        ``states`` (n, s) and ``observed`` (n, d); NaN or infinite from where the solution diverges.

    Raises
    ------
    FitError
        When a value is missing or unknown, or the right-hand side does not return one rate per state.
    DataError
        When times do not increase or inputs have the wrong shape.

    Examples
    --------
    >>> from iris_sysid import simulate
    >>> values = {"length": 0.5, "damping": 0.1, "theta_0": 0.2, "omega_0": 0.0}
    >>> simulate("pendulum", [0.0, 0.5, 1.0], values).observed[:, 0].round(4)
    array([ 0.2   , -0.1145, -0.0573])
    """
    equation, known = _equation_of(model)
    problem, vector = problem_at(equation, t_s, {**known, **values}, inputs, hold)
    problem = problem.planned(vector, tolerance)
    states = np.ascontiguousarray(problem.states(vector[:, None])[:, :, 0])
    return Simulation(states, problem.observe(states, vector))


def sensitivity(
    model: OdeModel,
    t_s: ArrayLike,
    values: Mapping[str, float],
    names: Sequence[str],
    *,
    inputs: ArrayLike | None = None,
    hold: Hold = "linear",
    tolerance: float = 1e-9,
) -> Array:
    """Sensitivities of the observed quantities to parameters and initial states: d observed / d value (n, d, k).

    Central differences of solutions with the same time steps; relative error about 1e-7.

    Parameters
    ----------
    model, t_s, values, inputs, hold, tolerance
        As for :func:`simulate`.
    names
        The k parameters or initial states.

    Raises
    ------
    FitError
        When a name is unknown or a value is missing.
    """
    return linearisation(model, t_s, values, names, inputs=inputs, hold=hold, tolerance=tolerance)[1]


def linearisation(
    model: OdeModel,
    t_s: ArrayLike,
    values: Mapping[str, float],
    names: Sequence[str],
    *,
    inputs: ArrayLike | None = None,
    hold: Hold = "linear",
    tolerance: float = 1e-9,
) -> tuple[Array, Array]:
    """The observed quantities (n, d) and their :func:`sensitivity` (n, d, k), with the same time steps.

    Parameters
    ----------
    model, t_s, values, names, inputs, hold, tolerance
        As for :func:`sensitivity`.
    """
    check_names(model, names=names)
    problem, vector = problem_at(model, t_s, values, inputs, hold)
    problem = problem.planned(vector, tolerance)
    which = np.array([value_names(model).index(name) for name in names], dtype=np.intp)
    slopes = problem.sensitivity(vector, which, difference_steps(problem, vector, which))
    return problem.predicted(vector), slopes


def _equation_of(model: str | OdeModel | FitResult | Discovery) -> tuple[OdeModel, dict[str, float]]:
    """The model, and the values that a fit or a discovery gives it."""
    if isinstance(model, Discovery):
        model = model.fits[0]
    if not isinstance(model, FitResult):
        return MODELS.resolved(model), {}
    if not model.usable:
        raise FitError(f"the fit has no estimates to simulate with ({model.status}): {model.message}")
    return model.model, {name: estimate.value for name, estimate in model.estimates.items()}


def problem_at(
    model: OdeModel, t_s: ArrayLike, values: Mapping[str, float], inputs: ArrayLike | None, hold: Hold
) -> tuple[InitialValueProblem, Array]:
    """The initial value problem from the first of the times on, and its values (p + s,), each in its own unit.

    Parameters
    ----------
    model, t_s, values, inputs, hold
        As for :func:`simulate`; ``t_s`` (n,) s.

    Raises
    ------
    FitError
        When a name is unknown or a value is missing.
    """
    derived = {quantity.name for quantity in model.derived}
    check_names(model, values=[name for name in values if name not in derived])
    times = increasing_times(t_s)
    relaxed = dict.fromkeys(model.initial_names[len(model.own_states) :], 0.0)
    given = relaxed | {p.name: p.default for p in model.parameters if p.default is not None} | dict(values)
    constants = {parameter.name for parameter in model.parameters if parameter.constant}
    missing = [name for name in value_names(model) if name not in given and name not in constants]
    if missing:
        raise FitError(f"model {model.name!r} needs a value for {', '.join(missing)}")
    known = None
    if model.inputs:
        known = frozen_array([] if inputs is None else inputs, (times.size, len(model.inputs)), "inputs")
    vector = np.array([float(given.get(name, np.nan)) for name in value_names(model)])
    return initial_value_problem(model, times, known, hold), vector


def predicted_by(
    fitted: FitResult, trajectory: Trajectory, values: Mapping[str, float], stop: int, *, tolerance: float = 1e-9
) -> Array:
    """Predict the first samples (stop, d), in observed units, with the model of a fit; NaN before it begins.

    Parameters
    ----------
    fitted
        The fit that gives the model and the time at which it begins.
    trajectory
        Gives the times (n,) in s and the inputs.
    values
        Parameters and initial states by name.
    stop
        Number of samples to predict.
    tolerance
        As for :func:`simulate`.
    """
    begin = int(np.searchsorted(trajectory.t_s, fitted.t0_s))
    known = trajectory.inputs[begin:stop] if trajectory.inputs is not None else None
    times = trajectory.t_s[begin:stop]
    _, predicted = simulate(fitted.model, times, values, inputs=known, hold=trajectory.hold, tolerance=tolerance)
    return np.concatenate([np.full((begin, predicted.shape[1]), np.nan), predicted])
