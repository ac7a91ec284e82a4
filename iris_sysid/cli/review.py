"""The command ``iris-sysid review``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import (
    Bodies,
    ClipArguments,
    ModelArguments,
    PhenomenonAsked,
    ScaleArguments,
    SceneArguments,
    TrackerArguments,
)

if TYPE_CHECKING:
    from iris_sysid.review.request import ReviewRequest


@with_groups
def review(
    source: Annotated[Path, typer.Argument(help="Clip, or the folder of a run or of an earlier review.")],
    scale: ScaleArguments,
    clip: ClipArguments,
    tracking: TrackerArguments,
    scene: SceneArguments,
    model: ModelArguments,
    phenomenon: PhenomenonAsked = None,
    bodies: Bodies = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Folder for log and results; default CLIP-review.")
    ] = None,
    video: Annotated[Path | None, typer.Option("--clip", help="The clip of a folder, where it was moved.")] = None,
    port: Annotated[int, typer.Option(help="Port of the local server; 0 takes a free one.", min=0, max=65535)] = 0,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Print the address, open no browser.")] = False,
) -> None:
    """Correct a track in the browser, frame by frame, and see the fit follow. Every edit is logged in the folder.

    \b
    Example:
      iris-sysid review out/
    """
    import webbrowser
    from functools import partial

    from iris_sysid.cli import _parsing
    from iris_sysid.review.app import review_app
    from iris_sysid.review.opening import is_result, open_clip, open_result
    from iris_sysid.review.server import serve

    folder = source if is_result(source) else output or Path(f"{source.stem}-review")
    given = {
        "--phenomenon": phenomenon,
        "--bodies": bodies,
        "--scale": scale.scale,
        "--scale-bar": scale.scale_bar,
        "--mark": scene.mark,
        "--set": model.known,
        "--free": model.free,
        "--roi": tracking.roi,
    }
    if is_result(folder):
        _terminal.refuse(given, f"is recorded in {folder} already; change it on the page")
        _, calibration = _parsing.calibration_of(None, None, scale.calibration)
        session = open_result(folder, video or (None if source == folder else source), calibration)
    else:
        session = open_clip(source, folder, _request(phenomenon, bodies, scale, clip, tracking, scene, model))
        session.track()

    def ready(address: str) -> None:
        typer.echo(f"review of {session.clip}: {address}", err=True)
        typer.echo(f"log: {folder / 'review.jsonl'}; Ctrl-C ends it, nothing is lost", err=True)
        if not no_browser:
            webbrowser.open(address)

    serve(partial(review_app, session), port, ready, session.close)
    if session.saved_version != session.version:
        typer.echo("not saved: the edits are in the log; open the review again and save", err=True)
        _terminal.suggest("review", folder)
    else:
        typer.echo(f"report: {folder / 'report.html'}", err=True)


def _request(
    phenomenon: str | None,
    bodies: int | None,
    scale: ScaleArguments,
    clip: ClipArguments,
    tracking: TrackerArguments,
    scene: SceneArguments,
    model: ModelArguments,
) -> ReviewRequest:
    """The request as typed."""
    from iris_sysid import pipeline
    from iris_sysid.cli import _parsing
    from iris_sysid.registry import PHENOMENA, TRACKERS
    from iris_sysid.review.request import ReviewRequest
    from iris_sysid.types import GeometryOptions

    chosen = None if phenomenon is None else PHENOMENA.named(phenomenon)
    if chosen is not None and tracking.tracker is not None:
        TRACKERS.named(tracking.tracker)
        chosen = replace(chosen, tracker=tracking.tracker)
    gravity, calibration = _parsing.calibration_of(scale.scale, scale.scale_bar, scale.calibration)
    marks = scene.mark or ()
    count = bodies or (1 if chosen is None else chosen.bodies)
    options = _parsing.track_options(count, tracking.roi, tracking.colour, None, curve=tracking.transfer)
    return ReviewRequest(
        phenomenon=chosen,
        calibration=calibration,
        settings=_parsing.settings(model.known or (), {} if chosen is None else pipeline.accepted_settings(chosen)),
        free=tuple(model.free or ()),
        clip=clip.options(_parsing.fraction(scene.time_base)),
        geometry=GeometryOptions(
            marks_px=_parsing.marks(marks),
            plumb_px=_parsing.plumb_line(marks),
            vertical=_parsing.vertical(scene.vertical),
            scale_from_gravity=gravity,
        ),
        tracking=replace(options, marks=_parsing.body_marks(marks)),
    )
