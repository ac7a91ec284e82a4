"""The command ``iris-sysid plan``."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _completion, _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import TABLE, EquationArguments, Force, Json, RecordArguments

if TYPE_CHECKING:
    from iris_sysid.diagnosis.planning.changes import SetUpChange
    from iris_sysid.diagnosis.planning.plan import Plan
    from iris_sysid.diagnosis.planning.rivals import Question
    from iris_sysid.io.schemas import DiagnosisDocument
    from iris_sysid.types import OdeModel, Trajectory

FILES = ("plan.json", "plan.png")
BODY = ("mass", "radius", "length", "spring")

Diagnosed = Annotated[Path | None, typer.Argument(help="diagnosis.json, or the folder that holds it.")]
Clips = Annotated[list[Path] | None, typer.Argument(help=f"The clips that were diagnosed. {TABLE}.")]
Folder = Annotated[Path | None, typer.Option("-o", "--output", help="Folder for plan.json and plan.png.")]


@dataclass(frozen=True)
class ChangeArguments:
    """What to tell apart, what the changes cost, and the new clip."""

    name: Annotated[
        list[str], typer.Option("--name", help="Tell these apart instead: quadratic-drag, nothing. Repeat it.")
    ] = field(default_factory=list)
    cost: Annotated[list[str], typer.Option("--cost", help="Cost of a change, 1 for others: release75=3.")] = field(
        default_factory=list
    )
    precise: Annotated[
        list[str], typer.Option("--precise", help="Say what a value needs to be known that well: gravity=0.1%.")
    ] = field(default_factory=list)
    filmed: Annotated[Path | None, typer.Option("--filmed", help="The new clip, made with the change --change.")] = None
    change: Annotated[
        str,
        typer.Option(
            "--change",
            help="What the new clip was made with: release75, plan.json:release75, or factors, mass=2.3,radius=1.",
        ),
    ] = "repeat"


@dataclass(frozen=True)
class FilmingArguments:
    """The effect to find before any clip, and how it will be filmed."""

    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            help="Before any clip: the effect to find, and its size: quadratic-drag=0.05.",
            autocompletion=_completion.effects,
        ),
    ] = None
    phenomenon: Annotated[
        str | None,
        typer.Option(
            "--phenomenon", help="What will be filmed, with --to; see list.", autocompletion=_completion.phenomena
        ),
    ] = None
    distance: Annotated[float, typer.Option(help="Distance of the camera in m, with --to.", min=0.01)] = 2.0
    fps: Annotated[float, typer.Option("--fps", help="Frame rate in 1/s, with --to.", min=1.0)] = 60.0
    noise_px: Annotated[
        float, typer.Option("--noise-px", help="Noise of a tracked position in px, with --to.", min=1e-4)
    ] = 0.1


@with_groups
def plan(
    changes: ChangeArguments,
    camera: FilmingArguments,
    stated: EquationArguments,
    record: RecordArguments,
    diagnosis: Diagnosed = None,
    clips: Clips = None,
    output: Folder = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Rank what to film next: how likely each change of the set-up tells the possible effects apart.

    With --filmed, weigh the effects with the new clip, which was made with one of the changes. With --to, no clip is
    needed: the smallest size of an effect that clips of several starts and lengths can show. The model is that of the
    diagnosis, unless one is stated.

    \b
    Example:
      iris-sysid plan diagnosis/ trajectory.csv -o plan/
    """
    if camera.to is not None:
        of_clips = {"--model": stated.model, "--equation": stated.equation, "--bound": stated.bound}
        _terminal.refuse({**of_clips, "--free": stated.free}, "is about clips; --to takes the model of --phenomenon")
        _before_any_clip(camera.to, camera, stated.known, output, force, json)
    elif diagnosis is None or not clips:
        raise typer.BadParameter(
            "give a diagnosis and its clips (iris-sysid plan out/diagnosis out), or --phenomenon and --to"
        )
    else:
        from iris_sysid.cli import _own_equation, _records

        if stated.model or stated.equation or stated.bound:
            _own_equation.check_one(stated)
        _after_a_clip(diagnosis, clips, changes, stated, _records.checked(record), output, force, json)


