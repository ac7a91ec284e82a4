"""Terminal output of the commands: results to stdout, progress and warnings to stderr."""

from __future__ import annotations

import io
import os
import shlex
import subprocess
import sys
import sysconfig
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from iris_sysid.errors import DataError, FitError, IrisError, OutputError, TrackingError
from iris_sysid.io.compiling import when_compiling

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from iris_sysid.cli.arguments import RecordArguments, WorkArguments
    from iris_sysid.types import FitResult, OdeModel, Track, Trajectory, Verdict

NOT_GOOD = 3  # exit status with --strict
FIRST_USE = "first use: compiling (up to a minute, kept for later)"
MAX_LINE = 4000  # characters of a message: names and cells of a damaged file can have megabytes


def check_sources(sources: Sequence[Path]) -> None:
    """Raise DataError before anything heavy is imported when a file to be read is not there."""
    for source in sources:
        within = Path(str(source).rpartition(":")[0])  # swings.xlsx:Sheet2, project.trz:NAME
        if not (source.exists() or within.is_file()):
            raise DataError(f"cannot read {source}: No such file or directory")


def check_dataset(folder: Path) -> None:
    """Raise DataError before anything heavy is imported when a data set is not a folder."""
    if not folder.is_dir():
        raise DataError(f"{folder} is not a folder that can be read; give the one that holds the classes")


def check_outputs(source: Path, paths: Sequence[Path | None], *, overwrite: bool) -> None:
    """Raise OutputError before any work when a result could not be written, or would replace its own source.

    A picture among the pictures that it is made from would be read as one of them next time. None is ignored.
    """
    from iris_sysid.io.files import check_writable

    taken = {source.resolve(): "it is what is read"}
    for path in filter(None, paths):
        target = check_writable(path, overwrite=overwrite)
        if target.parent in taken and target.suffix.lower() == ".png":
            raise OutputError(f"cannot write {path}: the pictures of the clip are there; give another folder")
        if target in taken:
            raise OutputError(f"cannot write {path}: {taken[target]}; give another name")
        taken[target] = "two results would go there"


def check_suffix(path: Path | None, suffix: str) -> None:
    """Raise OutputError when the name of a result does not have the suffix of its format; None is ignored."""
    if path is not None and path.suffix.lower() != suffix:
        raise OutputError(f"cannot write {path}: it will be a {suffix} file; end its name with {suffix}")


def read_tables(tables: Sequence[Path], record: RecordArguments, model: OdeModel | None = None) -> list[Trajectory]:
    """Read trajectories, and tell on stderr what was made of their columns and of clipped readings.

    The only quantity of the unit that ``model`` observes is taken for that quantity, whatever its name; positions x and
    z are taken for the angle or the distance that a phenomenon with that model sees in them.
    """
    from fitters.noise.clipped_readings import without_clipped
    from iris_sysid.io.csv_read import read_trajectory
    from iris_sysid.io.table_headers import parse_columns

    stated = None if record.columns is None else parse_columns(record.columns)
    clips = []
    for table in tables:
        read = read_trajectory(table, stated)
        clips.append(read if record.keep_clipped else without_clipped(read))
        for text in (*read.origin.get("read_as", ()), *clips[-1].origin.get("clipped_readings", ())):
            tell(f"{table}: {text}")
        if model is not None:
            clips[-1], text = model.taken_from(clips[-1])
            clips[-1], seen = from_positions(clips[-1], model)
            if text or seen:
                tell(f"{table}: {seen or text}")
            _check_quantities(clips[-1], model, table)
    return clips


def from_positions(clip: Trajectory, model: OdeModel) -> tuple[Trajectory, str]:
    """What a model observes of x and z, by its phenomenon or by the line or circle of the path, and that this was done.

    The trajectory as it is, and no text, where it already holds what the model observes.
    """
    from fitters.positions import along_path, observed_positions, phenomenon_of

    phenomenon = phenomenon_of(model, clip)
    seen = along_path(model, clip) if phenomenon is None else observed_positions(clip, phenomenon, clip.known)
    if seen is None:
        return clip, ""
    return seen, f"{', '.join(quantity.name for quantity in model.observed)} of the model {model.name} from x and z"


