"""The command ``iris-sysid import``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Fps, Json, Output


def import_marks(
    project: Annotated[
        Path,
        typer.Argument(help="A .trk or .trz file of Open Source Physics Tracker; FILE.trz:NAME for one of several."),
    ],
    output: Output,
    world: Annotated[
        Path | None,
        typer.Option(help="x and z in m, one file per body. Default: OUTPUT-world.csv, where the project has a scale."),
    ] = None,
    fps: Fps = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Import the marks of an OSP Tracker project. Writes them in px and s, and, by the project's scale, in m.

    \b
    Example:
      iris-sysid import toss.trz -o track.csv
    """
    from iris_sysid.calibration.calibration_json import read_calibration
    from iris_sysid.calibration.pixel_scale import to_world
    from iris_sysid.errors import CalibrationError
    from iris_sysid.io import csv_write, osp_tracker
    from iris_sysid.pipeline import one_clip

    _terminal.check_outputs(project, [output, world], overwrite=force)
    content = osp_tracker.read_osp(project)
    if world is not None and not content.calibrated:
        raise CalibrationError(f"{project} has no scale: calibrate it in Tracker, or leave out --world")
    metres = world or (output.with_name(f"{output.stem}-world.csv") if content.calibrated else None)
    _terminal.check_outputs(project, [output, metres], overwrite=force)
    tracks = one_clip.from_source(osp_tracker.marked_tracks(content, fps=fps), project, {"fps": fps})
    csv_write.write_track(tracks, output, overwrite=force)
    tables = []
    if metres is not None:
        calibration = read_calibration(project)
        bodies = {body.body: to_world(body, calibration) for body in tracks}
        tables = csv_write.write_worlds(bodies, metres, overwrite=force)
    rows = [{"body": body.body, "marks": body.n_valid} for body in tracks]
    _terminal.print_rows(rows, json, header=True)
    for table in tables:
        _terminal.suggest("fit", table, "--model", "auto", "-o", table.with_name(f"{table.stem}-fit.json"), json=json)
