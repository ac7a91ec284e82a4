"""Parse option texts into the library's values: ``gravity=9.79+-0.01``, ``10,20,300,200``."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Literal, TypeVar, cast, get_args

from iris_sysid.errors import CalibrationError, DataError
from iris_sysid.io.files import origin_of
from iris_sysid.types import (
    Calibration,
    ComponentKind,
    Estimate,
    Sensor,
    TrackMark,
    TrackOptions,
    Trajectory,
    Transfer,
    transfer_tagged,
)
from iris_sysid.units import (
    FRACTIONS,
    LENGTH_EXAMPLE,
    LENGTHS,
    NUMBER,
    SETTINGS,
    Measure,
    parse_measure,
    parse_numbers,
)

if TYPE_CHECKING:
    from iris_sysid.calibration.board.board import Board

SETTING = re.compile(r"([A-Za-z_][A-Za-z0-9_]*)=(.*)", re.DOTALL)
SETTING_EXAMPLE = "gravity=9.79 or ball_radius=33.5+-0.5mm"
MARKS = ("pivot", "launch", "plumb")
PLUMB = "plumb="
AT_FRAME = "@"  # in a mark: of a body, in one frame
ANY_UNIT: Mapping[str, str] = MappingProxyType({})
Value = TypeVar("Value")


def settings(texts: Sequence[str], units: Mapping[str, str] = ANY_UNIT) -> dict[str, Estimate]:
    """Read ``name=value``, with or without ``+-standard error`` and a unit, into estimates by name.

    Lengths in mm and cm are converted to m, angles in deg to rad. ``units`` gives the unit of each name: a value
    without a unit is in that unit, and a value of another kind (an angle for a length) is refused; px may replace m.
    Raises a DataError that shows the right form.
    """
    values = _each_once((_setting(text) for text in texts), "setting")
    return {name: _in_unit(name, value, units.get(name, "")) for name, value in values.items()}


def _setting(text: str) -> tuple[str, Estimate]:
    match = SETTING.fullmatch(text.strip())
    if match is None:
        raise DataError(f"cannot read the setting {text!r}: write it as {SETTING_EXAMPLE}")
    try:
        value, stderr, unit = parse_measure(match[2], ("", *SETTINGS), SETTING_EXAMPLE)
    except DataError as error:
        raise DataError(f"cannot read the setting {text!r}: {error}") from error
    return match[1], Estimate(value, stderr, unit, "direct", f"given: {text.strip()}")


def _in_unit(name: str, value: Estimate, unit: str) -> Estimate:
    if not unit or value.unit.replace("px", "m") == unit:
        return value
    if value.unit:
        raise DataError(f"{name} is in {unit}, not in {value.unit} ({value.source})")
    return replace(value, unit=unit)


def _each_once(pairs: Iterable[tuple[str, Value]], what: str) -> dict[str, Value]:
    values: dict[str, Value] = {}
    for name, value in pairs:
        if name in values:
            raise DataError(f"the {what} {name!r} is given twice; give it once")
        values[name] = value
    return values


def numbers(text: str | None, names: str) -> tuple[float, ...] | None:
    """Read comma-separated numbers, one for each of the comma-separated names; None stays None."""
    return None if text is None else parse_numbers(text, names)


def fraction(text: str) -> float:
    """Read a relative standard error: ``0.01%`` or ``50ppm``."""
    return parse_measure(text, FRACTIONS, "0.01% or 50ppm").value


def transfer(text: str | None) -> Transfer | None:
    """Read ``srgb``, ``gamma=2.2`` or ``bt709+-5%``: the curve of a camera and the relative error of its exponent."""
    if text is None:
        return None
    name, plus_minus, error = (part.strip() for part in text.lower().partition("+-"))
    try:
        curve = transfer_tagged(name)
    except ValueError:
        curve = None
    if curve is None:
        raise DataError(f"cannot read the transfer function {text!r}: write srgb, bt709, linear, hlg, pq or gamma=2.2")
    return replace(curve, source="given", stderr=fraction(error) if plus_minus else curve.stderr)


def region(text: str | None) -> tuple[int, int, int, int] | None:
    """Read ``x,y,width,height`` in px."""
    values = numbers(text, "x,y,width,height")
    if values is None:
        return None
    x, y, width, height = (round(value) for value in values)
    if width < 1 or height < 1:
        raise DataError(f"the region {text!r} is empty: its width and height must be at least 1 px")
    return x, y, width, height


def marks(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Read ``pivot=437,42`` into points in px by name.

    A ``plumb`` line is read by :func:`plumb_line`, a body in one frame by :func:`body_marks`.
    """
    return _each_once((_mark(text) for text in texts if not (text.startswith(PLUMB) or AT_FRAME in text)), "mark")