def _check_quantities(clip: Trajectory, model: OdeModel, table: Path) -> None:
    """Raise DataError with the option that names columns where what the model observes, or its input, is missing."""
    observed, given = ([each.name for each in some] for some in (clip.quantities, clip.input_quantities))
    lacks = [(model.observed, "observes", observed), (model.inputs, "is driven by", given)]
    for quantities, does, names in lacks:
        if any(quantity.name not in names for quantity in quantities):
            from iris_sysid.io.table_headers import columns_for

            raise DataError(
                f"{table}: model {model.name} {does} {', '.join(quantity.name for quantity in quantities)}, but the "
                f"table has {', '.join((*observed, *given))}: choose another --model, or say which columns they are",
                columns=columns_for(table, (*model.observed, *model.inputs)),
            )


def refuse(options: Mapping[str, object], reason: str) -> None:
    """Raise DataError, with the reason after its name, when one of the options was given."""
    for name, value in options.items():
        if value:
            raise DataError(f"{name} {reason}")


def workers_of(work: WorkArguments) -> int | str:
    """The processes that do the work: their number here, or a scheduler, whose workers are counted on stderr."""
    scheduler = work.scheduler
    if scheduler is None:
        return work.workers or 1
    if work.workers is not None:
        raise DataError("give --workers or --scheduler, not both: the workers of a scheduler are started apart")
    from iris_sysid.pipeline.cluster import connected

    with connected(scheduler) as client:
        count = len(client.nthreads())
    waiting = "" if count else "; the work begins with the first"
    tell(f"{scheduler}: {count} workers{waiting}")
    return scheduler


def quality_word(track: Track) -> str:
    """``good`` or ``doubtful``; empty where nothing judged the track."""
    if track.quality is None:
        return ""
    return "doubtful" if track.quality.doubtful else "good"


def show_fit(fit: FitResult, trajectory: Trajectory, json: bool) -> None:
    """Print a fit to stdout: as fit.json, or as a small table."""
    from iris_sysid.io import json_documents
    from iris_sysid.report.text import fit_table

    show_verdict(fit.verdict, json)
    typer.echo(json_documents.fit_json(fit, trajectory).rstrip("\n") if json else fit_table(fit))
    for note in fit.notes if not json else ():
        typer.echo(f"note: {one_line(note)}", err=True)


def show_verdict(verdict: Verdict, json: bool) -> None:
    """Print a verdict: on stdout, beside the result; beside JSON on stderr, where there is a result to doubt."""
    from iris_sysid.report.text import verdict_lines

    if not json or (verdict.word != "failed" and not (verdict.good and verdict.complete)):
        typer.echo("\n".join(map(one_line, verdict_lines(verdict))), err=json)


def draw(figure: Figure, picture: Path, *, overwrite: bool) -> None:
    """Write a figure as a PNG file."""
    from iris_sysid.io.files import write_atomic
    from iris_sysid.report.page import png_of

    write_atomic(picture, png_of(figure), overwrite=overwrite)


def suggest(*arguments: object, json: bool = False) -> None:
    """Print the next command to type on stderr; nothing beside JSON, which a program reads."""
    if not json:
        typer.echo(f"next: {command(*arguments)}", err=True)


@contextmanager
def by_hand(output: Path, source: Path, *options: object) -> Iterator[None]:
    """Have the message of a clip that no tracker follows end in the command that follows it by hand.

    ``output`` is the folder for the review; where it holds results of another run, the review is in one below it.
    """
    try:
        yield
    except TrackingError as error:
        from iris_sysid.review.opening import is_result

        folder = output / "review" if is_result(output) else output
        error.add_note(f"next: {command('review', source, *options, '-o', folder)}")
        raise


def command(*arguments: object) -> str:
    """A command of this program as it is typed, by the rules of the system's own shell."""
    texts = list(map(str, arguments))
    return f"iris-sysid {subprocess.list2cmdline(texts) if os.name == 'nt' else shlex.join(texts)}"


def repeated(option: str, values: Sequence[str] | None) -> list[str]:
    """An option that may be given several times, as typed."""
    return [text for value in values or () for text in (option, value)]


def error_text(error: IrisError) -> str:
    """The text of an error, with the options that help: for values that lack a start, for columns without a name."""
    if isinstance(error, DataError) and error.columns:
        return f'{error.text}, e.g. --columns "{error.typed_columns}"'
    starts = " ".join(f"--start-at {name}=VALUE" for name in (error.to_start if isinstance(error, FitError) else ()))
    return f"{error} ({starts})" if starts else str(error)


