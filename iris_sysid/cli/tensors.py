"""The command ``iris-sysid tensors``."""

from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Fps, KeepPartial, Output, Start, Stop, Video


def tensors(
    clip: Video,
    output: Output,
    frames: Annotated[int, typer.Option(help="Pictures in a window.", min=1)] = 10,
    step: Annotated[int, typer.Option(help="Frames of the clip from one picture of a window to the next.", min=1)] = 6,
    stride: Annotated[int, typer.Option(help="Frames from the start of a window to that of the next.", min=1)] = 1,
    size: Annotated[str, typer.Option(help="Width and height in px.")] = "100x56",
    fps: Fps = None,
    start: Start = None,
    stop: Stop = None,
    keep_partial: KeepPartial = False,
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
    video = open_video(clip, fps=fps, start_s=start, stop_s=stop, keep_partial=keep_partial)
    with _terminal.progress("reading") as report_progress:
        told = write_tensor(
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
    step_said = "no time step" if told.time_step_s is None else f"time step {told.time_step_s:.6g} s"
    typer.echo(f"{output}: {'x'.join(map(str, told.shape))}, {step_said}", err=True)
