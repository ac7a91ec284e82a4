"""Write the benchmark: every table of the flat rows as CSV, Markdown, LaTeX and HTML, in one folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd

from iris_sysid.benchmark.sources.rows import OK, rows_text
from iris_sysid.benchmark.tables.all_tables import tables_of
from iris_sysid.benchmark.tables.table import Table, markdown_text, render
from iris_sysid.io.files import check_folder, json_text, write_atomic

TITLE = "Benchmark"
PAGES = ("rows.csv", "benchmark.md", "benchmark.tex", "benchmark.html", "manifest.json")
FOLDED = ("parameters", "confusion", "failures")  # long tables, collapsed on the page


def write_pages(
    rows: pd.DataFrame,
    folder: str | Path,
    *,
    gaps: Sequence[str] = (),
    manifest: Mapping[str, Any] | None = None,
    overwrite: bool = False,
) -> dict[str, Path]:
    """Write the flat rows, all their tables, and the page; the same rows give the same bytes.

    Parameters
    ----------
    rows
        Flat rows.
    folder
        Gets ``rows.csv``, ``benchmark.md``, ``benchmark.tex``, ``benchmark.html``, ``manifest.json`` and
        ``tables/<name>.csv``.
    gaps
        Missing parts, one line each.
    manifest
        The origin of the rows.
    overwrite
        Replace the files of an earlier run.

    Returns
    -------
    dict
        The path of each file by its name in the folder.

    Raises
    ------
    OutputError
        When a file exists or cannot be written.
    DataError
        When the rows are not flat rows.
    """
    folder = check_folder(folder, PAGES, overwrite=overwrite)
    tables = tables_of(rows)
    texts = {
        "manifest.json": json_text(manifest or {}),  # first: it tells a run after a kill that the folder is its own
        "rows.csv": rows_text(rows),
        "benchmark.md": _markdown(rows, tables, gaps),
        "benchmark.tex": _latex(tables),
        "benchmark.html": _html(rows, tables, gaps, manifest or {}),
        **{f"tables/{file_name(name)}.csv": render(table, "csv") for name, table in tables.items()},
    }
    return {name: write_atomic(folder / name, text, overwrite=overwrite) for name, text in texts.items()}


def file_name(table: str) -> str:
    """The file name of a table: letters, digits and hyphens."""
    return "".join(letter if letter.isalnum() else "-" for letter in table.lower()).strip("-")


def summary_of(rows: pd.DataFrame) -> str:
    """One sentence with the numbers of rows, methods and phenomena in flat ``rows``."""
    failed = int(rows["value"].isna().sum())
    kept = int(((rows["status"] != OK) & rows["value"].notna()).sum())
    return (
        f"{len(rows)} rows of {rows['method'].nunique()} methods on {rows['phenomenon'].nunique()} phenomena; "
        f"{failed} have no value, {kept} have one with a reservation. Every table is made from rows.csv alone."
    )


def _markdown(rows: pd.DataFrame, tables: Mapping[str, Table], gaps: Sequence[str]) -> str:
    parts = [f"# {TITLE}\n", f"{summary_of(rows)}\n"]
    for name, table in tables.items():
        parts += [f"## {markdown_text(name.capitalize())}\n", render(table, "markdown")]
    if gaps:
        parts += ["## Gaps\n", "\n".join(f"- {markdown_text(gap)}" for gap in gaps), ""]
    return "\n".join(parts)


def _latex(tables: Mapping[str, Table]) -> str:
    head = "% needs \\usepackage{booktabs,longtable}; wide tables: \\usepackage{pdflscape}, or a smaller font\n"
    return head + "\n".join(render(table, "latex") for table in tables.values())


def _html(rows: pd.DataFrame, tables: Mapping[str, Table], gaps: Sequence[str], manifest: Mapping[str, Any]) -> str:
    page = jinja2.Environment(loader=jinja2.PackageLoader("iris_sysid.benchmark.tables", "templates"), autoescape=True)
    shown = [(name, render(table, "html"), name.startswith(FOLDED)) for name, table in tables.items()]
    return page.get_template("benchmark.html").render(
        title=TITLE,
        summary=summary_of(rows),
        tables=shown,
        gaps=list(gaps),
        manifest=json_text(manifest),
    )
