"""Arguments and options that commands share, spelt and explained alike everywhere."""

from pathlib import Path
from typing import Annotated

import typer

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
Marks = Annotated[
    list[str] | None, typer.Option("--mark", help="A point in px: pivot=437,42, launch=5,103; plumb=x1,y1,x2,y2.")
]
Vertical = Annotated[str, typer.Option(help="Gravity's direction: assumed, or motion (by the flight itself).")]
TimeBase = Annotated[str, typer.Option(help="Standard error of the frame rate: 0.01% or 50ppm.")]
Starts = Annotated[list[str] | None, typer.Option("--start-at", help="A starting value, e.g. length=0.5.")]
ModelName = Annotated[str, typer.Option("--model", help="Governing equation; see iris-sysid list. Or FILE.py:NAME.")]
