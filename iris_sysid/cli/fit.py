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
    InputHold,
    Json,
    Output,
    SampleTime,
    Settings,
    Starts,
    Strict,
    Validate,
)

if TYPE_CHECKING:
    from iris_sysid.types import Estimate, FitResult, OdeModel, Trajectory, Validation, Verdict

AUTO = "auto"


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
    sample_time: SampleTime = None,
    hold: InputHold = "auto",
    validate: Validate = None,
    plot: Annotated[Path | None, typer.Option(help="Also draw the fit and its residual to this PNG file.")] = None,
    validation_plot: Annotated[
        Path | None, typer.Option(help="Also draw the validation, with the residual's correlations, to this PNG file.")
    ] = None,
    posterior: Annotated[
        Path | None, typer.Option(help="Also sample the posterior by emcee, and write the draws to this CSV file.")
    ] = None,
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
    from iris_sysid.cli import _own_equation, _parsing, _records
    from iris_sysid.registry import MODELS

    _own_equation.check_one(model, equation, bound or [])
    for table in tables:
        _terminal.check_outputs(table, [output, plot, validation_plot, posterior], overwrite=force)
    for picture in (plot, validation_plot):
        _terminal.check_suffix(picture, ".png")
    _terminal.check_suffix(posterior, ".csv")
    several, auto = len(tables) > 1, model == AUTO
    _refuse(
        not several and (shared or per_clip), "--shared and --per-clip are about several clips; give several tables"
    )
    single = "--plot, --posterior, --uncertainty and --model auto are about one table"
    _refuse(several and (plot or posterior or uncertainty or auto), single)
    unnamed = "need the name of a model, not --model auto"
    _refuse(auto and (plot or uncertainty or known or start), f"--plot, --uncertainty, --set and --start-at {unnamed}")
    _refuse(auto and (validate or posterior or hold != "auto"), f"--hold, --validate and --posterior {unnamed}")
    _refuse(validation_plot and not validate, "--validation-plot draws what --validate simulates; give both")
    if posterior is not None:
        from fitters.ode.posterior import emcee_module

        emcee_module()
    _records.checked_hold(hold)
    columns = _records.with_sample_time(columns, sample_time)
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
        "validate": validate,
    }
    clips = [_parsing.with_options(clip, **options) for clip in _terminal.read_tables(tables, columns, chosen)]
    starts = {name: value.value for name, value in first.items()}
    record = None
    if chosen is not None:
        clips, record = _records.split(clips, validate, columns, chosen)
        clips = _records.held(clips, chosen, hold, fixed=fixed, free=free or [], start=starts)
    if chosen is None:
        verdict, model = _choose(clips[0], free or [], output, force, json)
    elif len(tables) > 1:
        parts = (shared or [], per_clip or [], free or [])
        verdict = _pool(tables, clips, chosen, parts, fixed, starts, output, force, json)
    else:
        validation = None if record is None else (f"{validate}", record, validation_plot)
        verdict = _fit_one(
            clips[0], chosen, fixed, free or [], starts, uncertainty or ["robust"], validation,
            output, plot, posterior, force, json,
        )  # fmt: skip
    named = ["--model", model] if equation is None else ["--equation", equation]
    same = [*_terminal.repeated("--bound", bound), *_terminal.repeated("--set", known)]
    same += [*_terminal.repeated("--free", free), *_terminal.repeated("--columns", columns and [columns])]
    same += [*_terminal.repeated("--validate", validate and [validate])]
    same += ["--hold", hold] if hold != "auto" else []
    diagnosis = ("diagnose", *tables, *named, *same, "-o", output.parent / "diagnosis")
    _terminal.suggest(*diagnosis, json=json)
    _terminal.end(verdict, strict)


def _refuse(wrong: object, text: str) -> None:
    """DataError of that text where something is wrong."""
    from iris_sysid.errors import DataError

    if wrong:
        raise DataError(text)


def _fit_one(
    trajectory: Trajectory,
    model: OdeModel,
    fixed: dict[str, Estimate],
    free: list[str],
    starts: dict[str, float],
    uncertainty: list[str],
    validation: tuple[str, Trajectory, Path | None] | None,
    output: Path,
    plot: Path | None,
    posterior: Path | None,
    force: bool,
    json: bool,
) -> Verdict:
    from dataclasses import replace

    from fitters.ode import fit as fit_model
    from fitters.ode.identifiability import identifiability
    from iris_sysid.io import json_documents

    methods = [method for text in uncertainty for method in text.split(",")]
    with _terminal.phases(f"fitting {model.name}"):
        result = fit_model(trajectory, model, fixed=fixed, free=free, start=starts, uncertainty=methods)
    if result.identifiability is not None:
        result = replace(result, identifiability=identifiability(result, trajectory))
    found = None if validation is None or not result.usable else _validated(result, trajectory, validation[1])
    document = json_documents.fit_document(result, trajectory)
    if found is not None and validation is not None:
        from iris_sysid.io.validation_json import validation_entry

        document = document.model_copy(update={"validation": validation_entry(found, validation[0])})
    json_documents.write_document(document, output, overwrite=force)
    _draw(trajectory, result, plot, force)
    _terminal.show_fit(result, trajectory, json)
    _terminal.check_usable(result)
    if posterior is not None:
        _sample(result, trajectory, posterior, force, json)
    if found is not None and validation is not None:
        from iris_sysid.cli import _records

        _records.tell(found, json)
        _records.draw(found, validation[2], force)
    return result.verdict


def _sample(result: FitResult, trajectory: Trajectory, path: Path, force: bool, json: bool) -> None:
    """Write draws of the posterior, and print their summary; to stderr where stdout is fit.json."""
    from fitters.ode.posterior import sample_posterior
    from iris_sysid.io import files

    with _terminal.phases("sampling the posterior"):
        sampled = sample_posterior(result, trajectory)
    files.write_atomic(path, sampled.frame().to_csv(index=False).encode(), overwrite=force)
    typer.echo(sampled.summary().to_string(float_format="%.6g"), err=json)
    if not sampled.converged:
        typer.echo("note: the chains are too short to be trusted; sample_posterior takes more steps", err=True)


def _validated(result: FitResult, trajectory: Trajectory, record: Trajectory) -> Validation:
    from fitters.validation_record import validate_fit

    return validate_fit(result, record.with_(hold=trajectory.hold), trajectory)


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
