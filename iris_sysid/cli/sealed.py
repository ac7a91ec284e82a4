"""The command ``iris-sysid sealed``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Columns, Force, Json, RecordArguments, SampleTime

if TYPE_CHECKING:
    from iris_sysid.io.schemas import FitDocument

ESTIMATION, TEST = "estimation.csv", "test.sealed"
STATED = ("--fit", "--initial", "--after", "--validation-plot")

Record = Annotated[Path, typer.Argument(help="A table to seal the end of, or a sealed record to look at.")]
Keep = Annotated[
    str | None, typer.Option("--keep", help="Seal the last part of the table: 20%, or 100 samples; 100% is all of it.")
]
Frozen = Annotated[
    Path | None, typer.Option("--fit", help="Look: simulate the sealed record with this fit.json or diagnosis.json.")
]
Initial = Annotated[
    int | None,
    typer.Option(help="Number of first samples that give the initial state and are not scored.", min=1),
]
After = Annotated[
    Path | None,
    typer.Option(help="The estimation record that the sealed one follows: its simulation gives the initial state."),
]
Picture = Annotated[
    Path | None, typer.Option("--validation-plot", help="Draw the simulation and its residual's correlations to a PNG.")
]
Result = Annotated[
    Path | None, typer.Option("-o", "--output", help="Folder of the parts; of a look, the fit with its validation.")
]


def sealed(
    record: Record,
    keep: Keep = None,
    fit: Frozen = None,
    initial: Initial = None,
    after: After = None,
    columns: Columns = None,
    sample_time: SampleTime = None,
    output: Result = None,
    validation_plot: Picture = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Keep a test record sealed while a model is searched: each look at it is counted and logged.

    With --keep, the table becomes estimation.csv and test.sealed. With --fit, the sealed record is simulated with the
    frozen model; test.sealed.looks gets a line. With neither, that log is shown.

    \b
    Example:
      iris-sysid sealed rig.csv --keep 20% -o parts/
      iris-sysid sealed parts/test.sealed --fit fit.json --after parts/estimation.csv
    """
    from iris_sysid.errors import DataError

    if keep is not None:
        if fit or initial or after or validation_plot:
            raise DataError(f"--keep seals a record, {', '.join(STATED)} are about a look at one: first seal it")
        _seal(record, keep, columns, sample_time, output, force)
    elif fit is not None:
        if columns or sample_time:
            raise DataError("--columns and --sample-time are about the table that is sealed with --keep")
        _look(record, fit, initial, after, output, validation_plot, force, json)
    else:
        _show_log(record, json)


def _seal(
    table: Path, keep: str, columns: str | None, sample_time: str | None, output: Path | None, force: bool
) -> None:
    from fitters.validation_record import cut_record
    from iris_sysid.cli import _records
    from iris_sysid.io.csv_write import write_trajectory
    from iris_sysid.io.files import check_folder
    from iris_sysid.io.sealed_record import seal

    if output is None:
        raise typer.BadParameter("Missing option '-o': the folder for estimation.csv and test.sealed")
    check_folder(output, (ESTIMATION, TEST), overwrite=force)
    (clip,) = _terminal.read_tables(
        [table], RecordArguments(_records.with_sample_time(columns, sample_time), keep_clipped=True)
    )
    estimation, test = cut_record(clip, _records.kept(keep, clip))
    seal(test, output / TEST, overwrite=force)
    typer.echo(f"{output / TEST}: the last {test.n} samples, sealed", err=True)
    if estimation is not None:
        write_trajectory(estimation, output / ESTIMATION, overwrite=force)
        typer.echo(f"{output / ESTIMATION}: the first {estimation.n} samples", err=True)
    typer.echo(f"{table} still holds both: keep it where no search reads it", err=True)


def _look(
    record: Path,
    frozen: Path,
    initial: int | None,
    after: Path | None,
    output: Path | None,
    picture: Path | None,
    force: bool,
    json: bool,
) -> None:
    from fitters.compose_effects import with_effects
    from fitters.validation_record import validate_model
    from iris_sysid.cli import _model_choice, _records
    from iris_sysid.io.csv_read import read_trajectory
    from iris_sysid.io.json_documents import document_text, validation_entry, write_document
    from iris_sysid.io.sealed_record import counted, model_hash, open_sealed

    _terminal.check_outputs(record, [output, picture], overwrite=force)
    _terminal.check_suffix(picture, ".png")
    document, effects = _frozen(frozen)
    before = None if after is None else read_trajectory(after)
    hold = _records.recorded_hold(document.origin)
    values = {name: estimate.value for name, estimate in document.estimates().items()}
    how = [*effects, f"hold {hold}", f"initial {initial}", f"after {before is not None}"]
    test, looks = open_sealed(record, model_hash(document.equation, values, how), frozen.name)
    typer.echo(f"{record}: {counted(looks)}, this one included", err=True)
    model = with_effects(_model_choice.model_of_fit(document, test), effects)
    known = {quantity.name for quantity in model.derived}
    given = {name: value for name, value in values.items() if name not in known}
    test, *befores = (
        _terminal.from_positions(clip if hold is None else clip.with_(hold=hold), model)[0]
        for clip in (test, before)
        if clip is not None
    )
    before = befores[0] if befores else None
    found = validate_model(model, given, test, before, initial=initial, continues=after is not None)
    entry = validation_entry(found, f"{record.name}, {counted(looks)}")
    looked = document.model_copy(update={"validation": entry})
    if output is not None:
        write_document(looked, output, overwrite=force)
    _records.tell(found, json, "sealed record")
    _records.draw(found, picture, force)
    if json:
        typer.echo(document_text(looked).rstrip("\n"))


def _frozen(path: Path) -> tuple[FitDocument, tuple[str, ...]]:
    """The frozen fit, and the effects that a diagnosis added to its model."""
    from iris_sysid.errors import DataError
    from iris_sysid.io.files import read_file
    from iris_sysid.io.json_documents import read_document
    from iris_sysid.io.schemas import DiagnosisDocument, FitDocument

    file = path / "diagnosis.json" if path.is_dir() else path
    if b'"document": "diagnosis"' in read_file(file)[:200]:
        diagnosis = read_document(file, DiagnosisDocument)
        document = diagnosis.final
        effects: tuple[str, ...] = (*(each.effect for each in diagnosis.added), *diagnosis.nuisances)
    else:
        document, effects = read_document(file, FitDocument), ()
    if document.clips is not None:
        raise DataError(f"{file} is of several clips; give the fit of one")
    return document, effects


def _show_log(record: Path, json: bool) -> None:
    from iris_sysid.io.files import read_file
    from iris_sysid.io.sealed_record import counted, log_of, looks_in

    read_file(record)  # refuses a record that is not there: it would have no looks
    looks = looks_in(log_of(record))
    rows = [
        {"look": look.look, "utc": look.utc, "model": look.model[:12], "name": look.name, "record": look.record[:12]}
        for look in looks
    ]
    _terminal.print_rows(rows, json, header=True)
    typer.echo(f"{record}: {counted(looks)}", err=True)
