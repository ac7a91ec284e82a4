"""The command line: each command is one step of the pipeline and calls the library.

Results go to files and, with ``--json``, to stdout; progress goes to stderr. Exit status: 0 done,
1 a reported failure, 2 wrong usage, 3 with ``--strict`` numbers that are not good or an equation that is
not complete. A command's module is imported when the command is called, and slow imports are made inside
the command that needs them.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_origin, get_type_hints

import typer
from typer.core import TyperGroup
from typer.models import OptionInfo

if TYPE_CHECKING:
    from typer._click import Context, HelpFormatter
    from typer._click.core import Command

# Every command in the order of the help: its module (with a function of the same name), and its sentence in the help.
# A test checks that the sentences equal the first sentences of the functions' docstrings.
COMMANDS = {
    "run": ("run", "Measure one clip: follow the body, fit its equation, write a report."),
    "review": ("review", "Correct a track in the browser, frame by frame, and see the fit follow."),
    "calibrate": ("calibrate", "Calibrate camera and plane of motion."),
    "frame": ("frame", "Draw one frame of a clip with a grid of pixel coordinates, for marks, scale bars and regions."),
    "track": ("track", "Follow bodies through a clip."),
    "import": ("import_marks", "Import the marks of an OSP Tracker project."),
    "smooth": ("smooth", "Smooth a trajectory and add its velocities."),
    "fit": ("fit", "Fit a governing equation to a trajectory."),
    "diagnose": (
        "diagnose",
        "Find what a governing equation lacks: the parts of its residual, the effects, the error before and after.",
    ),
    "sealed": (
        "sealed",
        "Keep a test record sealed while a model is searched: each look at it is counted and logged.",
    ),
    "plan": (
        "plan",
        "Rank what to film next: how likely each change of the set-up tells the possible effects apart.",
    ),
    "class": (
        "class_",
        "Compare the groups of a class: each group's value, what is wrong with those that stand out, the value of all.",
    ),
    "discover": ("discover", "Find the governing equation itself, with error bars on its terms, and its name."),
    "petab": ("petab", "Exchange a model and its table with other estimation programs as a PEtab problem."),
    "render": (
        "render",
        "Render a synthetic clip, or a whole synthetic data set, and write its exact truth beside it.",
    ),
    "demo": ("demo", "Render a clip with a hidden effect, find the effect, and compare all estimates with the truth."),
    "gt": (
        "gt",
        "Measure the ground truth of a data set: one value of each parameter and setting, beside direct measurements.",
    ),
    "benchmark": ("benchmark", "Compare methods on a data set: one table of rows, all benchmark tables from it."),
    "list": ("list_names", "List phenomena, models, effects, trackers with their stages, and scenes."),
    "schema": ("schema", "Print the JSON Schema of a result file."),
}


# The commands in the help, by what a user has; one that is in no group comes under the last heading.
GROUPS = {
    "One clip": ("run", "review", "calibrate", "frame", "track", "import"),
    "One table": ("smooth", "fit", "diagnose", "sealed", "plan", "discover", "petab"),
    "Many clips": ("class", "gt", "benchmark"),
    "Synthetic clips": ("demo", "render"),
    "What there is": ("list", "schema"),
}
OTHERS = "Other commands"
TYPE_WORDS: dict[Any, str] = {str: "TEXT", int: "NUMBER", float: "NUMBER", Path: "PATH"}  # in the help of a command
INTERRUPTED = 130  # exit status after Ctrl-C, as shells have it

HELP = {"help_option_names": ["-h", "--help"]}


class _Commands(Mapping[str, "Command"]):
    """The commands by name; each is imported when it is looked up."""

    def __getitem__(self, name: str) -> Command:
        return _command(name)

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


@cache
def _command(name: str) -> Command:
    module, _ = COMMANDS[name]
    function = getattr(importlib.import_module(f"iris_sysid.cli.{module}"), module)
    function.__annotations__ = get_type_hints(function, include_extras=True)
    for hint in function.__annotations__.values():
        _say_type(hint)
    application = typer.Typer(add_completion=False, rich_markup_mode=None)
    application.command(name, context_settings=HELP)(function)
    return typer.main.get_command(application)


def _say_type(hint: Any) -> None:
    """Have the help of an option, an annotated type, say what to write: TEXT or NUMBER rather than a type of Python."""
    kind, *options = get_args(hint) if get_origin(hint) is Annotated else (hint,)
    kinds = [one for part in (get_args(kind) or (kind,)) for one in (get_args(part) or (part,))]
    word = next((TYPE_WORDS[one] for one in kinds if one in TYPE_WORDS), None)
    for option in options:
        if isinstance(option, OptionInfo) and option.metavar is None and word is not None:
            option.metavar = word


class _Group(TyperGroup):
    """A group that imports only the command that is called, and none for its own help."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = _Commands()  # type: ignore[assignment]  # none is ever added

    def format_commands(self, ctx: Context, formatter: HelpFormatter) -> None:
        """Write one line per command, in groups."""
        grouped = {name for names in GROUPS.values() for name in names}
        others = tuple(name for name in COMMANDS if name not in grouped)
        for title, names in {**GROUPS, OTHERS: others}.items():
            if names:
                with formatter.section(title):
                    formatter.write_dl([(name, COMMANDS[name][1]) for name in names])


app = typer.Typer(
    cls=_Group,
    no_args_is_help=True,
    context_settings=HELP,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="From a physics video to the parameters of its governing equation, with honest error bars.",
    epilog="Add --debug to any command to see where a failure comes from, --sandbox to run it in a process with limits "
    "on memory and time, for files that are not trusted.",
)


def _show_version(wanted: bool) -> None:
    """Print the installed version and leave."""
    if wanted:
        from importlib.metadata import version

        typer.echo(f"iris-sysid {version('iris-sysid')}")
        raise typer.Exit


@app.callback()
def _every_command(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Options before the name of a command."""


def main() -> None:
    """Run the command line; a reported failure is one line on stderr and exit status 1."""
    from iris_sysid.cli import _terminal
    from iris_sysid.cli._completion import drop_equals
    from iris_sysid.errors import IrisError
    from iris_sysid.video.sandbox import run_limited, share_pools

    _terminal.replace_unprintable()
    share_pools()
    drop_equals()
    debug = "--debug" in sys.argv
    arguments = [argument for argument in sys.argv[1:] if argument not in ("--debug", "--sandbox")]
    try:
        if "--sandbox" in sys.argv:
            again = [*arguments, "--debug"] if debug else arguments
            sys.exit(run_limited("from iris_sysid.cli import main; main()", again))
        app(arguments, prog_name="iris-sysid")
    except (SystemExit, KeyboardInterrupt) as leaving:
        if isinstance(leaving, KeyboardInterrupt) or leaving.code == INTERRUPTED:
            typer.echo(
                "iris-sysid: interrupted; no file is half-written, and batches go on when started again", err=True
            )
            sys.exit(INTERRUPTED)
        raise
    except Exception as error:
        if debug:
            raise
        unexpected = f"unexpected {type(error).__name__}{_terminal.place_of(error)}: {error}; --debug shows where"
        if isinstance(error, MemoryError):
            unexpected = f"memory is full, or at its limit: {error}"
        if isinstance(error, OSError) and error.filename and error.strerror:
            unexpected = f"{error.strerror}: {error.filename}; --debug shows where"
        text = _terminal.error_text(error) if isinstance(error, IrisError) else unexpected
        for line in (f"iris-sysid: {text}", *getattr(error, "__notes__", ())):
            typer.echo(_terminal.one_line(line), err=True)
        sys.exit(1)
