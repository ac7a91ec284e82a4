"""The command ``iris-sysid run``."""

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import (
    CalibrationFile,
    Colour,
    Force,
    Fps,
    Free,
    Json,
    KeepPartial,
    Marks,
    Output,
    PhenomenonName,
    Roi,
    Scale,
    ScaleBar,
    Settings,
    Start,
    Stop,
    TimeBase,
    TrackerName,
    Vertical,
    Video,
)


def run(
    video: Video,
    phenomenon: PhenomenonName,
    output: Output,
    scale: Scale = None,
    scale_bar: ScaleBar = None,
    calibration: CalibrationFile = None,
    fps: Fps = None,
    start: Start = None,
    stop: Stop = None,
    roi: Roi = None,
    colour: Colour = None,
    tracker: TrackerName = None,
    mark: Marks = None,
    vertical: Vertical = "assumed",
    time_base: TimeBase = "0%",
    known: Settings = None,
    free: Free = None,
    keep_partial: KeepPartial = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Run the whole chain on one clip. Track, calibrate, segment, smooth, fit, report.

    \b
    Example:
      iris-sysid run pendulum.mp4 --phenomenon pendulum --scale 640px=1m -o out/
    """
    from iris_sysid import pipeline
    from iris_sysid.cli import _parsing
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.units import SHARES, measured

    known_names = pipeline.accepted_settings(PHENOMENA[phenomenon])
    pipeline.check_folder(output, overwrite=force)
    from_gravity, metres = _parsing.calibration_of(scale, scale_bar, calibration)
    with _terminal.progress("tracking") as report_progress:
        result = pipeline.run(
            video,
            phenomenon,
            calibration=metres,
            scale_from_gravity=from_gravity,
            fps=fps,
            start_s=start,
            stop_s=stop,
            keep_partial=keep_partial,
            tracker=tracker,
            options=_parsing.track_options(PHENOMENA[phenomenon].bodies, roi, colour),
            settings=_parsing.settings(known or (), known_names),
            free=free or (),
            marks_px=_parsing.marks(mark or ()),
            plumb_px=_parsing.plumb_line(mark or ()),
            vertical=_parsing.vertical(vertical),
            clock_stderr=measured(time_base, SHARES, "50ppm")[0],
            progress=report_progress,
        )
    page = pipeline.save(result, output, overwrite=force)
    _terminal.show_fit(result.fit, result.trajectory, json)
    typer.echo(f"report: {page}", err=True)
    _terminal.exit_unless_ok(result.fit)
