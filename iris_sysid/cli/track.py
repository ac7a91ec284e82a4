"""The command ``iris-sysid track``."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import (
    Bodies,
    CalibrationFile,
    Colour,
    Force,
    Fps,
    Json,
    KeepPartial,
    Output,
    Roi,
    Scale,
    ScaleBar,
    Start,
    Stop,
    TrackerName,
    Video,
)


def track(
    video: Video,
    output: Output,
    phenomenon: Annotated[str | None, typer.Option(help="Take the tracker from this phenomenon.")] = None,
    tracker: TrackerName = None,
    bodies: Bodies = None,
    fps: Fps = None,
    start: Start = None,
    stop: Stop = None,
    roi: Roi = None,
    colour: Colour = None,
    mask: Annotated[
        Path | None, typer.Option(help="Which pixels are bodies: a folder, zip or video of pictures, one a frame.")
    ] = None,
    overlay: Annotated[Path | None, typer.Option(help="Also write the clip with the track drawn over it.")] = None,
    scale: Scale = None,
    scale_bar: ScaleBar = None,
    calibration: CalibrationFile = None,
    world: Annotated[Path | None, typer.Option(help="With a scale: also write x and z in m, a file a body.")] = None,
    keep_partial: KeepPartial = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Follow bodies through a clip. Writes track.csv: one row per frame and body, in px and s.

    \b
    Example:
      iris-sysid track toss.mp4 --roi 0,0,640,400 -o track.csv --overlay overlay.mp4
    """
    from iris_sysid import pipeline
    from iris_sysid.calibration.plane import check_image_size
    from iris_sysid.cli import _parsing
    from iris_sysid.errors import DataError
    from iris_sysid.io import csv_write
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.video.reader import open_video

    chosen = PHENOMENA[phenomenon] if phenomenon else None
    name = tracker or (chosen.tracker if chosen else "median-background")
    metres = _parsing.metres_of(scale, scale_bar, calibration, needed=world is not None)
    _terminal.check_outputs(video, [output, overlay, world], overwrite=force)
    _terminal.check_suffix(overlay, ".mp4")
    clip = open_video(video, fps=fps, start_s=start, stop_s=stop, keep_partial=keep_partial)
    if metres is not None:
        check_image_size(metres.image_size, (clip.width, clip.height))
    with _terminal.progress("tracking") as report_progress:
        wanted = _parsing.track_options(bodies or (chosen.bodies if chosen else 1), roi, colour, report_progress)
        if mask is not None:
            if name != "median-background":
                raise DataError(f"--mask takes the place of the detector of median-background, not of {name}")
            wanted = replace(wanted, mask=open_video(mask, fps=fps or clip.rate or 60.0))
        tracks = pipeline.track(clip, name, wanted)
    asked = {
        "tracker": name,
        "fps": fps,
        "mask": str(mask) if mask else None,
        "start_s": start,
        "stop_s": stop,
        "keep_partial": keep_partial,
    }
    csv_write.write_track(pipeline.from_source(tracks, video, asked), output, overwrite=force)
    if world is not None and metres is not None:
        csv_write.write_worlds(tracks, metres, world, overwrite=force)
    if overlay is not None:
        from iris_sysid.report.overlay import write_overlay

        with _terminal.progress("drawing") as report_progress:
            write_overlay(clip, tracks, overlay, overwrite=force, progress=report_progress)
    if clip.warning:
        typer.echo(f"warning: {clip.warning}", err=True)
    found = [{"body": body.body, "frames": len(body.t_s), "tracked": body.n_valid} for body in tracks]
    _terminal.print_rows(found, json)