def place_of(error: Exception) -> str:
    """The file of the user's and the line in it where an error came from; empty where no such file took part."""
    packages = {Path(__file__).parents[1], *(Path(path) for path in sys.path if Path(path).name == "site-packages")}
    packages |= {Path(__file__).parents[2] / name for name in ("fitters", "trackers")}
    packages.add(Path(sysconfig.get_paths()["stdlib"]))
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        file = Path(frame.filename)
        if file.suffix == ".py" and file.is_file() and not any(package in file.parents for package in packages):
            return f" in {file}, line {frame.lineno}"
    return ""


def suggest_options(fit: FitResult) -> None:
    """Print the options that may help a fit that has problems on stderr."""
    known = [_that_states(name, fit) for problem in fit.problems for name in problem.to_set]
    starts = [f"--start-at {name}=VALUE" for problem in fit.problems for name in problem.to_start]
    for options in filter(None, (known, starts)):
        typer.echo(f"options that may help: {' or '.join(dict.fromkeys(options))}", err=True)


def _that_states(name: str, fit: FitResult) -> str:
    """The option that gives a value what it lacks: in px nobody knows it, but the motion may show it."""
    return f"--free {name}" if "px" in fit.model.units().get(name, "") else f"--set {name}=VALUE"


def check_usable(fit: FitResult) -> None:
    """Print the options that may help a fit with problems, and raise IrisError when it has no estimates."""
    suggest_options(fit)
    if not fit.usable:
        raise IrisError(f"the fit failed ({fit.status}): {fit.message}")


def end(verdict: Verdict, strict: bool) -> None:
    """Leave with exit status 3 when ``strict`` and the numbers are not good, or the equation is not complete."""
    if strict and not (verdict.good and verdict.complete):
        raise typer.Exit(NOT_GOOD)


def print_rows(rows: list[dict[str, Any]], json: bool, *, header: bool = False) -> None:
    """Print rows of the same keys to stdout, in columns, with the keys above them on request, or as JSON."""
    if json:
        from iris_sysid.io.files import json_text

        typer.echo(json_text(rows).rstrip("\n"))
        return
    if header and rows:
        rows = [{key: key for key in rows[0]}, *rows]
    widths = {key: max(len(str(row[key])) for row in rows) for key in rows[0]} if rows else {}
    for row in rows:
        typer.echo("  ".join(f"{value!s:<{widths[key]}}" for key, value in row.items()).rstrip())


@contextmanager
def progress(what: str, then: str = "") -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar on stderr while the block runs, when stderr is a terminal; it always moves.

    ``then`` says what follows in the same block when all is counted.
    """
    with _moving(what) as show:
        yield lambda done, expected: show(then, 0, 0) if then and 0 < expected <= done else show(what, done, expected)


@contextmanager
def phases(first: str, beside: str = "") -> Iterator[Callable[[str], None]]:
    """Show on stderr what is being done while the block runs, when stderr is a terminal; call it with each next step.

    ``beside`` is shown after each step, e.g. how to end the block.
    """
    after = f" ({beside})" if beside else ""
    with _moving(f"{first}{after}") as show:
        yield lambda text: show(f"{text}{after}", 0, 0)


@contextmanager
def _moving(first: str) -> Iterator[Callable[[str, int, int], None]]:
    """A line with a clock that runs by itself; to be called with the step, and what is done of what is expected."""
    if not sys.stderr.isatty():
        yield lambda text, done, expected: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    counts = (BarColumn(), TextColumn("{task.fields[count]}"))
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), *counts, TimeElapsedColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as line:
        task = line.add_task(first, total=None, count="")

        def show(text: str, done: int, expected: int) -> None:
            # a bar without a total moves; update() would keep the old one
            line.tasks[0].total = expected if done else None
            line.update(task, description=text, completed=done, count=f"{done}/{expected}" if done else "")

        with when_compiling(lambda: line.console.print(FIRST_USE, style="dim")):
            yield show


def lines(text: str) -> str:
    """The text with each of its lines as :func:`one_line` shows it."""
    return "\n".join(map(one_line, text.splitlines()))


def one_line(text: str) -> str:
    """The text on one line, its middle left out where it is very long, with control characters shown as escapes."""
    shown = text if len(text) <= MAX_LINE else f"{text[: MAX_LINE // 2]} ... {text[-MAX_LINE // 2 :]}"
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in shown)


def tell(text: str) -> None:
    """Print a text on one line of stderr."""
    typer.echo(one_line(text), err=True)


def replace_unprintable() -> None:
    """Write ``?`` for characters that the terminal's encoding lacks (± in ASCII) instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
