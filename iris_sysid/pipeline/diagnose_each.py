"""Diagnose many clips, each by itself: a folder with a page for each, and one table of all."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from iris_sysid.errors import DataError, FitError, IrisError, OutputError
from iris_sysid.io.files import check_folder, write_atomic
from iris_sysid.io.formula_cells import guarded
from iris_sysid.io.json_documents import plain_origin, read_document
from iris_sysid.io.schemas import DiagnosisDocument
from iris_sysid.pipeline.batch import Batch
from iris_sysid.pipeline.parallel import Workers, check_workers, run_parallel
from iris_sysid.report.diagnosis_files import FILES
from iris_sysid.types import Effect, Estimate, OdeModel, Progress, Trajectory, with_progress

SUMMARY = "summary.csv"
DOCUMENT, PAGE = "diagnosis.json", "report.html"  # of each clip; the page is written last
COLUMNS = (
    "clip",
    "status",
    "equation",
    "model",
    "effects",
    "causes",
    "before",
    "after",
    "noise_floor",
    "unit",
    "message",
)
FAILED = "failed"
COMPLETE, INCOMPLETE = "complete", "incomplete"

Row = dict[str, str]


@dataclass(frozen=True, slots=True)
class NamedTable:
    """A table to diagnose, and the name of the folder of its results."""

    name: str
    path: Path


@dataclass(frozen=True, eq=False, slots=True)
class DiagnosisRequest:
    """One clip as it is to be diagnosed; its origin holds everything that the result depends on.

    ``model`` is None where it is chosen from the bank; ``effects`` are tried beside those of the library. ``limits``
    are further arguments of :func:`iris_sysid.diagnose`, such as a time after which the search ends.
    """

    clip: Trajectory
    model: OdeModel | None
    fixed: Mapping[str, Estimate] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()
    holdout: float = 0.3
    limits: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class DiagnoseEach:
    """The work on each table: ``prepare(path)`` reads it in the process that diagnoses it."""

    prepare: Callable[[Path], DiagnosisRequest]

    def __call__(self, folder: Path, table: NamedTable) -> str:
        """Diagnose a table and write its files below a folder; returns the reason of a failure, else empty."""
        try:
            request = self.prepare(table.path)
            if not _is_done(folder / table.name, request.clip):
                _diagnose(request, table.path, folder / table.name)
        except OutputError:
            raise
        except IrisError as error:
            return str(error)
        except Exception as error:  # one clip must not end the run of all
            return f"unexpected {type(error).__name__}: {error}"
        return ""


def diagnose_each(
    tables: Sequence[NamedTable],
    prepare: Callable[[Path], DiagnosisRequest],
    folder: str | Path,
    *,
    workers: Workers = 0,
    overwrite: bool = False,
    progress: Progress | None = None,
    tell: Callable[[str], None] | None = None,
) -> list[Row]:
    """Diagnose every table by itself, and write ``<name>/diagnosis.json``, its page, and ``summary.csv``.

    A table whose file, options and package versions are those of an earlier diagnosis in the folder is not diagnosed
    again, also after an interrupted run. The same input gives the same bytes.

    Parameters
    ----------
    tables
        No two have the same name.
    prepare
        Reads a table; another process can import it. An IrisError makes the table a failed row.
    folder
        Made when missing; of this and earlier batches alone.
    workers
        Number of parallel processes, 0 for this one, or the address or file of a dask scheduler, whose workers find the
        tables and the folder under the same absolute paths.
    overwrite
        Write into a folder that holds diagnoses but no summary of a batch.
    progress
        Called with (clips done, total number of clips).
    tell
        Called with one line per clip that failed.

    Returns
    -------
    list of dict
        One row for each table, by its name, as in the summary: ``status`` is the word of the verdict, or ``failed``,
        ``equation`` whether it is complete.

    Raises
    ------
    DataError
        When two tables have the same name, or the number of workers is out of range.
    OutputError
        When a file cannot be written.
    """
    root, reasons = Path(folder), {table.name: "not diagnosed: the run was interrupted" for table in tables}
    check_workers(workers)
    _check_names([table.name for table in tables])
    if not (root / SUMMARY).is_file():
        for table in tables:
            check_folder(root / table.name, FILES, overwrite=overwrite)
    batch = Batch(root, DiagnoseEach(prepare), _lost)
    try:
        _write_summary(root, [])
        for table, reason in with_progress(run_parallel(batch, tables, workers), progress, len(tables)):
            reasons[table.name] = reason
            if reason and tell is not None:
                tell(f"{table.name}: {reason}")
    finally:
        rows = [_row(root, name, reason) for name, reason in sorted(reasons.items())]
        _write_summary(root, rows)
    return rows


def _check_names(names: Sequence[str]) -> None:
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise DataError(f"two tables are called {twice[0]!r}, which would be one folder; rename one")


def _is_done(folder: Path, clip: Trajectory) -> bool:
    """Whether an earlier run diagnosed this clip with these options."""
    try:
        return read_document(folder / DOCUMENT, DiagnosisDocument).origin == plain_origin(clip.origin)
    except IrisError:
        return False


def _lost(folder: Path, table: NamedTable) -> str:
    return "the process that diagnosed it died; is there enough memory?"


def _diagnose(request: DiagnosisRequest, table: Path, folder: Path) -> None:
    from iris_sysid.diagnosis.diagnose import diagnose
    from iris_sysid.registry import EFFECTS
    from iris_sysid.report.diagnosis_page import write_diagnosis
    from iris_sysid.report.film import footage_of_table

    (folder / DOCUMENT).unlink(missing_ok=True)  # a document that is there belongs to the page beside it
    diagnosis = diagnose(
        request.clip,
        _chosen(request.clip) if request.model is None else request.model,
        fixed=request.fixed,
        free=request.free,
        effects=[*EFFECTS.values(), *request.effects],
        holdout=request.holdout,
        **request.limits,
    )
    write_diagnosis(diagnosis, request.clip, folder, footage=footage_of_table(table, request.clip), overwrite=True)


def _chosen(clip: Trajectory) -> OdeModel:
    from fitters.selection.select import select_model
    from iris_sysid.registry import MODELS

    choice = select_model(clip)
    if choice.chosen is None:
        raise FitError(f"{choice.message}; name a model")
    return MODELS[choice.chosen.model]


# --------------------------------------------------------------------------- summary


def _write_summary(root: Path, rows: Sequence[Row]) -> None:
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows({column: guarded(value) for column, value in row.items()} for row in rows)
    write_atomic(root / SUMMARY, text.getvalue(), overwrite=True)


def _row(root: Path, name: str, reason: str) -> Row:
    """The row of one table, from its document where it was diagnosed."""
    if reason:
        return dict.fromkeys(COLUMNS, "") | {"clip": name, "status": FAILED, "message": reason}
    document = read_document(root / name / DOCUMENT, DiagnosisDocument)
    return {
        "clip": name,
        "status": "" if document.verdict is None else document.verdict.word,
        "equation": _equation(document),
        "model": document.base.model,
        "effects": " + ".join(added.effect for added in document.added),
        "causes": _causes(document),
        "before": _text(document.before.heldout),
        "after": _text(document.after.heldout),
        "noise_floor": _text(document.noise_floor),
        "unit": document.unit,
        "message": document.sentence,
    }


def _equation(document: DiagnosisDocument) -> str:
    equation = None if document.verdict is None else document.verdict.equation
    return "" if equation is None else COMPLETE if equation.complete else INCOMPLETE


def _causes(document: DiagnosisDocument) -> str:
    """The share of the residual on each side, largest first; of a clip that is too short for that, likeliest causes."""
    if document.components is None:
        shares = [document.causes.get(added.effect, {}) for added in document.added]
        return " + ".join(dict.fromkeys(max(share, key=lambda cause: share[cause]) for share in shares if share))
    sides: dict[str, float] = {}
    for part in document.components.parts:
        sides[part.side] = sides.get(part.side, 0.0) + (part.share or 0.0)
    return " + ".join(f"{side} {100 * sides[side]:.0f} %" for side in sorted(sides, key=lambda side: -sides[side]))


def _text(number: float | None) -> str:
    return "" if number is None else repr(number)
