"""The command ``iris-sysid calibrate``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Json, Output

if TYPE_CHECKING:
    from iris_sysid.cli._calibrate_request import Asked

Text = str | None


def calibrate(
    sources: Annotated[list[Path], typer.Argument(help="Pictures, a folder of them, or a clip.")],
    output: Output,
    board: Annotated[Text, typer.Option(help="Inner corners, columns x rows: 9x6 for 10 x 7 squares.")] = None,
    square: Annotated[Text, typer.Option(help="Side of a square, measured: 25mm or 25.0+-0.1mm.")] = None,
    marker: Annotated[str, typer.Option(help="Side of a marker: it is a ChArUco board.")] = "",
    dictionary: Annotated[str, typer.Option(help="The markers' dictionary, as OpenCV names it.")] = "4x4_50",
    plane_view: Annotated[
        Text, typer.Option(help="View in the plane of motion: frame number, picture counted from 1, or a file.")
    ] = None,
    offset: Annotated[
        Text, typer.Option(help="How far the board is behind the plane of motion: 5cm+-2mm; negative in front.")
    ] = None,
    distance: Annotated[Text, typer.Option(help="From the camera to the board, or without one the motion.")] = None,
    up: Annotated[str, typer.Option(help="What is up: picture, or board (its edge nearest to that).")] = "picture",
    plumb: Annotated[Text, typer.Option(help="Two points of a plumb line, upper first: x1,y1,x2,y2 in px.")] = None,
    one_picture: Annotated[
        bool, typer.Option("--one-picture", help="No camera: the plane from its view alone.")
    ] = False,
    camera: Annotated[Path | None, typer.Option(help="Take the camera from this calibration.json.")] = None,
    resized: Annotated[Text, typer.Option(help="That camera's pictures were since resized: WIDTHxHEIGHT.")] = None,
    cropped: Annotated[Text, typer.Option(help="That camera's pictures were since cropped: x,y,w,h.")] = None,
    lens: Annotated[Text, typer.Option(help="Coefficients to fit: k1,k2,p1,p2,k3; by BIC when not given.")] = None,
    free_aspect: Annotated[bool, typer.Option("--free-aspect", help="Fit fx and fy apart.")] = False,
    keep_outliers: Annotated[bool, typer.Option("--keep-outliers", help="Use views that disagree too.")] = False,
    window: Annotated[int | None, typer.Option(help="Classical corner windows of this half side, px.")] = None,
    views: Annotated[int, typer.Option(help="Frames to choose from a clip.", min=3)] = 20,
    examine: Annotated[int, typer.Option(help="Frames of a clip to look at.", min=3)] = 200,
    known: Annotated[
        Text, typer.Option("--object", help="No board: a length in the picture, 200+-1px=50.0+-0.1cm.")
    ] = None,
    ball: Annotated[Text, typer.Option(help="No board: the radius of the ball in --track, 33.5+-0.5mm.")] = None,
    track: Annotated[Path | None, typer.Option(help="track.csv of that ball.")] = None,
    edge: Annotated[float, typer.Option(help="Error of the ball's edge common to all frames, px.")] = 0.1,
    fov: Annotated[Text, typer.Option(help="No board: field of view, 60deg+-1deg, with --distance.")] = None,
    across: Annotated[str, typer.Option(help="What it is across: width, height or diagonal.")] = "width",
    tilt_error: Annotated[str, typer.Option(help="How straight the camera looks then.")] = "0deg",
    plot: Annotated[bool, typer.Option("--plot", help="Draw it, as PNG files beside the result.")] = False,
    over: Annotated[Path | None, typer.Option(help="Clip to be measured: checked, and drawn over.")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Calibrate camera and plane of motion. From a board, or by an object, a ball, or a distance.

    \b
    Example:
      iris-sysid calibrate board.mp4 --board 9x6 --square 25mm -o calibration.json --plot
    """
    from iris_sysid.cli import _calibrate_request as made

    asked: Asked = made.Asked(
        sources=tuple(sources),
        board=board,
        square=square,
        marker=marker,
        dictionary=dictionary,
        plane_view=plane_view,
        offset=offset,
        distance=distance,
        up=up,
        plumb=plumb,
        one_picture=one_picture,
        camera=camera,
        resized=resized,
        cropped=cropped,
        lens=lens,
        square_pixels=not free_aspect,
        drop_outliers=not keep_outliers,
        window=window,
        views=views,
        examine=max(examine, views),
        known=known,
        ball=ball,
        track=track,
        edge_px=edge,
        fov=fov,
        across=across,
        tilt_error=tilt_error,
        over=over,
    )
    pictures = made.plot_paths(output) if plot else ()
    for source in sources:
        _terminal.check_outputs(source, [output, *pictures], overwrite=force)
    with _terminal.progress("looking for the board") as report_progress:
        result = made.make(asked, report_progress)
    drawn = made.save(result, output, plot=plot, overwrite=force)
    typer.echo(made.text_of(result.calibration, json=json))
    for path in drawn:
        typer.echo(f"drawn: {path}", err=True)
