"""What users type, turned into what the library takes: ``gravity=9.79+-0.01``, ``10,20,300,200``, ``437,42``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal, TypeVar

from iris_sysid.calibration.calibration_json import read_calibration
from iris_sysid.calibration.pixel_scale import scale_bar_from_text, scale_from_text
from iris_sysid.errors import CalibrationError, DataError
from iris_sysid.io.files import origin_of
from iris_sysid.types import Calibration, Estimate, OdeModel, TrackOptions, Trajectory

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
SETTING = re.compile(rf"([A-Za-z_][A-Za-z0-9_]*)=({NUMBER})(?:\s*(?:\+-|\+/-|±)\s*({NUMBER}))?(.*)")
MARKS = ("pivot", "launch", "plumb")
PLUMB = "plumb="
ANY_UNIT: Mapping[str, str] = MappingProxyType({})
# what a user may write -> the unit that it is kept in, and the factor
UNITS = {
    "m": ("m", 1.0),
    "cm": ("m", 0.01),
    "mm": ("m", 0.001),
    "px": ("px", 1.0),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180),
    "m/s": ("m/s", 1.0),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180),
    "m/s^2": ("m/s^2", 1.0),
    "px/s^2": ("px/s^2", 1.0),
    "1/s": ("1/s", 1.0),
}
Value = TypeVar("Value")


def settings(texts: Sequence[str], units: Mapping[str, str] = ANY_UNIT) -> dict[str, Estimate]:
    """Read ``name=value``, with or without ``+-standard error`` and a unit, into estimates by name.

    Lengths in mm and cm come out in m, angles in deg in rad. ``units`` are those of the names that have one: a value
    without a unit is in it, and one of another kind (an angle for a length) is refused; px may stand for m. Raises
    DataError that shows what is right.
    """
    found = _each_once((_setting(text) for text in texts), "setting")
    return {name: _in_unit(name, value, units.get(name, "")) for name, value in found.items()}


def _setting(text: str) -> tuple[str, Estimate]:
    match = SETTING.fullmatch(text.strip())
    spelled = match.group(4).strip() if match else ""
    if match is None or spelled not in ("", *UNITS):
        raise DataError(
            f"cannot read the setting {text!r}: write it as gravity=9.79 or ball_radius=33.5+-0.5mm; "
            f"units are {', '.join(UNITS)}"
        )
    unit, factor = UNITS.get(spelled, ("", 1.0))
    value, stderr = float(match.group(2)) * factor, abs(float(match.group(3) or 0.0)) * factor
    if not (math.isfinite(value) and math.isfinite(stderr)):
        raise DataError(f"the setting {text!r} is not a finite number")
    return match.group(1), Estimate(value, stderr, unit, "direct", f"given: {text.strip()}")


def _in_unit(name: str, value: Estimate, unit: str) -> Estimate:
    if not unit or value.unit.replace("px", "m") == unit:
        return value
    if value.unit:
        raise DataError(f"{name} is in {unit}, not in {value.unit} ({value.source})")
    return replace(value, unit=unit)


def _each_once(pairs: Iterable[tuple[str, Value]], what: str) -> dict[str, Value]:
    found: dict[str, Value] = {}
    for name, value in pairs:
        if name in found:
            raise DataError(f"the {what} {name!r} is given twice; give it once")
        found[name] = value
    return found


def numbers(text: str | None, names: str) -> tuple[float, ...] | None:
    """Read comma-separated numbers, one for each of the comma-separated names; None stays None."""
    if text is None:
        return None
    parts = text.split(",")
    try:
        values = tuple(float(part) for part in parts)
    except ValueError:
        values = ()
    if len(values) != len(names.split(",")) or not all(math.isfinite(value) for value in values):
        raise DataError(f"cannot read {text!r}: it must be {names}, e.g. {','.join('10' for _ in names.split(','))}")
    return values


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
    """Read ``pivot=437,42`` into points in px by name; a ``plumb`` line is read by :func:`plumb_line`."""
    return _each_once((_mark(one) for one in texts if not one.startswith(PLUMB)), "mark")


def plumb_line(texts: Sequence[str]) -> tuple[float, float, float, float] | None:
    """Read ``plumb=x1,y1,x2,y2`` among marks: two points of a plumb line in px, upper end first."""
    found = [one.removeprefix(PLUMB) for one in texts if one.startswith(PLUMB)]
    if len(found) > 1:
        raise DataError("the mark 'plumb' is given twice; give it once")
    ends = numbers(found[0], "x1,y1,x2,y2") if found else None
    return None if ends is None else (ends[0], ends[1], ends[2], ends[3])


def _mark(text: str) -> tuple[str, tuple[float, float]]:
    name, equals, place = text.partition("=")
    if name not in MARKS or not equals:
        raise DataError(f"cannot read the mark {text!r}: write it as {MARKS[0]}=437,42; marks are {', '.join(MARKS)}")
    x, y = numbers(place, "x,y") or (math.nan, math.nan)
    return name, (x, y)


def vertical(text: str) -> Literal["assumed", "motion"]:
    """Read how gravity's direction is to be found."""
    if text not in ("assumed", "motion"):
        raise DataError(f"the vertical is assumed or taken from the motion, not {text!r}; write assumed or motion")
    return "motion" if text == "motion" else "assumed"


