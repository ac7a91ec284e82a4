"""Tables of the docs, written by the programs that measure them.

A page in ``docs/validation`` marks where a table belongs::

    <!-- table: coverage -->
    <!-- end -->

``python -m validation.coverage --write-docs`` puts its output between the two lines, below a line that names the
command, the commit and the date. So no number is copied by hand, and each table states its origin.
"""

from __future__ import annotations

import argparse
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
OPTION = "--write-docs"
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
    block = BLOCK.format(name=name, content=f"{header}\n\n{_separated(text)}\n")
    if names_in(path).count(name) != 1:
        raise LookupError(f"{path.name} needs one pair of lines <!-- table: {name} --> and <!-- end -->")
    after = ANY_BLOCK.sub(lambda match: block if match["name"] == name else match[0], before)
    path.write_text(after, encoding="utf-8")


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
