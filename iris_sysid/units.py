"""Units and numbers as a user types them: ``5cm+-2mm``, ``398.7(5)px``, ``9.79+-0.01m/s^2``, ``640px=1m``.

Every table of units and every pattern of a number is here. The command line reads text with these functions; the
library takes numbers.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Mapping
from types import MappingProxyType
from typing import NamedTuple

from iris_sysid.errors import DataError

# how a unit is spelled -> the unit that values are kept in, and the factor to it
UNITS: Mapping[str, tuple[str, float]] = MappingProxyType(
    {
        "": ("", 1.0),
        "%": ("", 0.01),
        "ppm": ("", 1e-6),
        "rad": ("rad", 1.0),
        "deg": ("rad", math.pi / 180),
        "m": ("m", 1.0),
        "cm": ("m", 0.01),
        "mm": ("m", 0.001),
        "km": ("m", 1000.0),
        "in": ("m", 0.0254),
        "ft": ("m", 0.3048),
        "px": ("px", 1.0),
        "1": ("", 1.0),
        "grey": ("grey", 1.0),
        "lx": ("lx", 1.0),
        "s": ("s", 1.0),
        "ms": ("s", 0.001),
        "Hz": ("Hz", 1.0),
        "V": ("V", 1.0),
        "mV": ("V", 0.001),
        "A": ("A", 1.0),
        "mA": ("A", 0.001),
        "N": ("N", 1.0),
        "N_m": ("N m", 1.0),
        "kg": ("kg", 1.0),
        "K": ("K", 1.0),
        "Pa": ("Pa", 1.0),
        "kPa": ("Pa", 1000.0),
        "W": ("W", 1.0),
        "m2": ("m^2", 1.0),
        "m3": ("m^3", 1.0),
        "L": ("m^3", 0.001),
    }
)
# what may be written where: names of UNITS, or rates of them
LENGTHS = ("m", "cm", "mm")
ANGLES = ("rad", "deg")
FRACTIONS = ("ppm", "%")
SETTINGS = (*LENGTHS, "px", *ANGLES, "m/s", "rad/s", "deg/s", "m/s^2", "px/s^2", "1/s")
OSP_LENGTHS = ("", *LENGTHS, "km", "in", "ft")  # "": the file does not say, metres are meant
NOT_IN_COLUMNS = ("", "%", "ppm", "km", "in", "ft")
COLUMN_UNITS = tuple(unit for unit in UNITS if unit not in NOT_IN_COLUMNS)

# possessive (++): a match of a long text must not take the square of its length; exponents of at most 6 digits are read
UNSIGNED = r"(?:[0-9]++\.?+[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]{1,6}+(?![0-9]))?"
NUMBER = rf"[-+]?{UNSIGNED}"
# 1/s only after a space: in 0.31/s nobody can tell the number from the unit
UNIT = r"[^\W\d_]++(?:/s(?:\^[0-9])?)?|%|(?<=\s)1/s"
MEASURE = re.compile(
    rf"\s*+(?P<value>{NUMBER})(?:\((?P<last_digits>[0-9]++\.?+[0-9]*+)\))?\s*+(?P<unit>{UNIT})?\s*+"
    rf"(?:(?:\+-|\+/-|±)\s*+(?P<stderr>{UNSIGNED})\s*+(?P<error_unit>{UNIT})?\s*+)?"
)
LENGTH_EXAMPLE = "25mm or 25.0+-0.1mm"
SCALE_EXAMPLE = "640px=1m, 398.7(5)px=100cm or 640+-3px=1m"
BAR_EXAMPLE = "x1,y1,x2,y2=length in px and m, cm or mm, e.g. 272.2,446.1,273.2,47.4=1m"


class Measure(NamedTuple):
    """A ``value`` with its standard error (0 where none is stated), both in ``unit``; see ``UNITS``."""

    value: float
    stderr: float
    unit: str


def base_unit(spelled: str) -> tuple[str, float]:
    """The unit that values are kept in, and the factor to it: ``deg/s`` gives ``("rad/s", pi/180)``."""
    name, per, power = spelled.partition("/s")
    base, factor = UNITS[name]
    return (f"{base or '1'}/s{power}" if per else base), factor


def rate_of(unit: str) -> str:
    """The unit of a rate of change: ``m/s`` for ``m``, ``m/s^2`` for ``m/s``, ``1/s`` for no unit."""
    base, per, power = unit.partition("/s")
    order = int(power.removeprefix("^") or 1) + 1 if per else 1
    return f"{base or '1'}/s" + (f"^{order}" if order > 1 else "")


def parse_measure(text: str, units: Collection[str], example: str) -> Measure:
    """Read a value with its unit, with or without its standard error.

    The standard error follows ``+-``, ``+/-`` or ``±``, with its own unit or the value's, or stands in brackets
    for the last digits: ``398.7(5)px`` is 398.7 ± 0.5 px.

    Parameters
    ----------
    text
        As typed.
    units
        Units that may be written, e.g. ``LENGTHS``; the empty one where a number without a unit will do.
    example
        What to show when it cannot be read.

    Returns
    -------
    Measure
        In the unit that values are kept in, e.g. m.

    Raises
    ------
    DataError
        When it cannot be read, is not finite, or has no unit or another kind of unit.
    """
    match = MEASURE.fullmatch(text)
    if match is None or (match["last_digits"] and match["stderr"]):
        comma = ": decimals are written with a point" if re.search(r"[0-9],[0-9]", text) else ""
        raise DataError(f"cannot read {text.strip()!r}{comma}; write it as {example}")
    unit, error_unit = match["unit"] or match["error_unit"] or "", match["error_unit"] or match["unit"] or ""
    for spelled in (unit, error_unit):
        if spelled not in units:
            has, allowed = f"has the unit {spelled!r}" if spelled else "has no unit", ", ".join(filter(None, units))
            raise DataError(f"{text.strip()!r} {has}; units are {allowed}; write it as {example}")
    (base, factor), (error_base, error_factor) = base_unit(unit), base_unit(error_unit)
    if base != error_base:
        raise DataError(f"{text.strip()!r} and its standard error are in {base} and {error_base}; write {example}")
    value, stderr = float(match["value"]) * factor, _stderr(match) * error_factor
    if not (math.isfinite(value) and math.isfinite(stderr)):
        raise DataError(f"{text.strip()!r} is not a finite number; write it as {example}")
    return Measure(value, stderr, base)


def _stderr(match: re.Match[str]) -> float:
    digits = match["last_digits"]
    if digits is None:
        return float(match["stderr"] or 0.0)
    if "." in digits:
        return float(digits)
    mantissa, _, exponent = match["value"].lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return float(f"{digits}e{int(exponent or 0) - decimals}")


def parse_numbers(text: str, names: str) -> tuple[float, ...]:
    """Read comma-separated finite numbers, one for each of the comma-separated ``names``; DataError otherwise."""
    parts, count = text.split(","), len(names.split(","))
    numbers = tuple(float(part.strip()) for part in parts if re.fullmatch(rf"\s*{NUMBER}\s*", part))
    if not len(numbers) == len(parts) == count or not all(map(math.isfinite, numbers)):
        raise DataError(f"cannot read {text!r}: it must be {names}, e.g. {','.join(['10'] * count)}")
    return numbers


def parse_scale(text: str) -> tuple[Measure, Measure]:
    """Read ``640px=1m``, in either order: the length in px, and the same length in m.

    DataError when it cannot be read, or does not state one length in px and one in m, cm or mm.
    """
    sides = [parse_measure(side, ("px", *LENGTHS), SCALE_EXAMPLE) for side in text.split("=")]
    if sorted(side.unit for side in sides) != ["m", "px"]:
        raise DataError(f"cannot read the scale {text!r}: one side must be in px; write it as {SCALE_EXAMPLE}")
    px, metres = sorted(sides, key=lambda side: side.unit != "px")
    return px, metres


def parse_scale_bar(text: str) -> tuple[tuple[float, float], tuple[float, float], Measure]:
    """Read ``x1,y1,x2,y2=0.84m``: both ends of a scale bar (x, y) in px, and its length in m; DataError otherwise."""
    ends, _, length = text.partition("=")
    try:
        x1, y1, x2, y2 = parse_numbers(ends, "x1,y1,x2,y2")
    except DataError as error:
        raise DataError(f"cannot read the scale bar {text!r}; write it as {BAR_EXAMPLE}") from error
    return (x1, y1), (x2, y2), parse_measure(length, LENGTHS, BAR_EXAMPLE)
