"""The command ``iris-sysid fit``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _completion, _terminal
from iris_sysid.cli.arguments import (
    TABLE,
    Bounds,
    Columns,
    Equation,
    Force,
    Free,
    Json,
    Output,
    Settings,
    Starts,
    Strict,
)

if TYPE_CHECKING:
    from fitters.integrator.initial_value_problem import Hold
    from fitters.ode import FitOptions
    from iris_sysid.types import Estimate, FitResult, OdeModel, Trajectory, Verdict

AUTO = "auto"
HOLDS: dict[str, Hold] = {"zero": "zero-order", "linear": "linear"}


def fit(
    tables: Annotated[list[Path], typer.Argument(help=f"{TABLE}; several clips.")],
    output: Output,
    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            help="Governing equation; see iris-sysid list. Or FILE.py:NAME.",
            autocompletion=_completion.models,
        ),
    ] = None,
    equation: Equation = None,
    bound: Bounds = None,
    columns: Columns = None,
    known: Settings = None,
    free: Free = None,
    start: Starts = None,
    shared: Annotated[list[str] | None, typer.Option(help="Parameter with one value for all clips.")] = None,
    per_clip: Annotated[list[str] | None, typer.Option(help="Parameter fitted per clip; report no mean.")] = None,
    uncertainty: Annotated[list[str] | None, typer.Option(help="robust, profile, bootstrap or all.")] = None,
    hold: Annotated[
        str,
        typer.Option(
            help="Inputs between samples: zero (held) or linear.", autocompletion=_completion.values("zero", "linear")
        ),
    ] = "linear",
    validate: Annotated[
        Path | None, typer.Option(help="Table that is not fitted: simulation error of the fitted model on it.")
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Also draw the fit and its residual to this PNG file.")] = None,
    force: Force = False,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Fit a governing equation to a trajectory. Writes fit.json: values, standard errors, intervals, units.

    With --model auto the equation is chosen from the bank; several tables are fitted jointly.

    \b
    Example:
      iris-sysid fit trajectory.csv --model pendulum --set gravity=9.79 -o fit.json
      iris-sysid fit trajectory.csv --equation "theta'' = -g/L*sin(theta)" --set g=9.79 -o fit.json
    """
    from iris_sysid.cli import _own_equation, _parsing
    from iris_sysid.errors import DataError
    from iris_sysid.registry import MODELS

    _own_equation.check_one(model, equation, bound or [])
    for table in tables:
        _terminal.check_outputs(table, [output, plot], overwrite=force)
    _terminal.check_suffix(plot, ".png")
    if (shared or per_clip) and len(tables) < 2:
        raise DataError("--shared and --per-clip are about several clips; give several tables")
    if hold not in HOLDS:
        raise DataError(f"inputs between samples are held: {' or '.join(HOLDS)}, not {hold!r:.40}")
    if (validate or hold != "linear") and (len(tables) > 1 or model == AUTO):
        raise DataError("--hold and --validate are about one table and the name of a model, or an equation")
    if len(tables) > 1 and (plot or uncertainty or model == AUTO):
        raise DataError("--plot, --uncertainty and --model auto are about one table; give one")
    if model == AUTO and (plot or uncertainty or known or start):
        raise DataError("--plot, --uncertainty, --set and --start-at need the name of a model, not --model auto")
    chosen: OdeModel | None
    if equation is not None:
        chosen = _own_equation.model_of(equation, bound or [], known or [], tables[0], columns)
    else:
        chosen = None if model in (None, AUTO) else MODELS.named(model)
    units = {} if chosen is None else chosen.units()
    fixed, first = (_parsing.settings(texts or (), units) for texts in (known, start))
    options = {
        "model": model,
        "equation": equation,
        "bound": bound,
        "columns": columns,
        "set": known,
        "free": free,
        "start_at": start,
        "shared": shared,
        "uncertainty": uncertainty,
        "hold": hold,
    }
    clips = [_parsing.with_options(clip, **options) for clip in _terminal.read_tables(tables, columns, chosen)]
    starts = {name: value.value for name, value in first.items()}
    if chosen is None:
        verdict, model = _choose(clips[0], free or [], output, force, json)
    elif len(tables) > 1:
        parts = (shared or [], per_clip or [], free or [])
        verdict = _pool(tables, clips, chosen, parts, fixed, starts, output, force, json)
    else:
        record = _terminal.read_tables([validate], columns, chosen)[0] if validate is not None else None
        verdict = _fit_one(
            clips[0], chosen, fixed, free or [], starts, uncertainty or ["robust"], HOLDS[hold], record,
            output, plot, force, json,
        )  # fmt: skip
    named = ["--model", model] if equation is None else ["--equation", equation]
    same = [*_terminal.repeated("--bound", bound), *_terminal.repeated("--set", known)]
    same += [*_terminal.repeated("--free", free), *_terminal.repeated("--columns", columns and [columns])]
    diagnosis = ("diagnose", *tables, *named, *same, "-o", output.parent / "diagnosis")
    _terminal.suggest(*diagnosis, json=json or HOLDS[hold] != "linear")  # a diagnosis takes inputs as lines
    _terminal.end(verdict, strict)


