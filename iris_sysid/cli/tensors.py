"""The command ``iris-sysid tensors``."""

from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import ClipArguments, Force, Output, Video


@with_groups
def tensors(
    clip: Video,
    output: Output,
    part: ClipArguments,
    frames: Annotated[int, typer.Option(help="Images per window.", min=1)] = 10,
    step: Annotated[int, typer.Option(help="Frames of the clip between consecutive images of a window.", min=1)] = 6,
    stride: Annotated[int, typer.Option(help="Frames between the starts of consecutive windows.", min=1)] = 1,
    size: Annotated[str, typer.Option(help="Width and height in px.")] = "100x56",
    force: Force = False,
) -> None:
    """Write a clip as the benchmark's tensor. (N, n_f, C, H, W) for the latent pipeline, its true time step beside it.

    \b
    Example:
      iris-sysid tensors pendulum.mp4 -o pendulum.npy
    """
    from iris_sysid.cli import _parsing
    from iris_sysid.video.reader import open_video
    from iris_sysid.video.tensor_writer import write_tensor

    _terminal.check_outputs(clip, [output], overwrite=force)
    video = open_video(clip, fps=part.fps, start_s=part.start, stop_s=part.stop, keep_partial=part.keep_partial)
    with _terminal.progress("reading") as report_progress:
        written = write_tensor(
            video,
            output,
            frames=frames,
            step=step,
            stride=stride,
            size=_parsing.size(size),
            overwrite=force,
            progress=report_progress,
        )
    if video.warning:
        typer.echo(f"warning: {video.warning}", err=True)
    time_step = "no time step" if written.time_step_s is None else f"time step {written.time_step_s:.6g} s"
    typer.echo(f"{output}: {'x'.join(map(str, written.shape))}, {time_step}", err=True)