def body_marks(texts: Sequence[str]) -> tuple[TrackMark, ...]:
    """Read ``1=120,88@35`` among marks: that body is at 120, 88 px in the frame of number 35."""
    return tuple(_body_mark(text) for text in texts if AT_FRAME in text)


def _body_mark(text: str) -> TrackMark:
    match = re.fullmatch(rf"([^=@,]++)=\s*+({NUMBER})\s*+,\s*+({NUMBER})\s*+@\s*+([0-9]{{1,9}}+)\s*+", text)
    if match is None or not match[1].strip():
        raise DataError(f"cannot read the mark {text!r}: write it as 1=120,88@35 (body=x,y@frame)")
    return TrackMark(match[1].strip(), float(match[2]), float(match[3]), int(match[4]))


def plumb_line(texts: Sequence[str]) -> tuple[float, float, float, float] | None:
    """Read ``plumb=x1,y1,x2,y2`` among marks: two points of a plumb line in px, upper end first."""
    lines = [text.removeprefix(PLUMB) for text in texts if text.startswith(PLUMB)]
    if len(lines) > 1:
        raise DataError("the mark 'plumb' is given twice; give it once")
    return two_points(lines[0]) if lines else None


def two_points(text: str) -> tuple[float, float, float, float]:
    """Read ``x1,y1,x2,y2`` in px."""
    x1, y1, x2, y2 = parse_numbers(text, "x1,y1,x2,y2")
    return x1, y1, x2, y2


