"""The command ``iris-sysid diagnose``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._each import SearchArguments
from iris_sysid.cli._groups import as_typed, typed, with_groups
from iris_sysid.cli.arguments import (
    TABLE,
    EquationArguments,
    Force,
    Json,
    Output,
    RecordArguments,
    Strict,
    Validate,
    WorkArguments,
)

if TYPE_CHECKING:
    from iris_sysid.diagnosis.planning.plan import Plan
    from iris_sysid.report.film import Footage
    from iris_sysid.report.validation_figure import ValidatedDiagnosis
    from iris_sysid.types import Diagnosis, OdeModel, Trajectory


@dataclass(frozen=True)
class JointArguments:
    """What is known of the clips of a joint diagnosis."""

    clip_set: Annotated[
        list[str],
        typer.Option(
            "--clip-set", help="What is known of one clip: heavy.csv:mass=0.2, or 2:mass=0.2; radius, length."
        ),
    ] = field(default_factory=list)
    validate: Validate = None
    trials: Annotated[int | None, typer.Option(help="Number of clips of each setting of a data set.")] = None
    board: Annotated[str | None, typer.Option(help="Inner corners of a data set's checkerboards: 9x6.")] = None
    square: Annotated[str | None, typer.Option(help="Side of their squares: 25mm or 25.0+-0.1mm.")] = None


@with_groups
def diagnose(
    clips: Annotated[list[Path], typer.Argument(help=f"{TABLE}; folders of them, of run, or a data set.")],
    output: Output,
    stated: EquationArguments,
    record: RecordArguments,
    search: SearchArguments,
    joint: JointArguments,
    work: WorkArguments,
    each: Annotated[bool, typer.Option("--each", help="Diagnose every clip by itself, with a summary of all.")] = False,
    force: Force = False,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Find what a governing equation lacks: the parts of its residual, the effects, the error before and after.

    A folder of run needs no further option. Several clips of the same kind are diagnosed jointly; those of a data set
    are measured first, once. With --each every clip is diagnosed by itself: a page for each and summary.csv; a second
    run does only what is missing. The model may be your own: FILE.py:NAME.

    \b
    Example:
      iris-sysid diagnose trajectory.csv --model pendulum -o diagnosis/
    """
    from iris_sysid.cli import _each, _model_choice, _parsing, _records
    from iris_sysid.io.files import check_folder
    from iris_sysid.io.json_documents import document_text
    from iris_sysid.pipeline.clip_folders import is_dataset, tables_in
    from iris_sysid.registry import EFFECTS, MODELS
    from iris_sysid.report.diagnosis_files import FILES

    record = _records.checked(record)
    if each:
        of_joint = {f"--{name.replace('_', '-')}": value for name, value in vars(joint).items()}
        _terminal.refuse(of_joint, "belongs to a joint diagnosis, not to --each; leave it out")
        request, processes = _each.EachRequest(stated, record, search), _terminal.workers_of(work)
        if not _each.diagnose_clips(clips, output, request, processes, force=force, json=json) and strict:
            raise typer.Exit(_terminal.NOT_GOOD)
        return
    if not any(map(is_dataset, clips)):
        parallel = {"--workers": work.workers, "--scheduler": work.scheduler}
        _terminal.refuse(parallel, "belongs to --each and to data sets; several tables at once are one fit")
    processes = _terminal.workers_of(work)
    check_folder(output, FILES, overwrite=force)
    described, free_by_default = _model_choice.stated_model(stated, search.phenomenon, clips, record)
    fixed = _parsing.settings(stated.known, described.units())
    limits, sensor = search.limits(), _parsing.sensor(search.sensor)
    options = typed(stated, record, search, clip_set=joint.clip_set, validate=joint.validate)
    options["model"] = stated.model or described.name
    measured = _measured(clips, described, record, search.phenomenon, output, joint, processes)
    # imported after the clips are read, so that an unreadable file is reported without delay
    from iris_sysid.diagnosis.diagnose import diagnose as find_missing_effects
    from iris_sysid.report.diagnosis_text import diagnosis_text

    measured = _parsing.with_clip_settings(measured, clips, joint.clip_set, described.units())
    trajectories = [_parsing.with_options(clip, **options) for clip in measured]
    if sensor is not None:
        trajectories = [clip.with_(sensor=sensor) for clip in trajectories]
    known_before = {name for clip in measured for name in (*fixed, *clip.known)}
    named = [*(name for name in free_by_default if name not in known_before), *stated.free]
    estimated = list(dict.fromkeys(named))
    trajectories, kept = _records.split(trajectories, joint.validate, record, described)
    trajectories = _records.held(trajectories, described, record.hold, fixed=fixed, free=estimated)

    def search_in(clips: "list[Trajectory]") -> "Diagnosis":
        with _terminal.phases(f"fitting {described.name}", _how_to_end(search.seconds)) as say:
            return find_missing_effects(
                clips,
                described,
                fixed=fixed,
                free=estimated,
                effects=[*EFFECTS.values(), *map(EFFECTS.named, search.effect)],
                holdout=search.holdout,
                progress=say,
                **limits,
            )

    trajectories, diagnosis = _records.diagnosed(trajectories, search_in, record.hold)
    if not json:
        typer.echo(_terminal.lines(diagnosis_text(diagnosis)))
    _terminal.show_verdict(diagnosis.verdict, json)
    validated = None if kept is None else _validated(diagnosis, trajectories[0], kept, f"{joint.validate}", json)
    stopped = _stopped(diagnosis, json)
    # drawing the page takes longer than a short search: the answer is there before it
    from iris_sysid.report.diagnosis_page import diagnosis_document, write_diagnosis

    planned = None if stopped else _planned(diagnosis, trajectories)
    footage = _footage(clips[0], measured[0])
    page = write_diagnosis(
        diagnosis, trajectories, output, planned=planned, footage=footage, validated=validated, overwrite=force
    )
    if json:
        typer.echo(document_text(diagnosis_document(diagnosis, trajectories, validated)).rstrip("\n"))
    typer.echo(f"report: {page}", err=True)
    tables = [] if any(map(is_dataset, clips)) else [table for path in clips for table in tables_in(path)]
    same = as_typed(record)
    if planned is not None and not json:
        _advise(planned, tables, output, same)
    if diagnosis.incomplete and tables and MODELS.get(described.name) is described:
        named, found = ["--residual-of", described.name], output / "discovery.json"
        given = _terminal.repeated("--set", stated.known)
        _terminal.suggest("discover", *tables, *named, *same, *given, "-o", found, json=json)
    _terminal.end(diagnosis.verdict, strict)


