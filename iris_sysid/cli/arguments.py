"""Arguments and options that several commands share, with the same name and help everywhere."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _completion

if TYPE_CHECKING:
    from iris_sysid.pipeline.one_clip import RunRequest
    from iris_sysid.types import ClipOptions, Phenomenon, Progress

Video = Annotated[Path, typer.Argument(help="Video, folder of images, GIF, or .zip/.trz that holds one.")]
TABLE = "Table with t_s and <quantity>_<unit> columns, or of another program (CSV, text, Excel, .mat, .npy)"
Table = Annotated[Path, typer.Argument(help=f"{TABLE}.")]
Columns = Annotated[
    str | None, typer.Option(help='Columns of a table of another program: "t=Time (s),theta[deg]=Angle".')
]
SampleTime = Annotated[
    str | None, typer.Option("--sample-time", help="Sample time of a table without a column of times: 4s, 20ms.")
]
Validate = Annotated[
    str | None,
    typer.Option(help="Simulate this with the fitted model, not fit it: a table, or the last share of this one, 30%."),
]
Output = Annotated[Path, typer.Option("-o", "--output", help="File or folder for the result.")]
Force = Annotated[bool, typer.Option("--force", help="Overwrite existing results.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON to stdout.")]
Strict = Annotated[
    bool,
    typer.Option("--strict", help="End with exit status 3 unless the numbers are good and the equation is complete."),
]
Fps = Annotated[float | None, typer.Option(help="True frame rate in 1/s, for slow motion.")]
Start = Annotated[float | None, typer.Option(help="Start time in s; earlier frames are skipped.")]
Stop = Annotated[float | None, typer.Option(help="Stop time in s; later frames are skipped.")]
Roi = Annotated[str | None, typer.Option(help="Region of interest: x,y,width,height in px.")]
Colour = Annotated[str | None, typer.Option("--colour", "--color", help="Colour of the body: a name or #rrggbb.")]
TransferCurve = Annotated[
    str | None,
    typer.Option(
        "--transfer",
        help="Camera's curve from light to grey levels, for brightness: srgb, bt709, linear, gamma=2.2, bt709+-5%.",
    ),
]
Bodies = Annotated[int | None, typer.Option(help="Number of bodies to track.", min=1, max=64)]
TrackerName = Annotated[
    str | None,
    typer.Option(
        "--tracker",
        help="Tracker name; see iris-sysid list. Or FILE.py:NAME.",
        autocompletion=_completion.trackers,
    ),
]
PHENOMENON = typer.Option(
    "--phenomenon",
    help="Phenomenon in the clip; see iris-sysid list. Or FILE.py:NAME.",
    autocompletion=_completion.phenomena,
)
PhenomenonName = Annotated[str, PHENOMENON]
PhenomenonAsked = Annotated[str | None, PHENOMENON]
KeepPartial = Annotated[bool, typer.Option("--keep-partial", help="Use the readable part of a damaged file.")]
SET = typer.Option("--set", help="A known value: gravity=9.79+-0.01, length=50cm.")
Settings = Annotated[list[str] | None, SET]
Equation = Annotated[
    str | None,
    typer.Option("--equation", help="Your own equation of motion: \"theta'' = -g/L*sin(theta) - c*theta'\"."),
]
Bounds = Annotated[list[str], typer.Option("--bound", help="Bounds of a parameter of --equation: L=0.1:10, or L=0: .")]
StartingValues = Annotated[list[str], typer.Option("--start-at", help="A starting value, e.g. length=0.5.")]
FREE = typer.Option("--free", help="Estimate this constant too, e.g. gravity.")
Scale = Annotated[str | None, typer.Option(help="Scale: 640px=1m; or gravity=9.79, which computes it from the fall.")]
ScaleBar = Annotated[str | None, typer.Option(help="Two points at a known distance: x1,y1,x2,y2=0.84m.")]
CalibrationFile = Annotated[Path | None, typer.Option("--calibration", help="calibration.json, or a .trk/.trz file.")]
BodyMarks = Annotated[
    list[str] | None, typer.Option("--mark", help="A body is at x, y px in a frame: 1=120,88@35. Repeat it.")
]
TimeBase = Annotated[str, typer.Option(help="Standard error of the frame rate: 0.01% or 50ppm.")]


@dataclass(frozen=True)
class WorkArguments:
    """The processes that do the work."""

    workers: Annotated[
        int | None, typer.Option("--workers", help="Number of parallel processes; default 1.", min=1, max=256)
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", help="Work on the workers of dask instead: tcp://HOST:8786, or its FILE.json."),
    ] = None


@dataclass(frozen=True)
class RecordArguments:
    """The columns and times of a table, and its inputs between the samples."""

    columns: Columns = None
    sample_time: SampleTime = None
    hold: Annotated[
        str,
        typer.Option(
            "--hold",
            help="Inputs between samples: zero (held), linear, or auto (what fits better; of plan: as diagnosed).",
            autocompletion=_completion.values("auto", "zero", "linear"),
        ),
    ] = "auto"
    keep_clipped: Annotated[
        bool, typer.Option("--keep-clipped", help="Keep readings at the end of a sensor's range, which are left out.")
    ] = False


@dataclass(frozen=True)
class ModelArguments:
    """Known values of the model, and additional estimated constants."""

    known: Annotated[list[str], SET] = field(default_factory=list)
    free: Annotated[list[str], FREE] = field(default_factory=list)


@dataclass(frozen=True)
class EquationArguments:
    """The governing equation, with its known values."""

    model: Annotated[
        str | None,
        typer.Option(
            "--model",
            help="Governing equation; see iris-sysid list. Or auto, or FILE.py:NAME.",
            autocompletion=_completion.models,
        ),
    ] = None
    equation: Equation = None
    bound: Bounds = field(default_factory=list)
    known: Annotated[list[str], SET] = field(default_factory=list)
    free: Annotated[list[str], FREE] = field(default_factory=list)


@dataclass(frozen=True)
class ClipArguments:
    """Time range and frame rate of a clip."""

    fps: Fps = None
    start: Start = None
    stop: Stop = None
    keep_partial: KeepPartial = False

    def options(self, fps_stderr: float = 0.0) -> ClipOptions:
        """The library's options; ``fps_stderr`` is the relative standard error of the frame rate."""
        from iris_sysid.types import ClipOptions

        return ClipOptions(self.fps, fps_stderr, self.start, self.stop, self.keep_partial)