def _after_a_clip(
    diagnosis: Path,
    clips: list[Path],
    changes: ChangeArguments,
    equation: EquationArguments,
    record: RecordArguments,
    output: Path | None,
    force: bool,
    json: bool,
) -> None:
    """Rank the changes, and weigh the effects with a new clip where there is one."""
    from iris_sysid.io.files import check_folder
    from iris_sysid.io.json_documents import document_text
    from iris_sysid.pipeline.clip_folders import tables_in

    if output is not None:
        check_folder(output, FILES, overwrite=force)
    clips = [table for clip in clips for table in tables_in(clip)]
    stated = _stated(changes.change)
    costs, errors = dict(map(_number, changes.cost)), dict(map(_error, changes.precise))
    document = _diagnosed(diagnosis)
    question = _question(document, tuple(changes.name), equation, clips[0], record)
    filmed = [] if changes.filmed is None else [changes.filmed]
    trajectories, new = (
        _as_diagnosed(
            _terminal.read_tables(tables, record, question.model),
            document,
            record.hold,
        )
        for tables in (clips, filmed)
    )
    # imported after the clips are read, so that an unreadable file is reported without delay
    from iris_sysid.diagnosis.planning.plan import plan as rank_changes
    from iris_sysid.report.plan_text import decision_text, needs_text, plan_document, plan_text

    only = [stated] if stated is not None and not new else None
    planned = rank_changes(question, trajectories, changes=only, costs=costs)
    wanted = _in_units(errors, planned)
    written = plan_document(planned, wanted)
    said = "\n".join([plan_text(planned), *(needs_text(planned, *each) for each in wanted.items())])
    if new:
        from iris_sysid.diagnosis.planning.decide import decide

        decision = decide(question, trajectories, new, stated or planned.named(changes.change).change)
        written = written.model_copy(update={"decision": dict(decision.probabilities)})
        said += f"\n{decision_text(decision)}"
    if output is not None:
        _write(planned, document_text(written), output, force)
    typer.echo(document_text(written).rstrip("\n") if json else said)


def _before_any_clip(
    to: str, camera: FilmingArguments, known: list[str], output: Path | None, force: bool, json: bool
) -> None:
    """Print the detection limits of the effect ``to``."""
    from iris_sysid.cli import _parsing
    from iris_sysid.io.files import check_folder, write_atomic
    from iris_sysid.io.json_documents import document_text
    from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA

    if output is not None:
        check_folder(output, FILES, overwrite=force)
    if camera.phenomenon is None:
        raise typer.BadParameter("--to needs --phenomenon")
    effect, _, size = to.partition("=")
    model = MODELS.named(PHENOMENA.named(camera.phenomenon).model)
    values = {name: given.value for name, given in _parsing.settings(known, model.units()).items()}
    from iris_sysid.diagnosis.planning.detection_limit import camera_limits
    from iris_sysid.report.plan_text import limits_document, limits_text

    limits = camera_limits(model, EFFECTS.named(effect), values, camera.distance, camera.fps, camera.noise_px)
    wanted = float(size) if size else None
    text = document_text(limits_document(limits))
    if output is not None:
        from iris_sysid.report.plan_figure import limits_figure

        write_atomic(output / FILES[0], text, overwrite=force)
        _terminal.draw(limits_figure(limits, wanted), output / FILES[1], overwrite=force)
    typer.echo(text.rstrip("\n") if json else limits_text(limits, wanted))


def _diagnosed(path: Path) -> "DiagnosisDocument":
    from iris_sysid.io.json_documents import read_document
    from iris_sysid.io.schemas import DiagnosisDocument

    return read_document(path / "diagnosis.json" if path.is_dir() else path, DiagnosisDocument)


def _as_diagnosed(clips: "list[Trajectory]", document: "DiagnosisDocument", hold: str) -> "list[Trajectory]":
    """The clips with the hold of their inputs: the stated one, or else that of the diagnosis."""
    from iris_sysid.cli import _records

    stated = _records.HOLDS[hold]
    found = stated if stated is not None else _records.recorded_hold(document.base.origin)
    return clips if found is None else [clip.with_(hold=found) for clip in clips]