def _fit_one(
    trajectory: Trajectory,
    model: OdeModel,
    fixed: dict[str, Estimate],
    free: list[str],
    starts: dict[str, float],
    uncertainty: list[str],
    hold: Hold,
    record: Trajectory | None,
    output: Path,
    plot: Path | None,
    force: bool,
    json: bool,
) -> Verdict:
    from dataclasses import replace

    from fitters.ode import FitOptions
    from fitters.ode import fit as fit_model
    from fitters.ode.identifiability import identifiability
    from iris_sysid.io import json_documents

    methods = [method for text in uncertainty for method in text.split(",")]
    with _terminal.phases(f"fitting {model.name}"):
        options = FitOptions(hold=hold)
        result = fit_model(
            trajectory, model, fixed=fixed, free=free, start=starts, uncertainty=methods, options=options
        )
    if result.identifiability is not None:
        result = replace(result, identifiability=identifiability(result, trajectory))
    json_documents.write_fit(result, trajectory, output, overwrite=force)
    _draw(trajectory, result, plot, force)
    _terminal.show_fit(result, trajectory, json)
    _terminal.check_usable(result)
    if record is not None:
        _show_validation(result, record, options, json)
    return result.verdict


def _show_validation(result: FitResult, record: Trajectory, options: FitOptions, json: bool) -> None:
    from fitters.validation_record import validate_fit

    found = validate_fit(result, record, options)
    for quantity, rms, share in zip(found.quantities, found.rms, found.fit_percent, strict=True):
        text = f"validation {quantity.name}: simulation error {rms:.3g} {quantity.unit} rms, fit {share:.1f} %"
        typer.echo(text, err=json)


def _pool(
    tables: list[Path],
    clips: list[Trajectory],
    model: OdeModel,
    names: tuple[list[str], list[str], list[str]],
    fixed: dict[str, Estimate],
    starts: dict[str, float],
    output: Path,
    force: bool,
    json: bool,
) -> Verdict:
    from fitters.ode.several_clips import fit_clips
    from iris_sysid.errors import IrisError
    from iris_sysid.io import json_documents
    from iris_sysid.io.fit_json import pooled_document
    from iris_sysid.report.text import pooled_table

    shared, per_clip, free = names
    with _terminal.phases(f"fitting {model.name} to {len(clips)} clips"):
        pooled = fit_clips(clips, model, shared=shared, per_clip=per_clip, fixed=fixed, free=free, start=starts)
    document = pooled_document(pooled, [table.name for table in tables], clips[0])
    json_documents.write_document(document, output, overwrite=force)
    _terminal.show_verdict(pooled.verdict, json)
    typer.echo(json_documents.document_text(document).rstrip("\n") if json else pooled_table(pooled))
    if not pooled.usable:
        raise IrisError(f"the fit failed ({pooled.status}): {pooled.message}")
    if pooled.message:
        typer.echo(f"note: {pooled.message}", err=True)
    return pooled.verdict


def _choose(trajectory: Trajectory, free: list[str], output: Path, force: bool, json: bool) -> tuple[Verdict, str]:
    """The verdict on the model that is chosen, and its name."""
    from fitters.selection.select import select_model
    from iris_sysid.errors import IrisError
    from iris_sysid.io import json_documents
    from iris_sysid.io.fit_json import selection_document
    from iris_sysid.report.text import fit_table

    with _terminal.phases("fitting every model of the bank"):
        choice = select_model(trajectory, free=free)
    if choice.nearest.fit is None:
        raise IrisError(f"no model of the bank could be fitted: {choice.nearest.note}")
    document = selection_document(choice, trajectory)
    json_documents.write_document(document, output, overwrite=force)
    _terminal.show_verdict(choice.verdict, json)
    typer.echo(json_documents.document_text(document).rstrip("\n") if json else choice.message)
    if choice.chosen is None:
        raise IrisError(choice.message)
    if not json:
        typer.echo(fit_table(choice.nearest.fit))
    return choice.verdict, choice.chosen.model


def _draw(trajectory: Trajectory, result: FitResult, plot: Path | None, force: bool) -> None:
    if plot is None:
        return
    from iris_sysid.io import files
    from iris_sysid.report.figures import fit_figure
    from iris_sysid.report.page import png_of

    files.write_atomic(plot, png_of(fit_figure(trajectory, result)), overwrite=force)
