"""The command ``iris-sysid frame``."""

from typing import Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Fps, Output, Video


def frame(
    video: Video,
    output: Output,
    number: Annotated[int | None, typer.Option("--frame", help="Number of the frame, from 0.", min=0)] = None,
    time: Annotated[float | None, typer.Option(help="Time in s: the first frame at or after it.")] = None,
    fps: Fps = None,
    force: Force = False,
) -> None:
    """Draw one frame of a clip with a grid of pixel coordinates, for marks, scale bars and regions. Writes a PNG file.

    \b
    Example:
      iris-sysid frame pendulum.mp4 -o frame.png --time 1.5
    """
    from iris_sysid.errors import DataError, VideoError
    from iris_sysid.report.frame_sheet import write_frame
    from iris_sysid.video.reader import open_video

    _terminal.check_outputs(video, [output], overwrite=force)
    _terminal.check_suffix(output, ".png")
    if number is not None and time is not None:
        raise DataError("give --frame or --time, not both")
    clip = open_video(video, fps=fps, start_s=time, keep_partial=True)
    shown = next((image for image in clip.frames() if image.index >= (number or 0)), None)
    if shown is None:
        raise VideoError(f"{video} has {clip.decoded} frames, numbered from 0; there is no frame {number}")
    title = f"{video.name}: frame {shown.index}, {shown.t_s:.4f} s, {clip.width} x {clip.height} px"
    write_frame(shown, output, title=title, overwrite=force)
    typer.echo(f"{output}: {title}", err=True)
    same = ["--scale-bar", "X1,Y1,X2,Y2=LENGTH", *([] if fps is None else ["--fps", fps])]
    _terminal.suggest("run", video, "--phenomenon", "NAME", *same, "-o", output.with_name("run"))
