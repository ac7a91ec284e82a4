"""Terminal output of the commands: results to stdout, progress and warnings to stderr."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from iris_sysid.errors import IrisError, OutputError

if TYPE_CHECKING:
    from iris_sysid.types import FitResult, Trajectory


def check_outputs(source: Path, paths: Sequence[Path | None], *, overwrite: bool) -> None:
    """Raise OutputError before any work when a result could not be written, or would replace its own source.

    Parameters
    ----------
    source
        The file that the command reads.
    paths
        The files that it will write; None is ignored.
    overwrite
        Whether existing files other than the source may be replaced.
    """
    from iris_sysid.io.files import check_writable

    taken = {source.resolve(): "it is what is read"}
    for path in filter(None, paths):
        target = check_writable(path, overwrite=overwrite)
        if target in taken:
            raise OutputError(f"cannot write {path}: {taken[target]}; give another name")
        taken[target] = "two results would go there"


def check_suffix(path: Path | None, suffix: str) -> None:
    """Raise OutputError when the name of a result does not have the suffix of its format; None is ignored."""
    if path is not None and path.suffix.lower() != suffix:
        raise OutputError(f"cannot write {path}: it will be a {suffix} file; end its name with {suffix}")


def show_fit(fit: FitResult, trajectory: Trajectory, json: bool) -> None:
    """Print a fit to stdout: as fit.json, or as a small table.

    Parameters
    ----------
    fit
        The result.
    trajectory
        The fitted trajectory.
    json
        Print the content of fit.json.
    """
    from iris_sysid.io import json_documents
    from iris_sysid.report.text import fit_table

    typer.echo(json_documents.fit_json(fit, trajectory).rstrip("\n") if json else fit_table(fit))


def exit_unless_ok(fit: FitResult) -> None:
    """Raise IrisError when a fit has no estimates; warn on stderr when its status is not ok."""
    if not fit.usable:
        raise IrisError(f"the fit failed ({fit.status}): {fit.message}")
    if not fit.ok:
        typer.echo(f"warning: {fit.status}: {fit.message}", err=True)


def print_rows(rows: list[dict[str, Any]], json: bool) -> None:
    """Print rows of the same keys to stdout, in columns or as JSON."""
    if json:
        from iris_sysid.io.files import json_text

        typer.echo(json_text(rows).rstrip("\n"))
        return
    widths = {key: max(len(str(row[key])) for row in rows) for key in rows[0]} if rows else {}
    for row in rows:
        typer.echo("  ".join(f"{value!s:<{widths[key]}}" for key, value in row.items()).rstrip())


@contextmanager
def progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar on stderr while the block runs, when stderr is a terminal."""
    if not sys.stderr.isatty():
        yield lambda done, expected: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, expected: bar.update(task, completed=done, total=expected or None)


def one_line(text: str) -> str:
    """The text on one line, with control characters (possible in file names) shown as escapes."""
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in text)


def replace_unprintable() -> None:
    """Write ``?`` for characters that the terminal's encoding lacks (± in ASCII) instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
