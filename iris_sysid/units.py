"""Measured lengths and angles as users write them: ``5cm+-2mm``, ``25.0+-0.1mm``, ``60deg+-1deg``."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from iris_sysid.errors import DataError

NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
MEASURE = re.compile(rf"\s*({NUMBER})\s*([a-z%]*)\s*(?:(?:\+-|\+/-|±)\s*({NUMBER})\s*([a-z%]*)\s*)?")
LENGTHS: Mapping[str, float] = MappingProxyType({"m": 1.0, "cm": 0.01, "mm": 0.001})  # in m
ANGLES: Mapping[str, float] = MappingProxyType({"rad": 1.0, "deg": math.pi / 180})  # in rad
SHARES: Mapping[str, float] = MappingProxyType({"ppm": 1e-6, "%": 0.01})


def measured(text: str, units: Mapping[str, float], example: str) -> tuple[float, float]:
    """Read a value with or without its standard error, each with its unit; one unit at the end may stand for both.

    Parameters
    ----------
    text
        As typed.
    units
        Their names and sizes, e.g. ``LENGTHS``.
    example
        What to show when it cannot be read.

    Returns
    -------
    value, stderr : float
        In the unit whose size is 1; the standard error is 0 when none is given.

    Raises
    ------
    DataError
        When it cannot be read, or has no unit or another kind of unit.
    """
    match = MEASURE.fullmatch(text)
    if match is None:
        raise DataError(f"cannot read {text!r}; write it as {example}")
    value, unit, stderr, error_unit = match.groups(default="")
    unit, error_unit = unit or error_unit, error_unit or unit
    if unit not in units or error_unit not in units:
        raise DataError(f"{text!r} needs a unit, {', '.join(units)}; write it as {example}")
    numbers = float(value) * units[unit], abs(float(stderr or 0)) * units[error_unit]
    if not all(map(math.isfinite, numbers)):
        raise DataError(f"{text!r} is not a finite number; write it as {example}")
    return numbers
