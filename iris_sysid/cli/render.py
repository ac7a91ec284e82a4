"""The command ``iris-sysid render``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _completion, _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import Force, Settings, WorkArguments
from iris_sysid.errors import UnknownNameError

# defaults; clips of a data set have the benchmark's size and number
SIZE, SECONDS = "1280x720", 10.0
DATASET_SIZE, TRIALS = "3840x2160", 10
EVERY_CLASS = "all"
BENCHMARK = "iris"  # the data set whose classes are rendered; classes of other data sets only when named


@with_groups
def render(
    work: WorkArguments,
    phenomenon: Annotated[
        str | None, typer.Option(help="Phenomenon to render; see iris-sysid list.", autocompletion=_completion.scenes)
    ] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Video file to write.")] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(help="Add a hidden effect, e.g. quadratic-drag=0.08.", autocompletion=_completion.effects),
    ] = None,
    known: Settings = None,
    size: Annotated[
        str | None, typer.Option(help=f"WIDTHxHEIGHT in px; default {SIZE}, data set {DATASET_SIZE}.")
    ] = None,
    fps: Annotated[float, typer.Option(help="Frame rate in 1/s.")] = 60.0,
    seconds: Annotated[float | None, typer.Option(help="Length in s; default 10, data set as published.")] = None,
    seed: Annotated[int, typer.Option(help="Random seed; the same seed gives the same clip.")] = 0,
    dataset: Annotated[Path | None, typer.Option(help="Render the benchmark's 240 clips into this folder.")] = None,
    classes: Annotated[list[str] | None, typer.Option(help="Render only this class; 'all' renders all ten.")] = None,
    trials: Annotated[int | None, typer.Option(help=f"Clips of each setting; default {TRIALS}.")] = None,
    force: Force = False,
) -> None:
    """Render a synthetic clip, or a whole synthetic data set, and write its exact truth beside it.

    An interrupted run with --dataset continues where it stopped: finished clips are kept.

    \b
    Example:
      iris-sysid render --phenomenon pendulum --effect quadratic-drag=0.08 -o clip.mp4
    """
    if dataset is not None:
        of_clip = {"--phenomenon": phenomenon, "-o": output, "--effect": effect, "--set": known, "--force": force}
        _terminal.refuse(of_clip, "belongs to a single clip, not to --dataset; leave it out, or use --classes")
        video = (size or DATASET_SIZE, fps, seconds, seed)
        _render_dataset(dataset, video, classes or [], trials, _terminal.workers_of(work))
        return
    of_dataset = {"--classes": classes, "--trials": trials, "--workers": work.workers, "--scheduler": work.scheduler}
    _terminal.refuse(of_dataset, "belongs to --dataset; give its folder")
    if phenomenon is None or output is None:
        raise typer.BadParameter("Missing option '--phenomenon' or '-o', for a clip; or '--dataset', for all of them")
    _render_clip(
        phenomenon,
        output,
        effect or [],
        known or [],
        (size or SIZE, fps, SECONDS if seconds is None else seconds, seed),
        force,
    )
    typer.echo(f"{output}", err=True)
    _terminal.suggest("run", output, "--phenomenon", phenomenon, "-o", output.with_name(f"{output.stem}-run"))


def _render_clip(
    phenomenon: str,
    output: Path,
    effect: list[str],
    known: list[str],
    video: tuple[str, float, float, int],
    force: bool,
) -> None:
    from iris_sysid.cli import _parsing
    from iris_sysid.synthetic import render_clip
    from iris_sysid.synthetic.plan import scene_named

    size, fps, seconds, seed = video
    units = {parameter.name: parameter.unit for parameter in scene_named(phenomenon).parameters}
    with _terminal.progress("rendering") as report_progress:
        render_clip(
            phenomenon,
            output,
            effects=_parsing.effects(effect),
            size=_parsing.size(size),
            fps=fps,
            duration_s=seconds,
            seed=seed,
            overrides={name: value.value for name, value in _parsing.settings(known, units).items()},
            progress=report_progress,
            overwrite=force,
        )


def _render_dataset(
    folder: Path,
    video: tuple[str, float, float | None, int],
    classes: list[str],
    trials: int | None,
    workers: int | str,
) -> None:
    from iris_sysid.benchmark.render_dataset import render_dataset
    from iris_sysid.cli import _parsing

    size, fps, seconds, seed = video
    with _terminal.progress("rendering") as report_progress:
        done = render_dataset(
            folder,
            size=_parsing.size(size),
            fps=fps,
            trials=TRIALS if trials is None else trials,
            seed=seed,
            workers=workers,
            phenomena=_phenomena(classes),
            duration_s=seconds,
            progress=report_progress,
        )
    typer.echo(f"{folder}: {len(done.written)} clips rendered, {len(done.kept)} kept", err=True)


def _phenomena(classes: list[str]) -> list[str]:
    """The scenes of classes, each given by its folder or its phenomenon; without any, those of the benchmark."""
    from iris_sysid.pipeline.clip_folders import benchmark_classes
    from iris_sysid.synthetic.scene import SCENES

    if EVERY_CLASS in classes:
        return list(SCENES)
    folders = {folder for folder, (_, described) in benchmark_classes().items() if described.dataset == BENCHMARK}
    names = {scene.folder.lower(): name for name, scene in SCENES.items()} | {name: name for name in SCENES}
    for class_name in classes:
        if class_name.lower() not in names:
            choices = ", ".join(scene.folder for scene in SCENES.values())
            raise UnknownNameError(f"no class is named {class_name!r}; there are: {choices}, or {EVERY_CLASS}")
    chosen = [names[class_name.lower()] for class_name in classes]
    return list(dict.fromkeys(chosen)) or [name for name, scene in SCENES.items() if scene.folder in folders]
