"""The command ``iris-sysid import``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Json, Output


def import_marks(
    project: Annotated[Path, typer.Argument(help="A .trk or .trz file of Open Source Physics Tracker.")],
    output: Output,
    force: Force = False,
    json: Json = False,
) -> None:
    """Import the marks of an OSP Tracker project. Writes track.csv: one row per mark and body, in px and s.

    \b
    Example:
      iris-sysid import toss.trz -o track.csv
    """
    from iris_sysid import pipeline
    from iris_sysid.io import csv_write, osp_tracker

    _terminal.check_outputs(project, [output], overwrite=force)
    tracks = osp_tracker.marked_tracks(osp_tracker.read_osp(project))
    csv_write.write_track(pipeline.from_source(tracks, project, {}), output, overwrite=force)
    _terminal.print_rows([{"body": body.body, "marks": body.n_valid} for body in tracks], json)
