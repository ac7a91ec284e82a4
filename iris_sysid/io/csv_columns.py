"""Column names of a trajectory table: ``[sigma_][smooth_|d_]<name>_<unit>``, and the units they may end in.

``theta_rad`` is a quantity, ``sigma_theta_rad`` its standard error, ``smooth_theta_rad`` and ``d_theta_rad_s`` its
smoothed value and rate; ``u_V``, ``u1_V``, ``u2_m3_s`` are inputs, and so is ``u``, which has no unit. The longest
unit that fits counts: ``x_m_s`` is x in m/s.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from itertools import combinations
from typing import Literal

from iris_sysid.errors import DataError
from iris_sysid.types import Quantity, symbol_of
from iris_sysid.units import COLUMN_UNITS, base_unit, rate_of

Part = Literal["measured", "smooth", "rate"]
Key = tuple[str, bool, str]  # part, whether it is a standard error, name

# How a unit ends a column's name: the unit it is kept in, and the factor to that unit.
SUFFIXES = {
    f"{name}{ending}": base_unit(f"{name}{per}")
    for name in COLUMN_UNITS
    for ending, per in (("", ""), ("_s", "/s"), ("_s2", "/s^2"), ("_s3", "/s^3"))
}

PATTERN = re.compile(
    r"(?P<sigma>sigma_)?(?P<part>smooth_|d_)?(?P<name>[^\W\d_]\w*?)_(?P<suffix>"
    + "|".join(sorted(SUFFIXES, key=len, reverse=True))
    + ")"
)
PARTS: dict[str | None, Part] = {None: "measured", "smooth_": "smooth", "d_": "rate"}
INPUT = re.compile(r"u[0-9]*")
COUNTS = ("count", "counts")  # of a counter: they have no unit, as an input may have none


@dataclass(frozen=True, slots=True)
class Column:
    """The quantity of one column: ``name`` in ``unit``, after multiplication by ``factor``."""

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
    is_number = header in COUNTS or INPUT.fullmatch(header) is not None
    match = PATTERN.fullmatch(f"{header}_1" if is_number else without_slash(header))
    if match is None or ("/" in header and "_" not in match["suffix"]):  # v_ft/s is not v_ft in s
        raise DataError(
            f"column {header!r:.60} is not <name>_<unit>{_nearest(header):.60}; units are {', '.join(COLUMN_UNITS)}"
        )
    unit, factor = SUFFIXES[match["suffix"]]
    return Column(header, match["name"], unit, factor, PARTS[match["part"]], match["sigma"] is not None)


def without_slash(text: str) -> str:
    """A unit per second, or a name that ends in one, as the name of a column has it: ``w_rad_s`` for ``w_rad/s``."""
    return text.replace("/s^", "_s").replace("/s", "_s")


def _nearest(header: str) -> str:
    name, _, ending = header.rpartition("_")
    close = next(iter(get_close_matches(ending, COLUMN_UNITS, n=1)), None)
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


def state_columns(quantities: Sequence[Quantity]) -> list[str]:
    """Columns of the smoothed state: the value of every quantity, then the rate of every quantity."""
    rates = [Quantity(quantity.name, rate_of(quantity.unit)) for quantity in quantities]
    return [f"smooth_{quantity.column}" for quantity in quantities] + [f"d_{quantity.column}" for quantity in rates]


def covariance_columns(quantities: Sequence[Quantity]) -> dict[str, tuple[int, int]]:
    """Columns of the covariance between two parts of the smoothed state, and which two."""
    headers = state_columns(quantities)
    pairs = combinations(range(len(headers)), 2)
    return {f"cov_{headers[first]}_{headers[second]}": (first, second) for first, second in pairs}