def _question(
    document: "DiagnosisDocument",
    names: tuple[str, ...],
    stated: EquationArguments,
    clip: Path,
    record: RecordArguments,
) -> "Question":
    """What a diagnosis of a clip left open; ``names`` and the model and values ``stated`` replace those it had."""
    from dataclasses import replace

    from iris_sysid.cli import _model_choice, _parsing
    from iris_sysid.io.csv_read import read_trajectory
    from iris_sysid.io.table_headers import parse_columns

    if stated.model or stated.equation:
        model = _model_choice.stated_model(stated, None, [clip], record)[0]
    else:
        first = read_trajectory(clip, None if record.columns is None else parse_columns(record.columns))
        model = _model_choice.model_of_fit(document.base, first)
    asked = _asked(document, model)
    fixed = {**asked.fixed, **_parsing.settings(stated.known, model.units())}
    free = tuple(dict.fromkeys((*asked.free, *stated.free)))
    return replace(asked, names=names or asked.names, fixed=fixed, free=free)


def _asked(document: "DiagnosisDocument", model: "OdeModel") -> "Question":
    """The question that a diagnosis on disk leaves open: the added effect with the least certain name."""
    from iris_sysid.diagnosis.planning.rivals import Question, least_certain, shares_of

    values = document.base.parameters
    own = {parameter.name: parameter for parameter in model.parameters}
    fixed = {
        name: values[name].estimate()
        for name in own
        if name in values and name not in document.base.free and values[name].value not in (None, own[name].default)
    }
    free = tuple(name for name in own if name in document.base.free and own[name].constant)
    added = [each.effect for each in document.added]
    names, beside = least_certain(added, document.indistinguishable, document.probabilities)
    return Question(model, names, beside, fixed, free, shares_of(names, document.probabilities))


def _stated(text: str) -> "SetUpChange | None":
    """A change of a plan on disk, or another body by factors; None for the name of a change."""
    from iris_sysid.diagnosis.planning.changes import SetUpChange

    file, _, name = text.rpartition(":")
    if file:
        return _from_plan(Path(file), name)
    if "=" not in text:
        return None
    body = dict(_number(part) for part in text.split(","))
    if not body.keys() <= set(BODY):
        raise typer.BadParameter(f"--change {text}: give factors of {', '.join(BODY)}")
    return SetUpChange("another-body", f"another body: {text}", body=body)


def _from_plan(file: Path, name: str) -> "SetUpChange":
    from iris_sysid.io.json_documents import read_document
    from iris_sysid.io.schemas import PlanDocument
    from iris_sysid.report.plan_text import change_of

    return change_of(read_document(file, PlanDocument), name)


def _number(text: str) -> tuple[str, float]:
    """A name and a number above zero, from NAME=NUMBER."""
    name, _, number = text.rpartition("=")
    try:
        value = float(number)
    except ValueError:
        value = 0.0
    if not (name and 0 < value < float("inf")):
        raise typer.BadParameter(f"{text}: give NAME=NUMBER, with a number above zero")
    return name, value


def _error(text: str) -> tuple[str, tuple[float, bool]]:
    """A name, the error that is wanted, and whether that is a fraction of the value: ``gravity=0.1%``."""
    name, number = _number(text.removesuffix("%"))
    return name, (number / 100, True) if text.endswith("%") else (number, False)


def _in_units(errors: dict[str, tuple[float, bool]], planned: "Plan") -> dict[str, float]:
    """Errors in the unit of each value; of a value that is not there, planned says so."""
    values = planned.fitted.estimates
    return {
        name: error * abs(values[name].value) if relative and name in values else error
        for name, (error, relative) in errors.items()
    }


def _write(planned: "Plan", text: str, folder: Path, force: bool) -> None:
    from iris_sysid.io.files import write_atomic
    from iris_sysid.report.plan_figure import plan_figure

    write_atomic(folder / FILES[0], text, overwrite=force)
    if planned.best.differences:
        _terminal.draw(plan_figure(planned), folder / FILES[1], overwrite=force)
        typer.echo(f"picture: {folder / FILES[1]}", err=True)
