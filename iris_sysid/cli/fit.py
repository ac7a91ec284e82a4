"""The command ``iris-sysid fit``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid import terminal
from iris_sysid.cli.arguments import Force, Free, Json, ModelName, Output, Settings, Starts, Table


def fit(
    table: Table,
    model: ModelName,
    output: Output,
    known: Settings = None,
    free: Free = None,
    start: Starts = None,
    plot: Annotated[Path | None, typer.Option(help="Also draw the fit and its residual to this PNG file.")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit a governing equation to a trajectory. Writes fit.json: values, standard errors, intervals, units.

    \b
    Example:
      iris-sysid fit trajectory.csv --model pendulum --set gravity=9.79 -o fit.json
    """
    from fitters.ode import fit as fit_model
    from iris_sysid import documents, files, options
    from iris_sysid.registry import MODELS
    from iris_sysid.table_reading import read_trajectory

    chosen = MODELS[model]
    terminal.check_outputs(table, [output, plot], overwrite=force)
    terminal.check_suffix(plot, ".png")
    fixed, first = (options.settings(texts or (), options.units_of(chosen)) for texts in (known, start))
    starts = {name: value.value for name, value in first.items()}
    trajectory = options.asked(read_trajectory(table), model=model, set=known, free=free, start_at=start)
    result = fit_model(trajectory, chosen, fixed=fixed, free=free or (), start=starts)
    documents.write_fit(result, trajectory, output, overwrite=force)
    if plot is not None:
        from iris_sysid.report.figures import fit_figure
        from iris_sysid.report.page import png_of

        files.write_atomic(plot, png_of(fit_figure(trajectory, result)), overwrite=force)
    terminal.show_fit(result, trajectory, json)
    terminal.exit_unless_ok(result)
