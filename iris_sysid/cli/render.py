"""The command ``iris-sysid render``."""

from typing import Annotated

import typer

from iris_sysid import terminal
from iris_sysid.cli.arguments import Force, Output, PhenomenonName, Settings


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
