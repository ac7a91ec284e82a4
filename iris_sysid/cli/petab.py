"""The command ``iris-sysid petab``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import (
    SET,
    TABLE,
    Bounds,
    Columns,
    Equation,
    Force,
    Output,
    RecordArguments,
    StartingValues,
)


@dataclass(frozen=True)
class ExportArguments:
    """The model that is exported with a table."""

    equation: Equation = None
    bound: Bounds = field(default_factory=list)
    known: Annotated[list[str], SET] = field(default_factory=list)
    start: StartingValues = field(default_factory=list)
    columns: Columns = None


@with_groups
def petab(
    source: Annotated[Path, typer.Argument(help=f"{TABLE}, to export; or the .yaml file of a PEtab problem.")],
    output: Output,
    exported: ExportArguments,
    force: Force = False,
) -> None:
    """Exchange a model and its table with other estimation programs as a PEtab problem.

    A table with --equation becomes problem.yaml with an SBML model. A .yaml file becomes one table a condition, and
    the command that fits it is printed.

    \b
    Example:
      iris-sysid petab swing.csv --equation "theta'' = -k*sin(theta)" --start-at k=20 -o petab/
      iris-sysid petab petab/problem.yaml -o tables/
    """
    from iris_sysid.errors import DataError

    _terminal.check_sources([source])
    if source.suffix.lower() in (".yaml", ".yml"):
        if exported != ExportArguments():
            raise DataError("a PEtab problem states its model itself: leave out all options but -o and --force")
        _import(source, output, force)
    elif exported.equation is None:
        raise DataError(
            "a table is exported with its model: give --equation \"theta'' = -g/L*sin(theta)\"; models of the bank "
            "are functions, not text"
        )
    else:
        _export(source, output, exported, force)


def _export(table: Path, output: Path, stated: ExportArguments, force: bool) -> None:
    from fitters.own_model.petab_export import write_petab
    from iris_sysid.cli import _own_equation, _parsing

    assert stated.equation is not None
    (clip,) = _terminal.read_tables([table], RecordArguments(stated.columns, keep_clipped=True))
    bounds, fixed = _own_equation.parsed_bounds(stated.bound), _parsing.settings(stated.known)
    starts = {name: value.value for name, value in _parsing.settings(stated.start).items()}
    written = write_petab(clip, stated.equation, output, bounds=bounds, fixed=fixed, start=starts, overwrite=force)
    typer.echo(written)
    unheld = [name for name, value in fixed.items() if value.stderr > 0]
    if unheld:
        typer.echo(f"note: a PEtab problem cannot hold the standard error of {', '.join(unheld)}", err=True)


def _import(problem: Path, output: Path, force: bool) -> None:
    from fitters.own_model.petab_import import read_petab
    from iris_sysid.io.csv_write import write_trajectory
    from iris_sysid.io.files import check_writable

    found = read_petab(problem)
    found.model()  # refuses what the equation cannot be, before anything is written
    tables = {name: output / f"{name}.csv" for name in found.clips}
    for table in tables.values():
        check_writable(table, overwrite=force)
    bounds = [f"{name}={lower!r}:{upper!r}".replace("-inf:", ":") for name, (lower, upper) in found.bounds.items()]
    bounds = [text.removesuffix("inf") for text in bounds]
    for name, table in tables.items():
        write_trajectory(found.clips[name], table, overwrite=force)
        fixed = [f"{each}={value!r}" for each, value in found.fixed[name].items()]
        starts = [f"{each}={value!r}" for each, value in found.start.items() if each not in found.fixed[name]]
        options = [*_terminal.repeated("--bound", bounds), *_terminal.repeated("--set", fixed)]
        options += _terminal.repeated("--start-at", starts)
        fitted = table.with_name(f"{name}-fit.json")
        typer.echo(_terminal.command("fit", table, "--equation", found.equation, *options, "-o", fitted))
