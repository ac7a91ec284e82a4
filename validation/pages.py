"""Tables of the docs, written by the programs that measure them.

A page in ``docs/validation`` marks where a table belongs::

    <!-- table: coverage -->
    <!-- end -->

``python -m validation.coverage --write-docs`` puts its output between the two lines, below a line that names the
command, the commit and the date. So no number is copied by hand, and each table states its origin. Each table goes to
``validation/results`` as CSV; the page shows it where it is short, and else leads to the file.
``python -m validation.pages`` does the same with tables that stand in a page in full.
"""

from __future__ import annotations

import argparse
import csv
import datetime
import io
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import TextIO

import pandas as pd

from iris_sysid.benchmark.tables.table import frame_table, render

ROOT = Path(__file__).parent.parent
PAGES = ROOT / "docs" / "validation"
RESULTS = ROOT / "validation" / "results"
OPTION = "--write-docs"
MAX_ROWS_SHOWN, MAX_LETTERS_SHOWN = 4, 300  # of a table that stands on its page
BLOCK = "<!-- table: {name} -->\n{content}<!-- end -->"
ANY_BLOCK = re.compile(r"<!-- table: (?P<name>[\w-]+) -->\n.*?<!-- end -->", re.DOTALL)


class _Tee(io.TextIOBase):
    """Stream that also keeps the text written to it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._kept = stream, io.StringIO()

    def write(self, text: str) -> int:
        self._stream.write(text)
        return self._kept.write(text)

    def flush(self) -> None:
        self._stream.flush()

    @property
    def text(self) -> str:
        return self._kept.getvalue()


def add_option(parser: argparse.ArgumentParser) -> None:
    """Give a program the option ``--write-docs``."""
    parser.add_argument(OPTION, action="store_true", help="also write the tables into docs/validation")


@contextmanager
def table(name: str, write_docs: bool) -> Iterator[None]:
    """Context that keeps the printed text, and at its end replaces the table of that name in its page.

    Parameters
    ----------
    name
        Name of the table, as in its marker.
    write_docs
        Whether to write the table.

    Raises
    ------
    LookupError
        Before anything is measured: when no page, or more than one, has the marker.
    """
    if not write_docs:
        yield
        return
    page, tee = page_with(name), _Tee(sys.stdout)
    with redirect_stdout(tee):
        yield
    write_table(page, name, tee.text, command_line())


def write_table(page: str | Path, name: str, text: str, command: str) -> None:
    """Replace a table of a page, with a line above it that states command, commit and date.

    Parameters
    ----------
    page
        File with the lines ``<!-- table: NAME -->`` and ``<!-- end -->``.
    name
        Name of the table.
    text
        Markdown; a blank line is put between a paragraph and a table where there is none.
    command
        Command that printed the text.

    Raises
    ------
    LookupError
        When the page has no such marker.
    """
    path = Path(page)
    before = path.read_text(encoding="utf-8")
    header = f"*`{command}`, commit {commit()}, {datetime.date.today().isoformat()}*"
    if names_in(path).count(name) != 1:
        raise LookupError(f"{path.name} needs one pair of lines <!-- table: {name} --> and <!-- end -->")
    block = BLOCK.format(name=name, content=f"{header}\n\n{stored(name, text)}\n")
    after = ANY_BLOCK.sub(lambda match: block if match["name"] == name else match[0], before)
    path.write_text(after, encoding="utf-8")
    _redraw(path.stem, name)


def stored(name: str, text: str, results: Path | None = None) -> str:
    """Write each Markdown table of a text as CSV, and give what its page shows: the text, with short tables in full.

    Parameters
    ----------
    name
        Of the file; a second table of the text goes to ``NAME-2.csv``.
    text
        Paragraphs and tables, as a program prints them.
    results
        Folder of the files; that of the project unless given.
    """
    folder, parts, number = RESULTS if results is None else results, [], 0
    folder.mkdir(exist_ok=True)
    for part in re.split(r"\n{2,}", _separated(text)):
        if not part.startswith("|"):
            parts.append(part)
            continue
        number += 1
        file = folder / (f"{name}.csv" if number == 1 else f"{name}-{number}.csv")
        rows = cells(part)
        with file.open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows(rows)
        is_short = len(rows) <= MAX_ROWS_SHOWN + 1 and len(part) <= MAX_LETTERS_SHOWN
        link = f"[{file.name}](../../validation/results/{file.name})"
        parts.append(f"{part}\n\n{link}" if is_short else f"{len(rows) - 1} rows: {link}")
    return "\n\n".join(parts)


def cells(table: str) -> list[list[str]]:
    """The cells of a Markdown table, header first; a bar that is escaped belongs to its cell."""
    lines = [line for line in table.splitlines() if not re.fullmatch(r"[|\s:-]+", line)]
    rows = [re.split(r"(?<!\\)\|", line.strip().removeprefix("|").removesuffix("|")) for line in lines]
    return [[cell.strip().replace("\\|", "|") for cell in row] for row in rows]


def store_all(pages: Path = PAGES, results: Path = RESULTS) -> None:
    """Write as CSV each table that stands in a page without its file, below the line that it has."""
    for path in sorted(pages.glob("*.md")):
        before = path.read_text(encoding="utf-8")
        after = ANY_BLOCK.sub(lambda match: _with_files(match, results), before)
        path.write_text(after, encoding="utf-8")


def _with_files(block: re.Match[str], results: Path) -> str:
    header, _, text = block[0].partition("\n")[2].removesuffix("<!-- end -->").partition("\n\n")
    if "/results/" in text:
        return block[0]
    return BLOCK.format(name=block["name"], content=f"{header}\n\n{stored(block['name'], text, results)}\n")


def _redraw(page: str, name: str) -> None:
    from validation import plots

    if page in plots.PLOTS and plots.PLOTS[page].table in (name, f"{name}-2"):
        plots.draw(page)


def page_with(name: str, pages: Path = PAGES) -> Path:
    """The one page that has the marker of a table; LookupError when none or several have it."""
    matches = [path for path in sorted(pages.glob("*.md")) if name in names_in(path)]
    if len(matches) != 1:
        where = ", ".join(path.name for path in matches) or "no page"
        raise LookupError(f"{where} of {pages.relative_to(ROOT)} has <!-- table: {name} -->; exactly one should")
    return matches[0]


def markdown(frame: pd.DataFrame) -> str:
    """A table of numbers and texts as Markdown, numbers to the right."""
    return render(frame_table(frame, ""), "markdown")


def names_in(page: Path) -> list[str]:
    """The names of the tables that a page has markers for, in order."""
    return [match["name"] for match in ANY_BLOCK.finditer(page.read_text(encoding="utf-8"))]


def commit() -> str:
    """The short hash of the commit that is checked out, ``+ changes`` when tracked files outside docs differ."""

    def git(*arguments: str) -> str:
        done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no", "--", ".", ":!docs")
        return git("rev-parse", "--short", "HEAD") + (" + changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def command_line(arguments: Sequence[str] | None = None) -> str:
    """The running command as typed, without ``--write-docs``; of an absolute path only the last part is kept."""
    specification = getattr(sys.modules["__main__"], "__spec__", None)
    module = specification.name.removesuffix(".__main__") if specification else Path(sys.argv[0]).name
    given = [word for word in (sys.argv[1:] if arguments is None else arguments) if word != OPTION]
    words = [Path(word).name if Path(word).is_absolute() else word for word in given]
    return shlex.join(["python", "-m", module, *words])


def _separated(text: str) -> str:
    """The text with a blank line before and after each Markdown table."""
    lines: list[str] = []
    for line in text.strip().splitlines():
        if lines and lines[-1] and line and lines[-1].startswith("|") != line.startswith("|"):
            lines.append("")
        lines.append(line)
    return "\n".join(lines)


if __name__ == "__main__":
    store_all()
