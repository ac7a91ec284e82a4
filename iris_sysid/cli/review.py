"""The command ``iris-sysid review``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import Bodies, FilmArguments, PhenomenonAsked


@with_groups
def review(
    source: Annotated[Path, typer.Argument(help="Clip, or the folder of a run or of an earlier review.")],
    film: FilmArguments,
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
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.review.app import review_app
    from iris_sysid.review.opening import is_result, open_clip, open_result
    from iris_sysid.review.request import ReviewRequest
    from iris_sysid.review.server import serve

    folder = source if is_result(source) else output or Path(f"{source.stem}-review")
    given = {
        "--phenomenon": phenomenon,
        "--bodies": bodies,
        "--scale": film.scale,
        "--scale-bar": film.scale_bar,
        "--mark": film.mark,
        "--set": film.known,
        "--free": film.free,
        "--roi": film.roi,
    }
    if is_result(folder):
        _terminal.refuse(given, f"is recorded in {folder} already; change it on the page")
        _, calibration = _parsing.calibration_of(None, None, film.calibration)
        session = open_result(folder, video or (None if source == folder else source), calibration)
    else:
        request = film.request(None if phenomenon is None else PHENOMENA.named(phenomenon), bodies)
        session = open_clip(source, folder, ReviewRequest(**request.values()))
        session.track()

    def ready(address: str) -> None:
        typer.echo(f"review of {session.clip}: {address}", err=True)
        typer.echo(f"log: {folder / 'review.jsonl'}; Ctrl-C ends it, nothing is lost", err=True)
        if not no_browser:
            webbrowser.open(address)

    serve(partial(review_app, session), port, ready, session.close)
    if session.saved_version != session.version:
        typer.echo("not saved: the edits are in the log; open the review again and save", err=True)
        _terminal.suggest("review", folder, *([] if video is None else ["--clip", video]))
    elif (folder / "report.html").is_file():
        typer.echo(f"report: {folder / 'report.html'}", err=True)
