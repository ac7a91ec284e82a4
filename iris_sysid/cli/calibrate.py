"""The command ``iris-sysid calibrate``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._calibrate_arguments import BoardArguments, CameraArguments, Text
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import Force, Json, Output


@with_groups
def calibrate(
    sources: Annotated[list[Path], typer.Argument(help="Images, a folder of images, or a clip.")],
    output: Output,
    board: BoardArguments,
    camera: CameraArguments,
    plumb: Annotated[Text, typer.Option(help="Two points of a plumb line, upper first: x1,y1,x2,y2 in px.")] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Draw the calibration as PNG files beside the result.")] = False,
    over: Annotated[Path | None, typer.Option(help="Clip to be measured: check its size, and draw over it.")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Calibrate camera and plane of motion. From images or a clip of a board.

    \b
    Example:
      iris-sysid calibrate board.mp4 --board 9x6 --square 25mm -o calibration.json --plot
    """
    _terminal.check_sources(sources)
    from iris_sysid.cli import _calibration

    drawings = _calibration.plot_paths(output) if plot else ()
    for source in sources:
        _terminal.check_outputs(source, [output, *drawings], overwrite=force)
    with _terminal.progress("looking for the board") as report_progress:
        plane = _calibration.calibrated(sources, board, camera, plumb, over, report_progress)
    drawn = _calibration.save(plane, output, plot=plot, overwrite=force)
    typer.echo(_calibration.text_of(plane.calibration, json=json))
    for path in drawn:
        typer.echo(f"drawn: {path}", err=True)
    scaled = ("--phenomenon", "NAME", "--calibration", output)
    _terminal.suggest("run", over or "CLIP", *scaled, "-o", output.with_name("run"), json=json)
