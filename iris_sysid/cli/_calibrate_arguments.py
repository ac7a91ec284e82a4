"""The options of ``iris-sysid calibrate``, in groups."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

Text = str | None


@dataclass(frozen=True)
class BoardArguments:
    """The board and its position."""

    board: Annotated[Text, typer.Option(help="Inner corners, columns x rows: 9x6 for 10 x 7 squares.")] = None
    square: Annotated[Text, typer.Option(help="Measured side of a square: 25mm or 25.0+-0.1mm.")] = None
    marker: Annotated[str, typer.Option(help="Side of a marker, for a ChArUco board.")] = ""
    dictionary: Annotated[str, typer.Option(help="Marker dictionary, by its OpenCV name.")] = "4x4_50"
    plane_view: Annotated[
        Text, typer.Option(help="View in the plane of motion: frame number, image counted from 1, or a file.")
    ] = None
    offset: Annotated[
        Text, typer.Option(help="Distance of the board behind the plane of motion: 5cm+-2mm; negative in front.")
    ] = None
    distance: Annotated[
        Text, typer.Option(help="Distance from the camera to the board, with --one-image and --offset: 2m+-1cm.")
    ] = None
    up: Annotated[str, typer.Option(help="Upward direction: image, or board (its edge closest to that).")] = "image"
    one_image: Annotated[
        bool, typer.Option("--one-image", help="Calibrate the plane from one image, without a camera.")
    ] = False


@dataclass(frozen=True)
class CameraArguments:
    """A known camera, and what was done to its images."""

    camera: Annotated[Path | None, typer.Option(help="Use the camera of this calibration.json.")] = None
    resized: Annotated[Text, typer.Option(help="The clip was resized from that camera's images to WIDTHxHEIGHT.")] = (
        None
    )
    cropped: Annotated[Text, typer.Option(help="The clip was cropped from that camera's images to x,y,w,h.")] = None
