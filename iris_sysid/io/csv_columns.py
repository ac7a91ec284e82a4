"""Column names of a trajectory table: ``[sigma_][smooth_|d_]<name>_<unit>``, and the units they may end in.

``theta_rad`` is a quantity, ``sigma_theta_rad`` its standard error, ``smooth_theta_rad`` and ``d_theta_rad_s`` its
smoothed value and rate; ``u_V``, ``u1_V``, ``u2_m3_s`` are inputs. The longest unit that fits counts: ``x_m_s`` is x
in m/s.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import combinations
from typing import Literal

from iris_sysid.errors import DataError
from iris_sysid.types import Quantity

Part = Literal["measured", "smooth", "rate"]
Key = tuple[str, bool, str]  # part, whether it is a standard error, name

# How a unit is written at the end of a name: the unit it is kept in, and the factor to that unit.
BASE_UNITS: dict[str, tuple[str, float]] = {
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180),
    "m": ("m", 1.0),
    "cm": ("m", 0.01),
    "mm": ("m", 0.001),
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
    "kg": ("kg", 1.0),
    "K": ("K", 1.0),
    "Pa": ("Pa", 1.0),
    "kPa": ("Pa", 1000.0),
    "W": ("W", 1.0),
    "m2": ("m^2", 1.0),
    "m3": ("m^3", 1.0),
    "L": ("m^3", 0.001),
}
UNITS = {
    suffix + ending: ((unit or "1") + per if per else unit, factor)
    for suffix, (unit, factor) in BASE_UNITS.items()
    for ending, per in (("", ""), ("_s", "/s"), ("_s2", "/s^2"), ("_s3", "/s^3"))
}

PATTERN = re.compile(
    r"(?P<sigma>sigma_)?(?P<part>smooth_|d_)?(?P<name>[^\W\d_]\w*?)_(?P<suffix>"
    + "|".join(sorted(UNITS, key=len, reverse=True))
    + ")"
)
PARTS: dict[str | None, Part] = {None: "measured", "smooth_": "smooth", "d_": "rate"}
INPUT = re.compile(r"u[0-9]*")
GREEK = ("alpha", "beta", "gamma", "delta", "theta", "phi", "psi", "omega")


@dataclass(frozen=True, slots=True)
class Column:
    """What one column holds: ``name`` in ``unit``, after multiplication by ``factor``."""

    header: str
    name: str
    unit: str
    factor: float
    part: Part
    is_sigma: bool

    @property
    def is_input(self) -> bool:
        """Whether it is a known input u(t)."""
        return INPUT.fullmatch(self.name) is not None

    @property
    def key(self) -> Key:
        """What no two columns of a table may have in common."""
        return (self.part, self.is_sigma, self.name)

    @property
    def quantity(self) -> Quantity:
        """Name and unit, with the LaTeX symbol that the name suggests."""
        return Quantity(self.name, self.unit, symbol_of(self.name))


def parse_column(header: str) -> Column:
    """Take a column's name apart; DataError explains the grammar where it does not follow it."""
    match = PATTERN.fullmatch(header)
    if match is None:
        raise DataError(
            f"column {header!r:.60} is not <name>_<unit>{_nearest(header):.60}; units are {', '.join(BASE_UNITS)}"
        )
    unit, factor = UNITS[match["suffix"]]
    return Column(header, match["name"], unit, factor, PARTS[match["part"]], match["sigma"] is not None)


def _nearest(header: str) -> str:
    name, _, ending = header.rpartition("_")
    spelled = {"degrees": "deg", "degree": "deg", "radians": "rad", "meters": "m", "metres": "m", "pixels": "px"}
    close = spelled.get(ending.lower()) or next(iter(get_close_matches(ending, BASE_UNITS, n=1)), None)
    return f" (is {name}_{close} meant?)" if name and close else ""


def column_of(quantity: Quantity, *, is_input: bool = False) -> str:
    """The quantity's column name; DataError when it would not be read back as the same quantity, or role."""
    header = quantity.column
    column = parse_column(header)
    as_written = column.name == quantity.name and column.part == "measured" and not column.is_sigma
    if not as_written or header == "t_s" or header.startswith("cov_"):
        raise DataError(f"a table cannot hold the quantity {quantity.name!r}: {header!r} would be read as another one")
    if column.is_input != is_input:
        role = "an input is named u, u1, u2, ..." if is_input else "that is the name of an input; rename it"
        raise DataError(f"a table cannot hold the {'input' if is_input else 'quantity'} {quantity.name!r}: {role}")
    return header


def rate_of(unit: str) -> str:
    """The unit of a quantity's rate of change: ``m/s`` for ``m``, ``m/s^2`` for ``m/s``, ``1/s`` for no unit."""
    base, _, per = unit.partition("/s")
    power = int(per.removeprefix("^") or 1) + 1 if "/s" in unit else 1
    return f"{base or '1'}/s" + (f"^{power}" if power > 1 else "")


def state_columns(quantities: Sequence[Quantity]) -> list[str]:
    """Columns of the smoothed state: the value of every quantity, then the rate of every quantity."""
    rates = [Quantity(quantity.name, rate_of(quantity.unit)) for quantity in quantities]
    return [f"smooth_{one.column}" for one in quantities] + [f"d_{one.column}" for one in rates]


def covariance_columns(quantities: Sequence[Quantity]) -> dict[str, tuple[int, int]]:
    """Columns of the covariance between two parts of the smoothed state, and which two."""
    headers = state_columns(quantities)
    pairs = combinations(range(len(headers)), 2)
    return {f"cov_{headers[one]}_{headers[other]}": (one, other) for one, other in pairs}


def symbol_of(name: str) -> str:
    r"""The LaTeX symbol that a name suggests: ``theta1`` gives ``\theta_{1}``."""
    letters, digits = re.fullmatch(r"(.*?)([0-9]*)", name, re.S).groups()  # type: ignore[union-attr]  # always matches
    symbol = f"\\{letters}" if letters in GREEK else letters
    return f"{symbol}_{{{digits}}}" if digits else symbol