def _mark(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, point = text.partition("=")
    if name not in MARKS or not equals:
        raise DataError(f"cannot read the mark {text!r}: write it as {MARKS[0]}=437,42; marks are {', '.join(MARKS)}")
    x, y = parse_numbers(point, "x,y")
    return name, (x, y)


def vertical(text: str) -> Literal["assumed", "motion"]:
    """Read the method for the direction of gravity."""
    if text not in ("assumed", "motion"):
        raise DataError(f"the vertical is assumed or taken from the motion, not {text!r}; write assumed or motion")
    return "motion" if text == "motion" else "assumed"


def sensor(text: str | None) -> Sensor | None:
    """Read the kind of sensor; None where none is stated."""
    if text is None:
        return None
    for kind in get_args(Sensor):
        if text == kind:
            return cast("Sensor", kind)
    raise DataError(f"there is no sensor {text!r}; write {', '.join(get_args(Sensor))}")


def components(texts: Sequence[str]) -> tuple[ComponentKind, ...]:
    """Read the kinds of parts of a residual."""
    kinds = get_args(ComponentKind)
    for text in texts:
        if text not in kinds:
            raise DataError(f"there is no part of a residual called {text!r}; write {', '.join(kinds)}")
    return tuple(dict.fromkeys(cast("Sequence[ComponentKind]", texts)))


def size(text: str) -> tuple[int, int]:
    """Read ``WIDTHxHEIGHT`` in px."""
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if match is None:
        raise DataError(f"cannot read the size {text!r}: write it as 1280x720")
    return int(match.group(1)), int(match.group(2))


def board(corners: str | None, square: str | None, marker: str = "", dictionary: str = "4x4_50") -> Board:
    """Read a board: inner corners as columns x rows, ``9x6``, and the side of a square, ``25.0+-0.1mm``.

    Parameters
    ----------
    corners, square
        As typed; both are needed.
    marker
        Side of a marker of a ChArUco board; empty for a plain checkerboard.
    dictionary
        Name of the markers' dictionary, as OpenCV has it without ``DICT_``.

    Raises
    ------
    DataError
        When a text is missing or cannot be read.
    CalibrationError
        When they do not define a board.
    """
    from iris_sysid.calibration.board.board import BOARD_HELP, Board

    if corners is None or square is None:
        raise DataError("a board needs both --board 9x6 and --square 25mm, measured on the print")
    match = re.fullmatch(r"\s*([0-9]{1,3})\s*[x×,]\s*([0-9]{1,3})\s*", corners)
    if match is None:
        raise DataError(f"cannot read the board {corners!r}: {BOARD_HELP}")
    side = length(square)
    marker_m = length(marker).value if marker else None
    return Board(int(match[1]), int(match[2]), side.value, side.stderr, marker_m, dictionary)


def length(text: str, example: str = LENGTH_EXAMPLE) -> Measure:
    """Read a length with or without its standard error, in m."""
    return parse_measure(text, LENGTHS, example)


def effects(texts: Sequence[str]) -> dict[str, float]:
    """Read ``quadratic-drag=0.08`` into effect sizes by name."""
    return _each_once(map(_effect, texts), "effect")


def _effect(text: str) -> tuple[str, float]:
    match = re.fullmatch(rf"([a-z][a-z0-9-]*)=({NUMBER})", text.strip())
    if match is None:
        raise DataError(f"cannot read the effect {text!r}: write it as quadratic-drag=0.08")
    return match.group(1), float(match.group(2))


def calibration_of(
    scale: str | None, scale_bar: str | None, file: Path | None
) -> tuple[Estimate | None, Calibration | None]:
    """Read ``--scale``, ``--scale-bar`` and ``--calibration``: gravity, which then gives the scale, or a calibration.

    CalibrationError when several are given, or one cannot be read.
    """
    from iris_sysid.calibration.pixel_scale import scale_bar_from_text, scale_from_text

    if sum(option is not None for option in (scale, scale_bar, file)) > 1:
        raise CalibrationError("give one of --scale, --scale-bar and --calibration, not several")
    if scale is not None and scale.startswith("gravity="):
        return settings([scale], {"gravity": "m/s^2"})["gravity"], None
    if scale is not None:
        return None, scale_from_text(scale)
    if scale_bar is not None:
        return None, scale_bar_from_text(scale_bar)
    if file is None:
        return None, None
    from iris_sysid.calibration.calibration_json import read_calibration  # imported here, because it loads pydantic

    return None, read_calibration(file)


def metres_of(scale: str | None, scale_bar: str | None, file: Path | None, *, needed: bool) -> Calibration | None:
    """The calibration for positions in m that are not fitted; CalibrationError when one is ``needed`` and none given.

    Gravity gives no scale here.
    """
    from_gravity, calibration = calibration_of(scale, scale_bar, file)
    if from_gravity is not None:
        raise CalibrationError("gravity gives the scale of a fitted flight only; use iris-sysid run for that")
    if needed and calibration is None:
        raise CalibrationError("positions in m need --calibration, --scale or --scale-bar")
    return calibration


def track_options(
    bodies: int,
    roi: str | None,
    colour: str | None,
    progress: Callable[[int, int], None] | None = None,
    *,
    curve: str | None = None,
) -> TrackOptions:
    """The options of any tracker; ``curve`` is the camera's transfer function."""
    return TrackOptions(bodies=bodies, roi=region(roi), colour=colour, progress=progress, transfer=transfer(curve))


def with_clip_settings(
    clips: Sequence[Trajectory], paths: Sequence[Path], texts: Sequence[str], units: Mapping[str, str]
) -> list[Trajectory]:
    """The clips with what is known of single ones: ``heavy.csv:mass=0.2``, or ``2:mass=0.2`` for the second.

    A clip is called by its path where each path is one clip. ``units`` are those of the model's parameters by name.
    """
    numbers = {str(k): k for k in range(1, len(clips) + 1)}
    if len(paths) == len(clips):
        numbers |= {str(path): k for k, path in enumerate(paths, start=1)}
    given: list[list[str]] = [[] for _ in clips]
    for text in texts:
        which, _, setting = text.rpartition(":")
        if which not in numbers:
            raise DataError(f"--clip-set {text!r:.80}: write it as 2:mass=0.2, with one of {', '.join(numbers)}")
        given[numbers[which] - 1].append(setting)
    return [
        clip.with_(known={**clip.known, **settings(own, units)}) if own else clip
        for clip, own in zip(clips, given, strict=True)
    ]


def with_options(trajectory: Trajectory, **options: object) -> Trajectory:
    """The trajectory with the command's options and the package versions in its origin."""
    earlier = trajectory.origin.get("options")
    origin = origin_of(None, {**(earlier if isinstance(earlier, dict) else {}), **options})
    changed = {key: origin[key] for key in ("options", "versions", "python")}
    return trajectory.with_(origin={**trajectory.origin, **changed})
