"""The options ``--equation`` and ``--bound``: a model that the user writes down."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from iris_sysid.errors import DataError
from iris_sysid.units import NUMBER

if TYPE_CHECKING:
    from iris_sysid.cli.arguments import EquationArguments
    from iris_sysid.types import OdeModel, Trajectory

BOUND = re.compile(rf"\s*+(\w++)\s*+=\s*+({NUMBER})?+\s*+:\s*+({NUMBER})?+\s*+")
ONE_OF = (
    "Missing option '--model': auto chooses one, iris-sysid list shows all; or write the equation, "
    "--equation \"theta'' = -g/L*sin(theta)\""
)


def check_one(stated: EquationArguments, other: str | None = None) -> None:
    """Refuse all but either a model or an equation that can be read, and bounds only with the latter.

    ``other`` names a model in another way.
    """
    model = stated.model or other
    if model is None and stated.equation is None:
        raise typer.BadParameter(ONE_OF)
    if model is not None and stated.equation is not None:
        raise DataError("give --model or --equation, not both")
    if stated.bound and stated.equation is None:
        raise DataError("--bound is about the parameters of --equation; a registered model has its own bounds")
    parsed_bounds(stated.bound)
    if stated.equation is not None:
        from fitters.own_model.equation import quantities_of_equation

        quantities_of_equation(stated.equation)


def parsed_bounds(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Read ``L=0.1:10``; an end that is left out is open."""
    bounds = {}
    for text in texts:
        match = BOUND.fullmatch(text)
        if match is None:
            raise DataError(f"cannot read the bounds {text!r:.80}: write them as L=0.1:10, or L=0: for one end")
        lower, upper = match[2] or "-inf", match[3] or "inf"
        bounds[match[1]] = (float(lower), float(upper))
    return bounds


def model_of(stated: EquationArguments, table: Path, columns: str | None) -> OdeModel:
    """The model of an equation for a table, which gives the units of what it holds.

    A unit in ``--set g=9.81m/s^2`` is that of the parameter.
    """
    from iris_sysid.io.csv_read import read_trajectory
    from iris_sysid.io.table_headers import parse_columns

    assert stated.equation is not None
    clip = read_trajectory(table, None if columns is None else parse_columns(columns))
    return model_for(stated.equation, stated.bound, stated.known, clip)


def model_for(text: str, bounds: Sequence[str], known: Sequence[str], clip: Trajectory) -> OdeModel:
    """The model of an equation for a trajectory; see :func:`model_of`."""
    from fitters.own_model.equation import inputs_of_equation, model_from_equation, quantities_of_equation
    from iris_sysid.cli import _parsing

    units = {name: value.unit for name, value in _parsing.settings(known).items() if value.unit}
    units |= {quantity.name: quantity.unit for quantity in (*clip.quantities, *clip.input_quantities)}
    names = quantities_of_equation(text)
    units |= _alone(clip, names)
    observed = [name for name in names if name in units]
    inputs = inputs_of_equation(text)
    others = [quantity.unit for quantity in clip.quantities if quantity.name not in names]
    if len(inputs) == len(others) == 1:  # the only other column drives it, whatever its unit
        units.setdefault(inputs[0], others[0] or "1")
    return model_from_equation(text, units=units, observed=observed, bounds=parsed_bounds(bounds))


def _alone(clip: Trajectory, names: Sequence[str]) -> dict[str, str]:
    """The unit of the only equation's quantity in a table that has one column, under another name."""
    there = {quantity.name: quantity.unit for quantity in clip.quantities}
    if there.keys() & set(names):
        return {}
    if len(there) > 1 or len(names) > 1:
        raise DataError(
            f"the equation is about {', '.join(names)}, but the table has {', '.join(there)}: use its names, or say "
            f"which column is meant, e.g. --columns {names[0]}={next(iter(there))}"
        )
    return dict.fromkeys(names, next(iter(there.values())))
