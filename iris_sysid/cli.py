"""The command line: each command is one arrow of the flow, thin over the library.

Results go to files and, with ``--json``, to stdout; progress goes to stderr. Exit status: 0 done,
1 a stated failure, 2 wrong usage. Imports that take time are made by the command that needs them.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from iris_sysid import terminal
from iris_sysid.errors import IrisError

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    help="From a physics video to the parameters of its governing equation, with honest error bars.",
    epilog="Add --debug to any command to see where a failure comes from.",
)

Video = Annotated[Path, typer.Argument(help="Video, folder of images, GIF, or .zip/.trz that holds one.")]
Table = Annotated[Path, typer.Argument(help="CSV with t_s and <quantity>_<unit> columns.")]
Output = Annotated[Path, typer.Option("-o", "--output", help="Where the result goes.")]
Force = Annotated[bool, typer.Option("--force", help="Replace results that are already there.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")]
Fps = Annotated[float | None, typer.Option(help="True frame rate in 1/s, for slow motion.")]
Start = Annotated[float | None, typer.Option(help="Leave out what comes before, in s.")]
Stop = Annotated[float | None, typer.Option(help="Leave out what comes after, in s.")]
Roi = Annotated[str | None, typer.Option(help="Look only here: x,y,width,height in px.")]
Colour = Annotated[str | None, typer.Option("--colour", "--color", help="Colour of the body: a name or #rrggbb.")]
Bodies = Annotated[int | None, typer.Option(help="Number of bodies to follow.", min=1, max=64)]
TrackerName = Annotated[str | None, typer.Option("--tracker", help="Tracker; see iris-sysid list.")]
PhenomenonName = Annotated[str, typer.Option("--phenomenon", help="What is filmed; see iris-sysid list.")]
KeepPartial = Annotated[bool, typer.Option("--keep-partial", help="Use what can be read of a damaged file.")]
Settings = Annotated[list[str] | None, typer.Option("--set", help="A known value: gravity=9.79+-0.01, length=50cm.")]
Free = Annotated[list[str] | None, typer.Option("--free", help="Estimate this constant as well, e.g. gravity.")]
Scale = Annotated[str | None, typer.Option(help="640px=1m; or gravity=9.79 to take it from the fall itself.")]
ScaleBar = Annotated[str | None, typer.Option(help="Two points a known length apart: x1,y1,x2,y2=0.84m.")]
CalibrationFile = Annotated[Path | None, typer.Option("--calibration", help="calibration.json, or a .trk/.trz file.")]
Marks = Annotated[list[str] | None, typer.Option("--mark", help="A point in px: pivot=437,42 or launch=5,103.")]
Starts = Annotated[list[str] | None, typer.Option("--start-at", help="A starting value, e.g. length=0.5.")]
ModelName = Annotated[str, typer.Option("--model", help="Governing equation; see iris-sysid list.")]


@app.command()
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
    from iris_sysid import options, pipeline
    from iris_sysid.registry import PHENOMENA

    known_names = pipeline.accepted_settings(PHENOMENA[phenomenon])
    pipeline.check_folder(output, overwrite=force)
    from_gravity, metres = options.calibration_of(scale, scale_bar, calibration)
    with terminal.progress("tracking") as report_progress:
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
            options=options.track_options(PHENOMENA[phenomenon].bodies, roi, colour),
            settings=options.settings(known or (), known_names),
            free=free or (),
            marks_px=options.marks(mark or ()),
            progress=report_progress,
        )
    page = pipeline.save(result, output, overwrite=force)
    terminal.show_fit(result.fit, result.trajectory, json)
    typer.echo(f"report: {page}", err=True)
    terminal.exit_unless_ok(result.fit)


@app.command()
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
    overlay: Annotated[Path | None, typer.Option(help="Also write the clip with the track drawn over it.")] = None,
    keep_partial: KeepPartial = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Follow bodies through a clip. Writes track.csv: one row per frame and body, in px and s.

    \b
    Example:
      iris-sysid track toss.mp4 --roi 0,0,640,400 -o track.csv --overlay overlay.mp4
    """
    from iris_sysid import options, pipeline, tables
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.video import open_video

    chosen = PHENOMENA[phenomenon] if phenomenon else None
    name = tracker or (chosen.tracker if chosen else "median-background")
    terminal.check_outputs(video, [output, overlay], overwrite=force)
    terminal.check_suffix(overlay, ".mp4")
    clip = open_video(video, fps=fps, start_s=start, stop_s=stop, keep_partial=keep_partial)
    with terminal.progress("tracking") as report_progress:
        wanted = options.track_options(bodies or (chosen.bodies if chosen else 1), roi, colour, report_progress)
        tracks = pipeline.track(clip, name, wanted)
    asked = {"tracker": name, "fps": fps, "start_s": start, "stop_s": stop, "keep_partial": keep_partial}
    tables.write_track(pipeline.from_source(tracks, video, asked), output, overwrite=force)
    if overlay is not None:
        from iris_sysid.report.overlay import write_overlay

        with terminal.progress("drawing") as report_progress:
            write_overlay(clip, tracks, overlay, overwrite=force, progress=report_progress)
    if clip.warning:
        typer.echo(f"warning: {clip.warning}", err=True)
    found = [{"body": body.body, "frames": len(body.t_s), "tracked": body.n_valid} for body in tracks]
    terminal.print_rows(found, json)


