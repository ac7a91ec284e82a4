"""The option ``--each`` of ``diagnose``: every clip by itself, in several processes or on a cluster."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from iris_sysid.cli import _model_choice, _own_equation, _terminal
from iris_sysid.errors import DataError, IrisError

if TYPE_CHECKING:
    from iris_sysid.benchmark.diagnose_each import DiagnosisRequest
    from iris_sysid.types import ComponentKind, Effect, OdeModel

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


@dataclass(frozen=True, slots=True)
class EachRequest:
    """The options of ``diagnose``, as typed; ``own_files`` are the hashes of the user's files among them."""

    model: str | None
    phenomenon: str | None
    equation: str | None
    bound: Sequence[str]
    effect: Sequence[str]
    columns: str | None
    known: Sequence[str]
    free: Sequence[str]
    sensor: str | None
    holdout: float
    seconds: float | None = None
    keep_component: Sequence[ComponentKind] = ()
    own_files: Sequence[str] = ()
    hold: str = "auto"


def diagnose_clips(
    clips: Sequence[Path], output: Path, request: EachRequest, workers: int | str, *, force: bool, json: bool
) -> bool:
    """Diagnose every table of some paths by itself, and print the summary; whether all are good and complete.

    Parameters
    ----------
    clips
        Tables, folders of tables, folders of run.
    output
        Folder of the results.
    request
        Options of each diagnosis.
    workers
        Number of processes, or a scheduler.
    force
        Replace what no batch wrote.
    json
        Print the rows as JSON.
    """
    from iris_sysid.benchmark.clip_folders import is_dataset, tables_in
    from iris_sysid.benchmark.diagnose_each import COLUMNS, FAILED, INCOMPLETE, NamedTable, diagnose_each
    from iris_sysid.registry import EFFECTS

    data_sets = [path for path in clips if is_dataset(path)]
    if data_sets:
        raise DataError(f"{data_sets[0]} is a data set: measure it first (iris-sysid gt), then give folders of tables")
    effects = tuple(map(EFFECTS.named, request.effect))
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
            tell=lambda text: typer.echo(_terminal.one_line(text), err=True),
        )
    shown = COLUMNS if json else SHOWN
    _terminal.print_rows([{column: row[column] for column in shown} for row in rows], json, header=True)
    failures = sum(row["status"] == FAILED for row in rows)
    typer.echo(f"{output}: {len(rows)} clips, {failures} failed", err=True)
    return all(row["status"] == "good" and row["equation"] != INCOMPLETE for row in rows)


def limits(seconds: float | None, keep: Sequence[ComponentKind]) -> dict[str, Any]:
    """The arguments of :func:`iris_sysid.diagnose` for a limit in time and for parts to keep, where they are given."""
    given = {"seconds": seconds, "keep": tuple(keep)}
    return {name: value for name, value in given.items() if value}


def _name(table: Path) -> str:
    """Its file's name, or that of its folder of run."""
    from iris_sysid.benchmark.clip_folders import TRAJECTORY

    return table.parent.name if table.name == TRAJECTORY else table.stem


def _model_of_all(tables: Sequence[Path], request: EachRequest) -> Model | None:
    """The model that was named, with the constants estimated by default; None where each table has its own."""
    named = request.model or request.phenomenon
    if request.equation is not None:
        _own_equation.check_one(named, request.equation, request.bound)
        return None
    if request.model == _model_choice.AUTO:
        return None
    if named is None:
        for table in tables:
            with suppress(IrisError):  # of that table alone; a missing document is wrong usage
                _model_choice.model_of_runs([table])
        return None
    return _model_choice.stated_model(request.model, request.phenomenon, tables, request.columns)


def prepared(request: EachRequest, model: Model | None, effects: tuple[Effect, ...], table: Path) -> DiagnosisRequest:
    """Read a table, and give it the options of its diagnosis.

    Parameters
    ----------
    request
        The options as typed.
    model
        The model of all tables, with the constants estimated by default; None where each has its own.
    effects
        The user's own.
    table
        Its path.
    """
    from iris_sysid.benchmark.diagnose_each import DiagnosisRequest
    from iris_sysid.cli import _parsing, _records

    described, free_by_default = model or _model_of(table, request)
    (clip,) = _terminal.read_tables([table], request.columns, described)
    fixed = _parsing.settings(request.known, {} if described is None else described.units())
    stated = {*fixed, *clip.known}
    free = dict.fromkeys([*(name for name in free_by_default if name not in stated), *request.free])
    clip = _parsing.with_options(clip, **_options(request, described))
    sensor = _parsing.sensor(request.sensor)
    if sensor is not None:
        clip = clip.with_(sensor=sensor)
    if described is not None:
        (clip,) = _records.held([clip], described, request.hold, fixed=fixed, free=tuple(free))
    ends = limits(request.seconds, request.keep_component)
    return DiagnosisRequest(clip, described, fixed, tuple(free), effects, request.holdout, ends)


def _model_of(table: Path, request: EachRequest) -> tuple[OdeModel | None, Sequence[str]]:
    """The model of one table: an equation in its units, that of its run, or None for the one that the bank gives."""
    from iris_sysid.registry import MODELS

    if request.equation is not None:
        arguments = (request.equation, request.bound, request.known)
        return _own_equation.model_of(*arguments, table, request.columns), ()
    if request.model == _model_choice.AUTO:
        return None, ()
    return MODELS[_model_choice.model_of_runs([table])], ()


def _options(request: EachRequest, model: OdeModel | None) -> dict[str, object]:
    """What the diagnosis depends on beside the table, for its origin."""
    options = {item.name: getattr(request, item.name) for item in fields(request)}
    named = model.name if request.model is None and model is not None else request.model
    return {"set" if name == "known" else name: value for name, value in options.items()} | {"model": named}


def _own_files(request: EachRequest) -> list[str]:
    """The hash of each file of the user's that an option names."""
    from iris_sysid.io.files import sha256_of

    named = [text.rpartition(":")[0] for text in (request.model, request.phenomenon, *request.effect) if text]
    return [sha256_of(file) for file in named if file.endswith(".py")]