@dataclass(frozen=True)
class ScaleArguments:
    """The scale from pixels to metres."""

    scale: Scale = None
    scale_bar: ScaleBar = None
    calibration: CalibrationFile = None


@dataclass(frozen=True)
class TrackerArguments:
    """The tracker and its hints."""

    roi: Roi = None
    colour: Colour = None
    tracker: TrackerName = None
    transfer: TransferCurve = None


@dataclass(frozen=True)
class FilmArguments(ModelArguments, TrackerArguments, ClipArguments, ScaleArguments):
    """How a clip is measured and fitted: its scale, its part, the tracker, the scene, the values of the model."""

    mark: Annotated[
        list[str],
        typer.Option(
            "--mark",
            help="Mark in px: a point, pivot=437,42, launch=5,103; a line, plumb=x1,y1,x2,y2; a body, 1=120,88@frame.",
        ),
    ] = field(default_factory=list)
    vertical: Annotated[
        str,
        typer.Option(
            help="Direction of gravity: assumed, or motion (estimated from the flight).",
            autocompletion=_completion.values("assumed", "motion"),
        ),
    ] = "assumed"
    time_base: TimeBase = "0%"

    def request(
        self, phenomenon: Phenomenon | None, bodies: int | None = None, progress: Progress | None = None
    ) -> RunRequest:
        """Read the options; ``phenomenon`` is None where it is still to be chosen."""
        from iris_sysid.cli import _parsing
        from iris_sysid.pipeline.one_clip import RunRequest, accepted_settings
        from iris_sysid.registry import TRACKERS
        from iris_sysid.types import GeometryOptions

        if phenomenon is not None and self.tracker is not None:
            TRACKERS.named(self.tracker)  # refuses an unknown name before the clip is opened
            phenomenon = replace(phenomenon, tracker=self.tracker)
        gravity, calibration = _parsing.calibration_of(self.scale, self.scale_bar, self.calibration)
        count = bodies or (1 if phenomenon is None else phenomenon.bodies)
        tracking = _parsing.track_options(count, self.roi, self.colour, progress, curve=self.transfer)
        return RunRequest(
            phenomenon,
            calibration=calibration,
            settings=_parsing.settings(self.known, {} if phenomenon is None else accepted_settings(phenomenon)),
            free=tuple(self.free),
            tracking=replace(tracking, marks=_parsing.body_marks(self.mark)),
            clip=self.options(_parsing.fraction(self.time_base)),
            geometry=GeometryOptions(
                marks_px=_parsing.marks(self.mark),
                plumb_px=_parsing.plumb_line(self.mark),
                vertical=_parsing.vertical(self.vertical),
                scale_from_gravity=gravity,
            ),
        )