def size(text: str) -> tuple[int, int]:
    """Read ``WIDTHxHEIGHT`` in px."""
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if match is None:
        raise DataError(f"cannot read the size {text!r}: write it as 1280x720")
    return int(match.group(1)), int(match.group(2))


def effects(texts: Sequence[str]) -> dict[str, float]:
    """Read ``quadratic-drag=0.08`` into sizes by effect name."""
    return _each_once(map(_effect, texts), "effect")


def _effect(text: str) -> tuple[str, float]:
    match = re.fullmatch(rf"([a-z][a-z0-9-]*)=({NUMBER})", text.strip())
    if match is None:
        raise DataError(f"cannot read the effect {text!r}: write it as quadratic-drag=0.08")
    return match.group(1), float(match.group(2))


def calibration_of(
    scale: str | None, scale_bar: str | None, file: Path | None
) -> tuple[Estimate | None, Calibration | None]:
    """What ``--scale``, ``--scale-bar`` and ``--calibration`` say: gravity to take the scale from, or the calibration.

    Parameters
    ----------
    scale
        ``640px=1m``, or ``gravity=9.79``.
    scale_bar
        ``x1,y1,x2,y2=0.84m``.
    file
        calibration.json, or a ``.trk`` or ``.trz`` file of Open Source Physics Tracker.

    Raises
    ------
    CalibrationError
        When several are given, or one cannot be read.
    """
    if sum(one is not None for one in (scale, scale_bar, file)) > 1:
        raise CalibrationError("give one of --scale, --scale-bar and --calibration, not several")
    if scale is not None and scale.startswith("gravity="):
        return settings([scale], {"gravity": "m/s^2"})["gravity"], None
    if scale is not None:
        return None, scale_from_text(scale)
    if scale_bar is not None:
        return None, scale_bar_from_text(scale_bar)
    return None, None if file is None else read_calibration(file)


def metres_of(scale: str | None, scale_bar: str | None, file: Path | None, *, needed: bool) -> Calibration | None:
    """The calibration for positions in m that are not fitted; CalibrationError when one is ``needed`` and none given.

    Parameters
    ----------
    scale, scale_bar, file
        As for :func:`calibration_of`; gravity gives no scale here.
    needed
        Whether positions in m were asked for.
    """
    from_gravity, calibration = calibration_of(scale, scale_bar, file)
    if from_gravity is not None:
        raise CalibrationError("gravity gives the scale of a fitted flight only; use iris-sysid run for that")
    if needed and calibration is None:
        raise CalibrationError("positions in m need --calibration, --scale or --scale-bar")
    return calibration


def track_options(
    bodies: int, roi: str | None, colour: str | None, progress: Callable[[int, int], None] | None = None
) -> TrackOptions:
    """What any tracker is told.

    Parameters
    ----------
    bodies
        How many to follow.
    roi
        ``x,y,width,height`` in px.
    colour
        A name or ``#rrggbb``.
    progress
        Called with (frames done, frames expected).
    """
    return TrackOptions(bodies=bodies, roi=region(roi), colour=colour, progress=progress)


def units_of(model: OdeModel) -> dict[str, str]:
    """The unit of each parameter and initial state by name, for values that are typed without one."""
    return {one.name: one.unit for one in model.parameters} | {f"{one.name}_0": one.unit for one in model.states}


def asked(trajectory: Trajectory, **options: object) -> Trajectory:
    """The trajectory with what is asked of it, and the versions that will answer, in its origin."""
    before = trajectory.origin.get("options")
    now = origin_of(None, {**(before if isinstance(before, dict) else {}), **options})
    changed = {key: now[key] for key in ("options", "versions", "python")}
    return trajectory.with_(origin={**trajectory.origin, **changed})
