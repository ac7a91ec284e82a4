"""The command ``iris-sysid track``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _completion, _terminal
from iris_sysid.cli._groups import as_typed, with_groups
from iris_sysid.cli.arguments import (
    Bodies,
    BodyMarks,
    ClipArguments,
    Force,
    Json,
    Output,
    ScaleArguments,
    TrackerArguments,
    Video,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from iris_sysid.types import Track, TrackCandidate


@with_groups
def track(
    video: Video,
    output: Output,
    clip: ClipArguments,
    tracking: TrackerArguments,
    scale: ScaleArguments,
    phenomenon: Annotated[
        str | None, typer.Option(help="Use the tracker of this phenomenon.", autocompletion=_completion.phenomena)
    ] = None,
    bodies: Bodies = None,
    mark: BodyMarks = None,
    mask: Annotated[
        Path | None, typer.Option(help="Masks of the bodies: a folder, zip or video of images, one per frame.")
    ] = None,
    explain: Annotated[
        Path | None, typer.Option(help="Also draw all candidates of the tracker auto, to a PNG file or a folder.")
    ] = None,
    overlay: Annotated[Path | None, typer.Option(help="Also write the clip with the track drawn over it.")] = None,
    world: Annotated[
        Path | None, typer.Option(help="Also write x and z in m, one file per body; needs a scale.")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Follow bodies through a clip. Writes track.csv: one row per frame and body, in px and s.

    \b
    Example:
      iris-sysid track toss.mp4 --mark 1=120,88@35 -o track.csv --overlay overlay.mp4
    """
    from iris_sysid.cli import _parsing
    from iris_sysid.errors import DataError
    from iris_sysid.pipeline import one_clip
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.video.reader import open_video

    chosen = PHENOMENA.named(phenomenon) if phenomenon else None
    name = tracking.tracker or (chosen.tracker if chosen else "auto")
    candidates: list[TrackCandidate] = []
    calibration = _parsing.metres_of(scale.scale, scale.scale_bar, scale.calibration, needed=world is not None)
    sheet = explain and (explain if explain.suffix.lower() == ".png" else explain / "candidates.png")
    _terminal.check_outputs(video, [output, overlay, world, sheet], overwrite=force)
    _terminal.check_suffix(overlay, ".mp4")
    if mask is not None and name not in ("auto", "median-background"):
        raise DataError(f"--mask replaces the detector of auto and median-background, not that of {name}")
    if (mark or explain) and name != "auto":
        raise DataError(f"--mark and --explain are for the tracker auto, not for {name}")
    opened = open_video(video, fps=clip.fps, start_s=clip.start, stop_s=clip.stop, keep_partial=clip.keep_partial)
    if calibration is not None:
        from iris_sysid.calibration.plane import check_image_size

        check_image_size(calibration.image_size, (opened.width, opened.height))
    same = [*as_typed(clip, tracking, scale), *_terminal.repeated("--mark", mark)]
    reviewed = [*(["--phenomenon", phenomenon] if phenomenon else []), *same, *(["--bodies", bodies] if bodies else [])]
    by_hand = _terminal.by_hand(output.parent / "review", video, *reviewed)
    with by_hand, _terminal.progress("tracking") as report_progress:
        count = bodies or (chosen.bodies if chosen else 1)
        options = _parsing.track_options(count, tracking.roi, tracking.colour, report_progress, curve=tracking.transfer)
        options = replace(options, marks=_parsing.body_marks(mark or ()))
        options = replace(options, explain=candidates.extend if explain else None)
        if mask is not None:
            options = replace(options, mask=open_video(mask, fps=clip.fps or opened.rate or 60.0))
        tracks = one_clip.track(opened, name, options)
    from iris_sysid.io import csv_write

    recorded = {
        "tracker": name,
        "fps": clip.fps,
        "mask": str(mask) if mask else None,
        "start_s": clip.start,
        "stop_s": clip.stop,
        "keep_partial": clip.keep_partial,
    }
    tracks = one_clip.from_source(tracks, video, recorded, complete=opened.complete)
    csv_write.write_track(tracks, output, overwrite=force)
    if world is not None and calibration is not None:
        from iris_sysid.trajectory.observables import world_in_motion

        bodies_in_m = {body.body: world_in_motion(body, calibration) for body in tracks}
        csv_write.write_worlds(bodies_in_m, world, overwrite=force)
    if sheet is not None:
        from iris_sysid.report.candidates_sheet import write_candidates

        write_candidates(opened, candidates, sheet, overwrite=force)
    if overlay is not None:
        from iris_sysid.report.overlay import write_overlay

        with _terminal.progress("drawing") as report_progress:
            write_overlay(opened, tracks, overlay, overwrite=force, progress=report_progress)
    for text in filter(None, [opened.warning, *one_clip.doubts_of(tracks)]):
        typer.echo(f"warning: {text}", err=True)
    _terminal.print_rows(_rows(tracks), json, header=True)
    if not json:
        _suggest_next(video, output, world if len(tracks) == 1 else None, phenomenon or "NAME", same)


def _suggest_next(video: Path, output: Path, table: Path | None, phenomenon: str, same: list[str]) -> None:
    """Suggest a fit of the only table in m, else the whole chain with the ``same`` options."""
    if table is not None:
        _terminal.suggest("fit", table, "--model", "auto", "-o", table.with_name("fit.json"))
    else:
        _terminal.suggest("run", video, "--phenomenon", phenomenon, *same, "-o", output.parent / "run")


def _rows(tracks: Sequence[Track]) -> list[dict[str, object]]:
    return [
        {"body": body.body, "frames": len(body.t_s), "tracked": body.n_valid, "track": _terminal.quality_word(body)}
        for body in tracks
    ]
