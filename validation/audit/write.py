"""Write the audit: `audit.csv` and `audit.md` in one folder."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from iris_sysid.benchmark.sources.latent import latent_rows
from iris_sysid.benchmark.sources.rows import flat_rows
from iris_sysid.benchmark.tables.summary import displayed
from iris_sysid.benchmark.tables.table import Table, frame_table, markdown_text, parameter_table, render
from iris_sysid.errors import DataError
from iris_sysid.io.files import check_writable, sha256_of, write_atomic
from validation.audit.evidence import Finding
from validation.audit.findings import findings
from validation.audit.folder import RUNS, PublishedFolder
from validation.audit.reproduce import DIFFERS, KINDS, NOT_DERIVABLE, REPRODUCED, audit, verdicts
from validation.audit.selection import SelectionScore, rescored_selection

NAMES = ("audit.csv", "audit.md")
TITLE = "Audit of the published benchmark numbers"
READING = (
    "'As stated' means the file and the formula that the publication names; the test split that it states was used for "
    "none of the errors (finding 12). An error file is a summary that the publication made itself. Every way that was "
    "tried, with both readings of alpha, is in audit.csv."
)


@dataclass(frozen=True, eq=False, slots=True)
class _Report:
    """Everything that the two files show, computed once."""

    rows: pd.DataFrame
    numbers: pd.DataFrame
    findings: list[Finding]
    parameters: Table
    selection: list[SelectionScore]
    gaps: list[str]
    files: Table


def write_audit(published_folder: str | Path, output_folder: str | Path, *, overwrite: bool = False) -> dict[str, Path]:
    """Derive the published numbers again and write the results.

    ``audit.csv`` holds every derivation of every number, ``audit.md`` the findings, the counts, the numbers that are
    not reproduced, the re-scored parameters and the re-scored selection. The same files give the same bytes.

    Parameters
    ----------
    published_folder
        Folder of the released result files.
    output_folder
        Made when it does not exist.
    overwrite
        Replace the files of an earlier audit.

    Returns
    -------
    dict
        The path of each file by its name.

    Raises
    ------
    DataError
        When the published folder does not exist, or holds no file that the audit knows. Single files that are
        absent or damaged are named in the report instead.
    OutputError
        When a file exists already or cannot be written; nothing is left half-written.
    """
    paths = {name: Path(output_folder) / name for name in NAMES}
    for path in paths.values():
        check_writable(path, overwrite=overwrite)
    report = _compute(PublishedFolder(published_folder))
    texts = (_csv(report.rows), _markdown(report))
    for path, text in zip(paths.values(), texts, strict=True):
        write_atomic(path, text, overwrite=overwrite)
    return paths


def _compute(folder: PublishedFolder) -> _Report:
    if not folder.present():
        raise DataError(
            f"{folder.path} holds none of the released files, e.g. {RUNS['iris_baseline']}; is it the folder?"
        )
    rows = audit(folder.path)
    flat, gaps = rescored_rows(folder)
    scores, unscored = rescored_selection(folder.path)
    return _Report(
        rows=rows,
        numbers=verdicts(rows),
        findings=findings(folder.path),
        parameters=parameter_table(flat, caption="Parameter errors, re-scored from the per-clip files"),
        selection=scores,
        gaps=[*gaps, *(folder.relative(gap) for gap in unscored)],
        files=_files(folder),
    )


def rescored_rows(folder: PublishedFolder) -> tuple[pd.DataFrame, list[str]]:
    """The flat rows of every per-clip file of ``folder`` that can be read, and one line on each that cannot.

    Duplicated and damaged runs are named among the lines too.
    """
    frames, gaps = [], []
    for name, path in RUNS.items():
        try:
            runs = folder.runs(name)
        except DataError as error:
            gaps.append(folder.relative(error))
            continue
        frames.append(latent_rows(runs, name, source=path))
        gaps += [
            f"{path} line {row['line']}: {row['message']}"
            for row in runs[runs["status"] == "damaged"].to_dict("records")
        ]
        copies = runs[runs["duplicate_of"].notna()]
        gaps += [f"{path} line {row['line']} repeats line {row['duplicate_of']}" for row in copies.to_dict("records")]
    return pd.concat(frames, ignore_index=True) if frames else flat_rows([]), gaps


def _files(folder: PublishedFolder) -> Table:
    present = [(path, sha256_of(folder.path / path)) for path in folder.present()]
    frame = pd.DataFrame([*present, *((path, "absent") for path in folder.absent())], columns=["file", "sha256"])
    return frame_table(frame, "Files")


def _csv(rows: pd.DataFrame) -> str:
    return rows.to_csv(index=False, lineterminator="\n")


# --------------------------------------------------------------------------- tables


def counts(numbers: pd.DataFrame) -> pd.DataFrame:
    """How many published numbers of each table are reproduced, and how; ``numbers`` come from :func:`verdicts`."""
    kind = numbers["way"].where(numbers["status"] == REPRODUCED, numbers["status"])
    ways = [f"{stated}, from {source}" for stated in ("as stated", "not as stated") for source in KINDS]
    order = [way for way in (*ways, "differs", NOT_DERIVABLE) if (kind == way).any()]
    table = pd.crosstab(numbers["place"], kind).reindex(index=numbers["place"].unique(), columns=order, fill_value=0)
    table.loc["all"] = table.sum()
    return table.reset_index(names="place")


def outcomes(numbers: pd.DataFrame) -> pd.DataFrame:
    """How many of all published numbers are reproduced, and how; ``numbers`` come from :func:`verdicts`."""
    total = counts(numbers).iloc[-1].drop("place")
    names = [way if way in (DIFFERS, NOT_DERIVABLE) else f"reproduced, {way}" for way in total.index]
    return pd.DataFrame({"outcome": names, "numbers": total.to_numpy(dtype=int)})


def unreproduced(numbers: pd.DataFrame) -> pd.DataFrame:
    """The numbers that a released run or prediction does not give as stated; ``numbers`` come from :func:`verdicts`."""
    reproduced = numbers["status"] == REPRODUCED
    plain = reproduced & numbers["as_stated"] & numbers["kind"].isin(("result files", "printed numbers", "metadata"))
    truth = reproduced & (numbers["column"] == "truth")
    return numbers[~plain & ~truth & (numbers["status"] != NOT_DERIVABLE)]


def _number_table(numbers: pd.DataFrame, caption: str) -> Table:
    """The numbers with their derived values and status; a column names the table or section where there are several."""
    whose = numbers["phenomenon"].where(numbers["phenomenon"] != "all", numbers["dataset"])
    shown = pd.DataFrame(
        {
            "place": numbers["place"],
            "line": numbers["line"],
            "row": _joined(numbers.assign(phenomenon=whose)[["phenomenon", "setting", "parameter"]], "/"),
            "column": numbers["column"],
            "printed": numbers["printed"],
            "derived": [_one_digit_more(*pair) for pair in zip(numbers["derived"], numbers["printed"], strict=True)],
            "unit": numbers["unit"],
            "verdict": _joined(numbers[["status", "way"]], ", "),
            "failed": numbers["n_failed"],
            "set to 0": numbers["n_zero"],
            "how": _joined(numbers[["source", "conversion", "rule", "split", "note"]], "; "),
        }
    )
    return frame_table(shown if numbers["place"].nunique() > 1 else shown.drop(columns="place"), caption)


def _one_digit_more(derived: float, printed: str) -> str:
    """The derived number with one digit more than the printed one, to show the rounding."""
    if not math.isfinite(derived) or not re.fullmatch(r"[+-]?\d+(\.\d+)?", printed):
        return displayed(derived)
    return f"{derived:.{len(printed.partition('.')[2]) + 1}f}"


def _joined(texts: pd.DataFrame, between: str) -> list[str]:
    """The texts of each row that are not empty, joined."""
    return [between.join(filter(None, row)) for row in texts.itertuples(index=False, name=None)]


def _selection_table(scores: list[SelectionScore]) -> Table:
    lines = [
        {
            "data set": score.dataset,
            "method": score.method,
            "n": score.n,
            "right": score.correct,
            "accuracy (%)": f"{100 * score.accuracy:.2f}",
            "95 % interval": f"{100 * score.interval[0]:.1f} to {100 * score.interval[1]:.1f}",
            "flags that disagree": score.relabelled,
            "file": score.source,
        }
        for score in scores
    ]
    return frame_table(pd.DataFrame(lines), "Equation selection, re-scored from the per-video predictions")


def _confusion_tables(scores: list[SelectionScore]) -> Iterator[Table]:
    for score in scores:
        per_class = score.per_class["accuracy"].map(lambda share: f"{100 * share:.0f}")
        frame = score.confusion.assign(**{"right (%)": per_class}).reset_index(names="true class")
        yield frame_table(frame, f"{score.method} on {score.dataset}: true class down, answer across")


def _summary(report: _Report) -> str:
    status = report.numbers["status"].value_counts()
    stated = int(((report.numbers["status"] == REPRODUCED) & report.numbers["as_stated"]).sum())
    return (
        f"{len(report.numbers)} published numbers: {status.get(REPRODUCED, 0)} reproduced ({stated} in the way that "
        f"the publication states), {status.get('differs', 0)} differ, {status.get(NOT_DERIVABLE, 0)} cannot be derived."
    )


def _sources(finding: Finding) -> str:
    return "Files: " + ", ".join(finding.sources) if finding.sources else "Files: all"


# --------------------------------------------------------------------------- page


def _markdown(report: _Report) -> str:
    parts = [f"# {TITLE}\n", f"{_summary(report)}\n", f"{READING}\n", "## Findings\n"]
    for finding in report.findings:
        parts += [
            f"### {finding.point}. {markdown_text(finding.title)}: {finding.verdict}\n",
            f"{markdown_text(finding.statement)}\n",
        ]
        parts += [render(frame_table(finding.evidence, ""), "markdown")] if len(finding.evidence) else []
        parts.append(f"{markdown_text(_sources(finding))}\n")
    parts += ["## Numbers\n", render(frame_table(counts(report.numbers), "How each table is reproduced"), "markdown")]
    parts.append(
        render(_number_table(unreproduced(report.numbers), "Numbers that differ, or come about otherwise"), "markdown")
    )
    parts += ["## Parameters\n", render(report.parameters, "markdown"), "## Selection\n"]
    parts.append(render(_selection_table(report.selection), "markdown"))
    parts += [render(table, "markdown") for table in _confusion_tables(report.selection)]
    parts += ["## Gaps\n", "\n".join(f"- {markdown_text(gap)}" for gap in report.gaps) or "none", ""]
    return "\n".join([*parts, render(report.files, "markdown")])
