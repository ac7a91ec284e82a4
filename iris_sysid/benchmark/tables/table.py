"""Tables as text: CSV, Markdown, LaTeX (booktabs) and HTML from the same cells."""

from __future__ import annotations

import csv
import html
import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from iris_sysid.benchmark.tables.summary import displayed, parameter_summary
from iris_sysid.errors import UnknownNameError
from iris_sysid.io.formula_cells import guarded


@dataclass(frozen=True, slots=True)
class Cell:
    """One cell: its text as it is shown, and whether it is bold."""

    text: str
    bold: bool = False


@dataclass(frozen=True, slots=True)
class Table:
    """A table ready to be written: a caption (may be empty), a header, rows of cells, and notes below.

    ``numeric`` names the columns that are aligned to the right.
    """

    caption: str
    header: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    numeric: frozenset[str] = frozenset()
    notes: tuple[str, ...] = ()


def frame_table(frame: pd.DataFrame, caption: str, *, notes: Sequence[str] = ()) -> Table:
    """Make a table of all columns with a caption above it and notes below, one per line.

    Numbers have three significant digits and are right-aligned.
    """
    numeric = frozenset(str(name) for name in frame.columns if pd.api.types.is_numeric_dtype(frame[name].dtype))
    rows = tuple(tuple(Cell(_text(value)) for value in row) for row in frame.itertuples(index=False, name=None))
    return Table(caption, tuple(map(str, frame.columns)), rows, numeric, tuple(notes))


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return displayed(value)
    return "" if value is None or value is pd.NA else str(value)


PARAMETER_HEADER = {
    "dataset": "data",
    "phenomenon": "phenomenon",
    "setting": "setting",
    "parameter": "parameter",
    "unit": "unit",
    "truth": "truth",
    "method": "method",
    "n": "n",
    "failed": "failed",
    "mean": "mean",
    "sd": "sd",
    "mae": "MAE",
    "mae_sd": "sd of error",
    "relative_percent": "MAE (%)",
    "beats_initial": "beats initial value",
}


def parameter_table(rows: pd.DataFrame, *, caption: str = "Parameter errors") -> Table:
    """Table of the errors of every method on every parameter, with null baselines.

    Bold is the smallest displayed MAE of a group (one data set, phenomenon, setting and parameter); equal displayed
    numbers are all bold, null baselines never. The data set is shown where there are several.
    """
    summary = parameter_summary(rows)
    names = [name for name in PARAMETER_HEADER if name != "dataset" or summary["dataset"].nunique() > 1]
    lines = tuple(
        tuple(Cell(_text(line[name]), bool(name == "mae" and line["best"])) for name in names)
        for line in summary.to_dict("records")
    )
    numeric = frozenset(PARAMETER_HEADER[name] for name in names if name in NUMERIC)
    return Table(caption, tuple(PARAMETER_HEADER[name] for name in names), lines, numeric, PARAMETER_NOTES)


NUMERIC = ("truth", "n", "failed", "mean", "sd", "mae", "mae_sd", "relative_percent")


PARAMETER_NOTES = (
    "MAE is the mean absolute error over the n values; failed runs are counted and in no mean.",
    "Bold: the smallest displayed MAE; null baselines, and methods scored on fewer clips, do not compete.",
    "Beats initial value: the displayed MAE is below that of the best start value left untrained.",
)


def render(table: Table, form: str) -> str:
    """Write a table as text in one of ``FORMATS``: ``csv``, ``markdown``, ``latex`` or ``html``.

    The same table gives the same text. Names are escaped for the format. Raises UnknownNameError for another form.
    """
    if form not in FORMATS:
        raise UnknownNameError(f"no table format {form!r}; there are {', '.join(FORMATS)}")
    return FORMATS[form](table)


# --------------------------------------------------------------------------- forms


def _csv(table: Table) -> str:
    """Cells as shown; where a table has bold, a last column ``bold`` names the columns that are."""
    marked = any(cell.bold for row in table.rows for cell in row)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*table.header, "bold"] if marked else table.header)
    for row in table.rows:
        bold = [name for name, cell in zip(table.header, row, strict=True) if cell.bold]
        writer.writerow([*(guarded(cell.text) for cell in row), *([" ".join(bold)] if marked else [])])
    return text.getvalue()


def _markdown(table: Table) -> str:
    rule = ["---:" if name in table.numeric else "---" for name in table.header]
    lines = [f"**{markdown_text(table.caption)}**", ""] if table.caption else []
    lines += [_pipes(map(markdown_text, table.header)), _pipes(rule)]
    lines += [_pipes(_emphasis(cell, markdown_text, "**", "**") for cell in row) for row in table.rows]
    return "\n".join([*lines, "", *(f"{markdown_text(note)}  " for note in table.notes)]).rstrip() + "\n"


def _pipes(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _emphasis(cell: Cell, escape: Callable[[str], str], before: str, after: str) -> str:
    text = escape(cell.text)
    return f"{before}{text}{after}" if cell.bold and text else text


def _latex(table: Table) -> str:
    columns = "".join("r" if name in table.numeric else "l" for name in table.header)
    head = " & ".join(map(latex_text, table.header)) + r" \\"
    body = [" & ".join(_emphasis(cell, latex_text, r"\textbf{", "}") for cell in row) + r" \\" for row in table.rows]
    notes = [rf"\par\noindent {latex_text(note)}" for note in table.notes]
    return "\n".join(
        [
            rf"\begin{{longtable}}{{@{{}}{columns}@{{}}}}",
            rf"\caption{{{latex_text(table.caption)}}} \\",
            *(r"\toprule", head, r"\midrule", r"\endhead"),
            *body,
            *(r"\bottomrule", r"\end{longtable}"),
            *notes,
            "",
        ]
    )


def _html(table: Table) -> str:
    style = {name: ' class="number"' if name in table.numeric else "" for name in table.header}
    head = "".join(f"<th{style[name]}>{html.escape(name)}</th>" for name in table.header)
    body = [
        "<tr>" + "".join(_html_cell(cell, style[name]) for name, cell in zip(table.header, row, strict=True)) + "</tr>"
        for row in table.rows
    ]
    notes = [f'<p class="dim">{html.escape(note)}</p>' for note in table.notes]
    caption = [f"<caption>{html.escape(table.caption)}</caption>"] if table.caption else []
    lines = ['<div class="scroll"><table>', *caption, f"<thead><tr>{head}</tr></thead>", "<tbody>", *body]
    return "\n".join([*lines, "</tbody></table></div>", *notes, ""])


def _html_cell(cell: Cell, style: str) -> str:
    return f"<td{style}>{_emphasis(cell, html.escape, '<strong>', '</strong>')}</td>"


def markdown_text(text: str) -> str:
    """Text escaped for Markdown, on one line."""
    return "".join(f"\\{letter}" if letter in "\\|*[]`<>" else letter for letter in " ".join(text.split()))


LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "–": "--",
    "±": r"$\pm$",
    **{letter: f"\\{letter}" for letter in "&%$#_{}"},
}


def latex_text(text: str) -> str:
    """Text escaped for LaTeX, on one line."""
    return "".join(LATEX.get(letter, letter) for letter in " ".join(text.split()))


FORMATS: Mapping[str, Callable[[Table], str]] = {"csv": _csv, "markdown": _markdown, "latex": _latex, "html": _html}
