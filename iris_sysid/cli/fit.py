"""The command ``iris-sysid fit``."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import as_typed, typed, with_groups
from iris_sysid.cli.arguments import (
    TABLE,
    EquationArguments,
    Force,
    Json,
    Output,
    RecordArguments,
    StartingValues,
    Strict,
    Validate,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from iris_sysid.types import FitResult, OdeModel, Trajectory, Validation, Verdict

AUTO = "auto"


@dataclass(frozen=True)
class FitArguments:
    """What is fitted, from where, and how its errors are found."""

    start: StartingValues = field(default_factory=list)
    shared: Annotated[list[str], typer.Option(help="Parameter with one value for all clips.")] = field(
        default_factory=list
    )
    per_clip: Annotated[list[str], typer.Option(help="Parameter fitted per clip; report no mean.")] = field(
        default_factory=list
    )
    uncertainty: Annotated[list[str], typer.Option(help="robust, profile, bootstrap or all.")] = field(
        default_factory=list
    )
    validate: Validate = None


@dataclass(frozen=True)
class FilesArguments:
    """What is written beside fit.json."""

    plot: Annotated[Path | None, typer.Option(help="Also draw the fit and its residual to this PNG file.")] = None
    validation_plot: Annotated[
        Path | None, typer.Option(help="Also draw the validation, with the residual's correlations, to this PNG file.")
    ] = None
    posterior: Annotated[
        Path | None, typer.Option(help="Also sample the posterior by emcee, and write the draws to this CSV file.")
    ] = None


@with_groups
def fit(
    tables: Annotated[list[Path], typer.Argument(help=f"{TABLE}; several clips.")],
    output: Output,
    stated: EquationArguments,
    record: RecordArguments,
    how: FitArguments,
    files: FilesArguments,
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

    _own_equation.check_one(stated)
    for table in tables:
        _terminal.check_outputs(table, [output, files.plot, files.validation_plot, files.posterior], overwrite=force)
    for picture in (files.plot, files.validation_plot):
        _terminal.check_suffix(picture, ".png")
    _terminal.check_suffix(files.posterior, ".csv")
    _check_together(len(tables) > 1, stated, record, how, files)
    if files.posterior is not None:
        from fitters.ode.posterior import emcee_module

        emcee_module()
    record = _records.checked(record)
    chosen: OdeModel | None = None
    if stated.equation is not None:
        chosen = _own_equation.model_of(stated, tables[0], record.columns)
    elif stated.model not in (None, AUTO):
        chosen = MODELS.named(stated.model)
    units = {} if chosen is None else chosen.units()
    fixed, first = (_parsing.settings(texts, units) for texts in (stated.known, how.start))
    options = typed(stated, record, how)
    read = _terminal.read_tables(tables, record, chosen)
    clips = [_parsing.with_options(clip, **options) for clip in read]
    if chosen is None:
        verdict, model = _choose(clips[0], stated.free, output, force, json)
        stated = replace(stated, model=model)
    else:
        starts = {name: value.value for name, value in first.items()}
        clips, kept = _records.split(clips, how.validate, record, chosen)
        clips = _records.held(clips, chosen, record.hold, fixed=fixed, free=stated.free, start=starts)
        values = {"fixed": fixed, "free": stated.free, "start": starts}
        if len(tables) > 1:
            verdict = _pool(tables, clips, chosen, how, values, output, force, json)
        else:
            verdict = _fit_one(clips[0], chosen, how, values, kept, files, output, force, json)
    same = as_typed(stated, record, how, leave_out=("start", "shared", "per_clip", "uncertainty"))
    _terminal.suggest("diagnose", *tables, *same, "-o", output.parent / "diagnosis", json=json)
    _terminal.end(verdict, strict)


def _check_together(
    several: bool, stated: EquationArguments, record: RecordArguments, how: FitArguments, files: FilesArguments
) -> None:
    """Refuse options that do not go together."""
    auto, plot, posterior = stated.model == AUTO, files.plot, files.posterior
    clips = "--shared and --per-clip are about several clips; give several tables"
    _refuse(not several and (how.shared or how.per_clip), clips)
    single = "--plot, --posterior, --uncertainty and --model auto are about one table"
    _refuse(several and (plot or posterior or how.uncertainty or auto), single)
    unnamed = "need the name of a model, not --model auto"
    values = f"--plot, --uncertainty, --set and --start-at {unnamed}"
    _refuse(auto and (plot or how.uncertainty or stated.known or how.start), values)
    later = f"--hold, --validate and --posterior {unnamed}"
    _refuse(auto and (how.validate or posterior or record.hold != "auto"), later)
    drawn = "--validation-plot draws what --validate simulates; give both"
    _refuse(files.validation_plot and not how.validate, drawn)


def _refuse(wrong: object, text: str) -> None:
    """DataError of that text where something is wrong."""
    from iris_sysid.errors import DataError

    if wrong:
        raise DataError(text)


def _fit_one(
    trajectory: Trajectory,
    model: OdeModel,
    how: FitArguments,
    values: Mapping[str, Any],
    record: Trajectory | None,
    files: FilesArguments,
    output: Path,
    force: bool,
    json: bool,
) -> Verdict:
    from fitters.ode import fit as fit_model
    from fitters.ode.identifiability import identifiability
    from iris_sysid.cli import _records
    from iris_sysid.io import json_documents

    methods = [method for text in how.uncertainty or ["robust"] for method in text.split(",")]
    with _terminal.phases(f"fitting {model.name}"):
        result = fit_model(trajectory, model, **values, uncertainty=methods)
    if result.identifiability is not None:
        result = replace(result, identifiability=identifiability(result, trajectory))
    found = None if record is None or not result.usable else _validated(result, trajectory, record)
    document = json_documents.fit_document(result, trajectory)
    if found is not None:
        from iris_sysid.io.json_documents import validation_entry

        document = document.model_copy(update={"validation": validation_entry(found, f"{how.validate}")})
    json_documents.write_document(document, output, overwrite=force)
    if files.plot is not None:
        from iris_sysid.report.figures import fit_figure

        _terminal.draw(fit_figure(trajectory, result), files.plot, overwrite=force)
    _terminal.show_fit(result, trajectory, json)
    _terminal.check_usable(result)
    if files.posterior is not None:
        _sample(result, trajectory, files.posterior, force, json)
    if found is not None:
        _records.tell(found, json)
        _records.draw(found, files.validation_plot, force)
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
    how: FitArguments,
    values: Mapping[str, Any],
    output: Path,
    force: bool,
    json: bool,
) -> Verdict:
    from fitters.ode.several_clips import fit_clips
    from iris_sysid.errors import IrisError
    from iris_sysid.io import json_documents
    from iris_sysid.io.fit_json import pooled_document
    from iris_sysid.report.text import pooled_table

    with _terminal.phases(f"fitting {model.name} to {len(clips)} clips"):
        pooled = fit_clips(clips, model, shared=how.shared, per_clip=how.per_clip, **values)
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
