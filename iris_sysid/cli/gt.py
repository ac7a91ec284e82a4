"""The command ``iris-sysid gt``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Fps, KeepPartial, TimeBase


def gt(
    dataset: Annotated[Path | None, typer.Argument(help="Folder of <Class>/<setting>/<clip>.mp4.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Where parameters.json goes.")] = None,
    measured: Annotated[Path | None, typer.Option(help="What was measured by hand; --template prints one.")] = None,
    board: Annotated[str | None, typer.Option(help="Inner corners of each class's checkerboard.mp4: 9x6.")] = None,
    square: Annotated[str | None, typer.Option(help="Side of its squares: 25mm or 25.0+-0.1mm.")] = None,
    workers: Annotated[int, typer.Option(help="Processes side by side.")] = 1,
    trials: Annotated[int | None, typer.Option(help="Only so many clips of each setting.")] = None,
    work: Annotated[Path | None, typer.Option(help="Where what each clip gave is kept: OUTPUT.work.")] = None,
    fps: Fps = None,
    time_base: TimeBase = "0%",
    keep_partial: KeepPartial = False,
    diagnose: Annotated[bool, typer.Option("--diagnose", help="Ask which effects the equations lack.")] = False,
    template: Annotated[bool, typer.Option("--template", help="Print a file for --measured, and stop.")] = False,
    force: Force = False,
) -> None:
    """Regenerate the ground truth of a data set. Every clip is measured; what was measured by hand stands beside it.

    A second run measures only what is missing or has changed.

    \b
    Example:
      iris-sysid gt DATASET/ --measured measured.json -o parameters.json
    """
    from iris_sysid.benchmark.groundtruth import direct
    from iris_sysid.benchmark.groundtruth.effects import lacking_effects
    from iris_sysid.benchmark.groundtruth.measure import Conditions, measure
    from iris_sysid.benchmark.groundtruth.parameters import parameters_document
    from iris_sysid.cli import _parsing
    from iris_sysid.io.files import check_writable
    from iris_sysid.io.json_documents import document_text, write_document
    from iris_sysid.io.schemas.groundtruth import MeasuredDocument

    if template:
        typer.echo(document_text(direct.template()).rstrip("\n"))
        return
    if dataset is None or output is None:
        raise typer.BadParameter("Missing argument 'DATASET' or option '-o'")
    check_writable(output, overwrite=force)
    by_hand = MeasuredDocument() if measured is None else direct.read_measured(measured)
    if board is not None or square is not None:
        by_hand = direct.with_board(by_hand, _parsing.board(board, square))
    conditions = Conditions(
        fps=fps, clock_stderr=_parsing.fraction(time_base), keep_partial=keep_partial, trials=trials
    )
    with _terminal.progress("measuring clips") as report_progress:
        found = measure(
            dataset,
            work or output.with_suffix(".work"),
            measured=by_hand,
            conditions=conditions,
            workers=workers,
            progress=report_progress,
            tell=lambda text: typer.echo(_terminal.one_line(text), err=True),
        )
    document = parameters_document(found, by_hand, lacking_effects if diagnose else None)
    write_document(document, output, overwrite=force)
    typer.echo(f"{len(found.clips)} clips, {found.now} measured now; {len(found.gaps)} gaps", err=True)
