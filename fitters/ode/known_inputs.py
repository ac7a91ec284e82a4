"""The inputs of a record in the order of a model, and what is assumed where they are not known."""

from __future__ import annotations

import numpy as np

from iris_sysid.errors import FitError
from iris_sysid.types import Array, Hold, OdeModel, Trajectory

GAP = 1.5  # usual steps between known values of an input: where one is missing there are 2
USUAL = 0.9  # of the steps are at most as long as the usual one: times may scatter
REMEDY = "give the parts of the record between the gaps as several tables"
BRIDGED = {"zero-order": "held at the last value", "linear": "taken on a line"}


def known_inputs(trajectory: Trajectory, model: OdeModel, span: slice) -> Array | None:
    """Inputs (n, m) in the model's order, held or on a line where they are not known; None where there are none.

    Raises
    ------
    FitError
        When the trajectory lacks an input, or has no known value of it.
    """
    if not model.inputs:
        return None
    names = [quantity.name for quantity in trajectory.input_quantities]
    missing = [quantity.name for quantity in model.inputs if quantity.name not in names]
    if missing or trajectory.inputs is None:
        raise FitError(
            f"model {model.name!r} needs the input {', '.join(missing)}; "
            f"the trajectory has {', '.join(names) or 'no inputs'}"
        )
    columns = [(q.name, trajectory.inputs[:, names.index(q.name)]) for q in model.inputs]
    for name, values in columns:
        if not np.isfinite(values).any():
            raise FitError(f"the input {name!r} has no known value")
    return np.stack([bridged(trajectory.t_s, values, trajectory.hold) for _, values in columns], axis=1)[span]


def bridged(t_s: Array, values: Array, hold: Hold) -> Array:
    """An input (n,) at times ``t_s`` (n,) s, held or on a line where it is not known; some of it is.

    In its own unit.
    """
    known = np.isfinite(values)
    if hold == "linear":
        return np.interp(t_s, t_s[known], values[known])
    last = np.searchsorted(np.flatnonzero(known), np.arange(t_s.size), side="right") - 1
    return np.asarray(values[known][np.maximum(last, 0)])


def gaps_of_inputs(trajectory: Trajectory, model: OdeModel, span: slice) -> str:
    """Where the inputs are bridged between ``span``'s samples: how many gaps, and how long; empty where nowhere."""
    inputs = trajectory.inputs
    if not model.inputs or inputs is None:
        return ""
    names = {quantity.name for quantity in model.inputs}
    columns = [column for column, quantity in enumerate(trajectory.input_quantities) if quantity.name in names]
    t_s, known = trajectory.t_s[span], np.isfinite(inputs[span][:, columns]).all(axis=1)
    steps = np.diff(t_s[known])
    gaps = steps[steps > GAP * np.quantile(np.diff(t_s), USUAL)] if t_s.size > 1 else steps
    if not gaps.size:
        return ""
    count = f"{gaps.size} gaps of up to" if gaps.size > 1 else "a gap of"
    how = BRIDGED[trajectory.hold]
    return f"the input is not known in {count} {np.max(gaps):.4g} s and {how} there; if it changed, {REMEDY}"
