"""The command ``iris-sysid run``."""

from pathlib import Path
from typing import NoReturn

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import as_typed, with_groups
from iris_sysid.cli.arguments import FilmArguments, Force, Json, Output, PhenomenonAsked, Strict, Video


@with_groups
def run(
    video: Video,
    output: Output,
    film: FilmArguments,
    phenomenon: PhenomenonAsked = None,
    force: Force = False,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Measure one clip: follow the body, fit its equation, write a report.

    \b
    Example:
      iris-sysid run pendulum.mp4 --phenomenon pendulum --scale 640px=1m -o out/
    """
    from iris_sysid.pipeline import one_clip
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.report.text import is_in_px

    _terminal.check_outputs(video, [output / name for name in one_clip.FILES], overwrite=force)
    if phenomenon is None:
        _ask_for_phenomenon(video, output, as_typed(film))
    chosen = PHENOMENA.named(phenomenon)
    by_hand = _terminal.by_hand(output, video, "--phenomenon", phenomenon, *as_typed(film))
    with by_hand, _terminal.progress("tracking", then="calibrating and fitting") as report_progress:
        result = one_clip.run_request(video, film.request(chosen, progress=report_progress))
    page = one_clip.save(result, output, overwrite=force)
    _terminal.show_fit(result.fit, result.trajectory, json)
    typer.echo(f"report: {page}", err=True)
    _terminal.check_usable(result.fit)
    if is_in_px(result.fit) and not json:
        by_fall = "--scale gravity=9.81, by the fall; " if chosen.free_flight else ""
        typer.echo(
            f"lengths are in px; for metres state a scale: --scale 640px=1m; {by_fall}or --scale-bar x1,y1,x2,y2=0.84m "
            "with places that this picture shows:",
            err=True,
        )
        rate = [] if film.fps is None else ["--fps", film.fps]
        _terminal.suggest("frame", video, *rate, "-o", output / "frame.png")
    _terminal.suggest("diagnose", output, "-o", output / "diagnosis", json=json)
    _terminal.end(result.fit.verdict, strict)


def _ask_for_phenomenon(video: Path, output: Path, film: list[str]) -> NoReturn:
    """List on stderr what a clip may show, and how to say it; exit status 2, once the clip can be read.

    ``film`` holds the other options as typed.
    """
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.types import check_count
    from iris_sysid.video.reader import open_video

    if frames := len(open_video(video, fps=1.0).frame_times):  # none where only decoding tells
        check_count(frames, "a motion")
    typer.echo(
        f"choose the phenomenon of {_terminal.one_line(video.name)} with --phenomenon NAME, or on the page:", err=True
    )
    summaries = PHENOMENA.summaries()
    width = max(map(len, summaries))
    for name, summary in summaries.items():
        typer.echo(f"  {name:<{width}}  {summary}", err=True)
    _terminal.suggest("review", video, *film, "-o", output)
    _terminal.suggest("run", video, "--phenomenon", "NAME", *film, "-o", output)
    raise typer.Exit(2)
