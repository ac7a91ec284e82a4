"""Which columns of a record a model takes, where they do not have the names that it uses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from iris_sysid.types._motion import Trajectory
from iris_sysid.types._numbers import Quantity


def driven_by(trajectory: Trajectory, inputs: Sequence[Quantity], observed: Sequence[str]) -> tuple[Trajectory, str]:
    """The trajectory with its only possible input under the name of the only one of ``inputs``.

    That is an input of another name, or the only quantity of the input's unit that is not ``observed``. The text says
    what was taken; it is empty where nothing was.
    """
    known = [quantity.name for quantity in trajectory.input_quantities]
    if len(inputs) != 1 or inputs[0].name in known or len(known) > 1:
        return trajectory, ""
    (wanted,) = inputs
    if known:
        renamed = (replace(trajectory.input_quantities[0], name=wanted.name, symbol=wanted.symbol),)
        return trajectory.with_(input_quantities=renamed), f"{wanted.name} = {known[0]}"
    others = [quantity for quantity in trajectory.quantities if quantity.name not in observed]
    same = [quantity.name for quantity in others if (quantity.unit or "1") == (wanted.unit or "1")]
    if len(same) != 1 or len(trajectory.quantities) < 2:
        return trajectory, ""
    return _with_input(trajectory, trajectory.column(same[0]), wanted), f"{wanted.name} = {same[0]}"


def _with_input(trajectory: Trajectory, column: int, wanted: Quantity) -> Trajectory:
    """The trajectory with the quantity of a column as its input."""
    rest = [k for k in range(len(trajectory.quantities)) if k != column]
    return trajectory.with_(
        quantities=tuple(trajectory.quantities[k] for k in rest),
        position=trajectory.position[:, rest],
        sigma=trajectory.sigma[:, rest],
        systematic={source: patterns[:, :, rest] for source, patterns in trajectory.systematic.items()},
        smoothed=None,
        input_quantities=(wanted,),
        inputs=np.ascontiguousarray(trajectory.position[:, [column]]),
    )


def upwards(trajectory: Trajectory, observed: Sequence[str]) -> tuple[Trajectory, str]:
    """The trajectory with y, in metres, as z where a model observes x and z: in an image, px, it points down."""
    names = {quantity.name: quantity.unit for quantity in trajectory.quantities}
    if not {"x", "z"} <= set(observed) or "z" in names or "x" not in names or names.get("y") != "m":
        return trajectory, ""
    quantities = tuple(replace(each, name="z") if each.name == "y" else each for each in trajectory.quantities)
    return trajectory.with_(quantities=quantities), "z = y, upwards"
