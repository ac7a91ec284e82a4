"""The command line: each command is one arrow of the flow, thin over the library.

Results go to files and, with ``--json``, to stdout; progress goes to stderr. Exit status: 0 done,
1 a stated failure, 2 wrong usage. Imports that take time are made by the command that needs them.
"""

import sys

import typer

from iris_sysid.cli import (
    _terminal,
    benchmark,
    calibrate,
    demo,
    diagnose,
    discover,
    fit,
    gt,
    import_marks,
    list_names,
    render,
    run,
    schema,
    smooth,
    tensors,
    track,
)
from iris_sysid.errors import IrisError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="From a physics video to the parameters of its governing equation, with honest error bars.",
    epilog="Add --debug to any command to see where a failure comes from.",
)

# in the order in which help shows them: one file a command
app.command("run")(run.run)
app.command("calibrate")(calibrate.calibrate)
app.command("track")(track.track)
app.command("import")(import_marks.import_marks)
app.command("smooth")(smooth.smooth)
app.command("fit")(fit.fit)
app.command("diagnose")(diagnose.diagnose)
app.command("discover")(discover.discover)
app.command("render")(render.render)
app.command("demo")(demo.demo)
app.command("tensors")(tensors.tensors)
app.command("gt")(gt.gt)
app.command("benchmark")(benchmark.benchmark)
app.command("list")(list_names.list_names)
app.command("schema")(schema.schema)


def main() -> None:
    """Run the command line; a stated failure is one line on stderr and exit status 1."""
    _terminal.replace_unprintable()
    debug = "--debug" in sys.argv
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    try:
        app(arguments, prog_name="iris-sysid")
    except Exception as error:
        if debug:
            raise
        stated = isinstance(error, IrisError)
        text = str(error) if stated else f"unexpected {type(error).__name__}: {error}; --debug shows where"
        typer.echo(f"iris-sysid: {_terminal.one_line(text)}", err=True)
        sys.exit(1)
