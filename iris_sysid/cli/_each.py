"""The option ``--each`` of ``diagnose``: every clip by itself, in several processes or on a cluster."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from iris_sysid.cli import _completion, _model_choice, _own_equation, _terminal
from iris_sysid.cli._groups import typed
from iris_sysid.cli.arguments import EquationArguments, RecordArguments
from iris_sysid.errors import DataError, IrisError

if TYPE_CHECKING:
    from iris_sysid.pipeline.diagnose_each import DiagnosisRequest
    from iris_sysid.types import Effect, OdeModel

    Model = tuple[OdeModel, Sequence[str]]

SHOWN = (
    "clip",
    "status",
    "equation",
    "effects",
    "causes",
    "before",
    "after",
    "unit",
)  # on the terminal; all are in the file


@dataclass(frozen=True)
class SearchArguments:
    """What is searched for in the residual, and for how long."""

    phenomenon: Annotated[
        str | None,
        typer.Option(
            "--phenomenon",
            help="What is filmed, for its model; see list. Or FILE.py:NAME.",
            autocompletion=_completion.phenomena,
        ),
    ] = None
    effect: Annotated[list[str], typer.Option("--effect", help="Try your own effect as well: FILE.py:NAME.")] = field(
        default_factory=list
    )
    sensor: Annotated[
        str | None,
        typer.Option(
            help="What measured: camera, encoder, gauge or unknown; only a camera has its effects.",
            autocompletion=_completion.values("camera", "encoder", "gauge", "unknown"),
        ),
    ] = None
    holdout: Annotated[float, typer.Option(help="Fraction of each clip held out for validation.", min=0.0, max=0.9)] = (
        0.3
    )
    seconds: Annotated[
        float | None, typer.Option(help="Time for the search, in s: the best answer by then, with a note.", min=1.0)
    ] = None
    keep_component: Annotated[
        list[str],
        typer.Option(
            "--keep-component",
            help="Keep this part of the residual as an effect: zero-wander. The error after is with it.",
        ),
    ] = field(default_factory=list)

    def limits(self) -> dict[str, Any]:
        """The arguments of :func:`iris_sysid.diagnose` for a limit in time and for parts to keep, where given."""
        from iris_sysid.cli import _parsing

        given = {"seconds": self.seconds, "keep": _parsing.components(self.keep_component)}
        return {name: value for name, value in given.items() if value}


@dataclass(frozen=True, slots=True)
class EachRequest:
    """The options of ``diagnose``, as typed; ``own_files`` are the hashes of the user's files among them."""

    stated: EquationArguments
    record: RecordArguments = field(default_factory=RecordArguments)
    search: SearchArguments = field(default_factory=SearchArguments)
    own_files: Sequence[str] = ()


def diagnose_clips(
    clips: Sequence[Path], output: Path, request: EachRequest, workers: int | str, *, force: bool, json: bool
) -> bool:
    """Diagnose every table of some paths by itself, and print the summary; whether all are good and complete."""
    from iris_sysid.pipeline.clip_folders import is_dataset, tables_in
    from iris_sysid.pipeline.diagnose_each import COLUMNS, FAILED, INCOMPLETE, NamedTable, diagnose_each
    from iris_sysid.registry import EFFECTS

    data_sets = [path for path in clips if is_dataset(path)]
    if data_sets:
        raise DataError(f"{data_sets[0]} is a data set: measure it first (iris-sysid gt), then give folders of tables")
    request.search.limits()  # refuses an unknown part before any work
    effects = tuple(map(EFFECTS.named, request.search.effect))
    tables = [table.absolute() for path in clips for table in tables_in(path)]
    model = _model_of_all(tables, request)
    request = replace(request, own_files=_own_files(request))
    with _terminal.progress("diagnosing clips") as report_progress:
        rows = diagnose_each(
            [NamedTable(_name(table), table) for table in tables],
            partial(prepared, request, model, effects),
            output,
            workers=workers,
            overwrite=force,
            progress=report_progress,
            tell=_terminal.tell,
        )
    shown = COLUMNS if json else SHOWN
    _terminal.print_rows([{column: row[column] for column in shown} for row in rows], json, header=True)
    failures = sum(row["status"] == FAILED for row in rows)
    typer.echo(f"{output}: {len(rows)} clips, {failures} failed", err=True)
    return all(row["status"] == "good" and row["equation"] != INCOMPLETE for row in rows)


def _name(table: Path) -> str:
    """Its file's name, or that of its folder of run."""
    from iris_sysid.pipeline.clip_folders import TRAJECTORY

    return table.parent.name if table.name == TRAJECTORY else table.stem


def _model_of_all(tables: Sequence[Path], request: EachRequest) -> Model | None:
    """The model that was named, with the constants estimated by default; None where each table has its own."""
    stated, phenomenon = request.stated, request.search.phenomenon
    if stated.equation is not None:
        _own_equation.check_one(stated, phenomenon)
        return None
    if stated.model == _model_choice.AUTO:
        return None
    if (stated.model or phenomenon) is None:
        for table in tables:
            with suppress(IrisError):  # of that table alone; a missing document is wrong usage
                _model_choice.model_of_runs([table])
        return None
    return _model_choice.stated_model(stated, phenomenon, tables, request.record)


def prepared(request: EachRequest, model: Model | None, effects: tuple[Effect, ...], table: Path) -> DiagnosisRequest:
    """Read a table, and give it the options of its diagnosis.

    ``model`` is that of all tables, with the constants estimated by default; None where each has its own.
    """
    from iris_sysid.cli import _parsing, _records
    from iris_sysid.pipeline.diagnose_each import DiagnosisRequest

    stated, record, search = request.stated, request.record, request.search
    described, free_by_default = model or _model_of(table, request)
    (clip,) = _terminal.read_tables([table], record, described)
    fixed = _parsing.settings(stated.known, {} if described is None else described.units())
    known = {*fixed, *clip.known}
    free = dict.fromkeys([*(name for name in free_by_default if name not in known), *stated.free])
    options = typed(stated, record, search, own_files=request.own_files)
    if stated.model is None and described is not None:
        options["model"] = described.name
    clip = _parsing.with_options(clip, **options)
    sensor = _parsing.sensor(search.sensor)
    if sensor is not None:
        clip = clip.with_(sensor=sensor)
    if described is not None:
        (clip,) = _records.held([clip], described, record.hold, fixed=fixed, free=tuple(free))
    return DiagnosisRequest(clip, described, fixed, tuple(free), effects, search.holdout, search.limits())


def _model_of(table: Path, request: EachRequest) -> tuple[OdeModel | None, Sequence[str]]:
    """The model of one table: an equation in its units, that of its run, or None for the one that the bank gives."""
    from iris_sysid.registry import MODELS

    stated = request.stated
    if stated.equation is not None:
        return _own_equation.model_of(stated, table, request.record.columns), ()
    if stated.model == _model_choice.AUTO:
        return None, ()
    return MODELS[_model_choice.model_of_runs([table])], ()


def _own_files(request: EachRequest) -> list[str]:
    """The hash of each file of the user's that an option names."""
    from iris_sysid.io.files import sha256_of

    texts = (request.stated.model, request.search.phenomenon, *request.search.effect)
    named = [text.rpartition(":")[0] for text in texts if text]
    return [sha256_of(file) for file in named if file.endswith(".py")]