@app.command("import")
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
    from iris_sysid import osp, pipeline, tables

    terminal.check_outputs(project, [output], overwrite=force)
    tracks = osp.marked_tracks(osp.read_osp(project))
    tables.write_track(pipeline.from_source(tracks, project, {}), output, overwrite=force)
    terminal.print_rows([{"body": body.body, "marks": body.n_valid} for body in tracks], json)


@app.command()
def smooth(table: Table, output: Output, force: Force = False) -> None:
    """Smooth a trajectory and add its velocities. Kalman filter and Rauch-Tung-Striebel; gaps are bridged.

    \b
    Example:
      iris-sysid smooth trajectory.csv -o smoothed.csv
    """
    from iris_sysid import smoothing, tables
    from iris_sysid.table_reading import read_trajectory

    terminal.check_outputs(table, [output], overwrite=force)
    smoothed = smoothing.smooth(read_trajectory(table))
    tables.write_trajectory(smoothed, output, overwrite=force)
    state = smoothed.smoothed
    assert state is not None
    for quantity, psd, nis in zip(smoothed.quantities, state.psd, state.nis, strict=True):
        typer.echo(f"{quantity.name}: process noise {psd:.4g} {quantity.unit}^2/s^3, NIS {nis:.2f}", err=True)


@app.command()
def fit(
    table: Table,
    model: ModelName,
    output: Output,
    known: Settings = None,
    free: Free = None,
    start: Starts = None,
    plot: Annotated[Path | None, typer.Option(help="Also draw the fit and its residual to this PNG file.")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Fit a governing equation to a trajectory. Writes fit.json: values, standard errors, intervals, units.

    \b
    Example:
      iris-sysid fit trajectory.csv --model pendulum --set gravity=9.79 -o fit.json
    """
    from fitters.ode import fit as fit_model
    from iris_sysid import documents, files, options
    from iris_sysid.registry import MODELS
    from iris_sysid.table_reading import read_trajectory

    chosen = MODELS[model]
    terminal.check_outputs(table, [output, plot], overwrite=force)
    terminal.check_suffix(plot, ".png")
    fixed, first = (options.settings(texts or (), options.units_of(chosen)) for texts in (known, start))
    starts = {name: value.value for name, value in first.items()}
    trajectory = options.asked(read_trajectory(table), model=model, set=known, free=free, start_at=start)
    result = fit_model(trajectory, chosen, fixed=fixed, free=free or (), start=starts)
    documents.write_fit(result, trajectory, output, overwrite=force)
    if plot is not None:
        from iris_sysid.report.figures import fit_figure
        from iris_sysid.report.page import png_of

        files.write_atomic(plot, png_of(fit_figure(trajectory, result)), overwrite=force)
    terminal.show_fit(result, trajectory, json)
    terminal.exit_unless_ok(result)


@app.command()
def diagnose(
    table: Table,
    model: ModelName,
    output: Output,
    known: Settings = None,
    free: Free = None,
    holdout: Annotated[float, typer.Option(help="Share to predict without fitting it.", min=0.0, max=0.9)] = 0.3,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find what a governing equation lacks, and add it. Reports the error before and after.

    \b
    Example:
      iris-sysid diagnose trajectory.csv --model pendulum -o diagnosis/
    """
    from iris_sysid import diagnosis, options
    from iris_sysid.documents import document_text
    from iris_sysid.registry import MODELS
    from iris_sysid.report.diagnosis_page import check_folder, diagnosis_document, write_diagnosis
    from iris_sysid.table_reading import read_trajectory
    from iris_sysid.wording import diagnosis_sentence

    chosen = MODELS[model]
    check_folder(output, overwrite=force)
    fixed = options.settings(known or (), options.units_of(chosen))
    trajectory = options.asked(read_trajectory(table), model=model, set=known, free=free, holdout=holdout)
    found = diagnosis.diagnose(
        trajectory,
        chosen,
        fixed=fixed,
        free=free or (),
        holdout=holdout,
        progress=lambda text: typer.echo(text, err=True),
    )
    page = write_diagnosis(found, trajectory, output, overwrite=force)
    document = document_text(diagnosis_document(found, trajectory)).rstrip("\n")
    typer.echo(document if json else diagnosis_sentence(found))
    typer.echo(f"report: {page}", err=True)


@app.command()
def render(
    phenomenon: PhenomenonName,
    output: Output,
    effect: Annotated[list[str] | None, typer.Option(help="Hide an effect, e.g. quadratic-drag=0.08.")] = None,
    known: Settings = None,
    size: Annotated[str, typer.Option(help="Picture size in px: WIDTHxHEIGHT.")] = "1280x720",
    fps: Annotated[float, typer.Option(help="Frame rate in 1/s.")] = 60.0,
    seconds: Annotated[float, typer.Option(help="Length of the clip in s.")] = 10.0,
    seed: Annotated[int, typer.Option(help="Same seed, same clip.")] = 0,
    force: Force = False,
) -> None:
    """Render a clip whose every number is known. The exact truth goes beside it.

    \b
    Example:
      iris-sysid render --phenomenon pendulum --effect quadratic-drag=0.08 -o clip.mp4
    """
    from iris_sysid import options
    from iris_sysid.synthetic import render_clip
    from iris_sysid.synthetic.plan import scene_named

    units = {one.name: one.unit for one in scene_named(phenomenon).parameters}
    with terminal.progress("rendering") as report_progress:
        render_clip(
            phenomenon,
            output,
            effects=options.effects(effect or ()),
            size=options.size(size),
            fps=fps,
            duration_s=seconds,
            seed=seed,
            overrides={name: value.value for name, value in options.settings(known or (), units).items()},
            progress=report_progress,
            overwrite=force,
        )
    typer.echo(f"{output}", err=True)


@app.command()
def demo(
    output: Output = Path("demo-output"),
    force: Force = False,
) -> None:
    """Render a clip, find what is hidden in it, compare. Shows what is left over, beside the truth.

    \b
    Example:
      iris-sysid demo -o demo-output
    """
    from iris_sysid.demo import demo as run_demo

    with terminal.progress("demo") as report_progress:
        text = run_demo(output, overwrite=force, progress=report_progress)
    typer.echo(text)


@app.command()
def audit(
    published: Annotated[Path, typer.Argument(help="Folder with the benchmark's published result files.")],
    output: Output,
    force: Force = False,
) -> None:
    """Derive the published numbers of the IRIS benchmark again. From its own result files; says what differs.

    \b
    Example:
      iris-sysid audit ../shared/data/iris_published -o audit/
    """
    from iris_sysid.benchmark import write_audit

    for path in write_audit(published, output, overwrite=force).values():
        typer.echo(str(path), err=True)


@app.command("list")
def list_names(json: Json = False) -> None:
    """List phenomena, models, effects, trackers and scenes. Scenes are what can be rendered.

    \b
    Example:
      iris-sysid list
    """
    from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA, TRACKERS
    from iris_sysid.synthetic.scene import SCENES

    rows = [
        {"kind": registry.kind, "name": item.name, "summary": item.summary}
        for registry in (PHENOMENA, MODELS, EFFECTS, TRACKERS, SCENES)
        for item in registry.values()
    ]
    terminal.print_rows(rows, json)


@app.command()
def schema(name: Annotated[str, typer.Argument(help="fit, diagnosis, calibration or origin.")]) -> None:
    """Print the JSON Schema of a result file.

    \b
    Example:
      iris-sysid schema fit
    """
    from iris_sysid import documents, files

    typer.echo(files.json_text(documents.schema(name)).rstrip("\n"))


def main() -> None:
    """Run the command line; a stated failure is one line on stderr and exit status 1."""
    terminal.replace_unprintable()
    debug = "--debug" in sys.argv
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    try:
        app(arguments, prog_name="iris-sysid")
    except Exception as error:
        if debug:
            raise
        stated = isinstance(error, IrisError)
        text = str(error) if stated else f"unexpected {type(error).__name__}: {error}; --debug shows where"
        typer.echo(f"iris-sysid: {terminal.one_line(text)}", err=True)
        sys.exit(1)