def _validated(
    diagnosis: "Diagnosis", clip: "Trajectory", record: "Trajectory", name: str, json: bool
) -> "ValidatedDiagnosis":
    """The record simulated by the model without the effects and with them, said on the terminal."""
    from fitters.validation_record import validate_fit
    from iris_sysid.cli import _records
    from iris_sysid.report.validation_figure import ValidatedDiagnosis

    held = record.with_(hold=clip.hold)
    before = validate_fit(diagnosis.base, held, clip)
    after = validate_fit(diagnosis.final, held, clip) if diagnosis.final is not diagnosis.base else before
    if after is not before:
        _records.tell(before, json, "validation without effects")
    _records.tell(after, json)
    return ValidatedDiagnosis(name, before, after)


def _footage(path: Path, clip: "Trajectory") -> "Footage | None":
    """The frames of the first clip for the page, where ``run`` measured it and it still lies near its table."""
    from iris_sysid.pipeline.clip_folders import is_dataset, tables_in
    from iris_sysid.report.film import footage_of_table

    return None if is_dataset(path) else footage_of_table(tables_in(path)[0], clip)


def _how_to_end(seconds: float | None) -> str:
    """What the line of progress says of the end of the search."""
    limit = "" if seconds is None else f"at most {seconds:g} s; "
    return f"{limit}Ctrl-C: the best answer so far"


def _stopped(diagnosis: "Diagnosis", json: bool) -> bool:
    """Whether the search was ended early; beside JSON, stderr states what was stopped."""
    notes = [note.text for note in diagnosis.notes if note.kind == "stopped"]
    for text in notes if json else ():
        typer.echo(f"note: {_terminal.one_line(text)}", err=True)
    return bool(notes)


def _planned(diagnosis: "Diagnosis", clips: "list[Trajectory]") -> "Plan | None":
    """What to film next; None where one name is left, or where no name can be refitted."""
    from iris_sysid.diagnosis.planning.plan import plan
    from iris_sysid.diagnosis.planning.rivals import Question
    from iris_sysid.errors import FitError

    if len(Question.of(diagnosis).names) < 2:
        return None
    try:
        return plan(diagnosis, clips)
    except FitError:  # the diagnosis stands without advice
        return None


def _advise(planned: "Plan", tables: list[Path], output: Path, same: list[str]) -> None:
    """Say on stderr what to film next, and the command that ranks all changes."""
    from iris_sysid.report.plan_text import advice

    for line in advice(planned):
        typer.echo(line, err=True)
    if tables:
        names = _terminal.repeated("--name", list(planned.probabilities))
        _terminal.suggest("plan", output, *tables, *names, *same)


def _measured(
    clips: list[Path],
    model: "OdeModel",
    record: RecordArguments,
    phenomenon: str | None,
    output: Path,
    joint: JointArguments,
    workers: int | str,
) -> "list[Trajectory]":
    """The trajectories of tables and folders; clips of a data set are measured, with results beside the output."""
    from iris_sysid.pipeline.clip_folders import is_dataset, tables_in

    trajectories: list[Trajectory] = []
    for path in clips:
        if not is_dataset(path):
            trajectories += _terminal.read_tables(tables_in(path), record, model)
            continue
        from iris_sysid.cli._dataset_clips import measured_clips  # loads the benchmark, which tables do without

        trajectories += measured_clips(
            path,
            phenomenon,
            Path(f"{output}".rstrip("/") + ".work"),
            corners=joint.board,
            square=joint.square,
            trials=joint.trials,
            workers=workers,
        )
    return trajectories
