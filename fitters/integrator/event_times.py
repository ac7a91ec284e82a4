"""When the events of a motion happen: impacts, the cord going taut, a body that stops."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from fitters.integrator.events import integrate_through_events
from fitters.integrator.initial_value_problem import initial_value_problem, value_names
from iris_sysid.errors import FitError
from iris_sysid.types import OdeModel, increasing_times

MAX_LISTED = 10_000  # events listed
TOLERANCE = 1e-9  # relative error of the states from the finite time step


class Happened(NamedTuple):
    """One event of a motion: its time and its name."""

    t_s: float
    name: str


def event_times(model: OdeModel, t_s: ArrayLike, values: Mapping[str, float]) -> tuple[Happened, ...]:
    """The events of the motion with these values, in order of time.

    Parameters
    ----------
    model
        The governing equation, with events and without inputs.
    t_s
        (n,) s, increasing; the initial states hold at the first.
    values
        Parameters and initial states by name, e.g. the values of a fit; constants have their defaults.

    Raises
    ------
    FitError
        When the model has no events, or a value is missing.
    """
    if not model.events or model.inputs:
        raise FitError(f"model {model.name!r} has no events, or has inputs: there is nothing to list")
    given = {p.name: p.default for p in model.parameters if p.default is not None} | dict(values)
    missing = [name for name in value_names(model) if name not in given]
    if missing:
        raise FitError(f"model {model.name!r} needs a value for {', '.join(missing)}")
    vector = np.array([float(given[name]) for name in value_names(model)])
    problem = initial_value_problem(model, increasing_times(t_s), None, "linear").planned(vector, TOLERANCE)
    columns, count = vector[:, None], len(model.parameters)
    out, happened = np.empty((problem.t_s.size, len(model.states), 1)), np.empty((MAX_LISTED, 2, 1))
    integrate_through_events(
        problem.rhs.columns, problem.t_s, problem.substeps, np.ascontiguousarray(columns[count:]),
        np.ascontiguousarray(columns[:count]), problem.inputs, True, out, happened,
    )  # fmt: skip
    listed = happened[np.isfinite(happened[:, 0, 0]), :, 0]
    return tuple(Happened(float(t), model.events[int(which)].name) for t, which in listed)
