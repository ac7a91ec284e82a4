"""The numbers that the publication prints, each with its location (facts only)."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

from iris_sysid.benchmark.sources.reading import read_columns
from iris_sysid.errors import DataError

WORDS = {"three": 3.0, "four": 4.0, "five": 5.0}
VALUES = Path(__file__).parent / "values.csv"


@dataclass(frozen=True, slots=True)
class PublishedValue:
    """One printed number: its location (label of the table or section, line of the source) and its meaning.

    ``setting`` is empty where the number covers all settings. ``printed`` keeps the digits as they are printed;
    ``bold`` says whether it is printed as the best of its row.
    """

    place: str
    line: int
    dataset: str
    phenomenon: str
    setting: str
    parameter: str
    column: str
    printed: str
    unit: str
    bold: bool

    @property
    def number(self) -> float:
        """The printed number."""
        return WORDS.get(self.printed.lower()) or float(self.printed)

    @property
    def tolerance(self) -> float:
        """Half a unit of the last printed digit: what rounding alone can explain."""
        if self.printed.lower() in WORDS:
            return 0.0
        digits, _, exponent = self.printed.lower().partition("e")
        decimals = len(digits.partition(".")[2])
        return float(0.5 * 10.0 ** (int(exponent or 0) - decimals))

    @property
    def key(self) -> str:
        """Name of this number, unique among all."""
        parts = (self.place, self.dataset, self.phenomenon, self.setting, self.parameter, self.column)
        return "/".join(part for part in parts if part)


def published_values() -> pd.DataFrame:
    """Every transcribed number as a table: key, location, meaning, as printed, as a number, its tolerance."""
    return pd.DataFrame(
        [
            {"key": value.key, "place": value.place, "line": value.line, "dataset": value.dataset}
            | {
                "phenomenon": value.phenomenon,
                "setting": value.setting,
                "parameter": value.parameter,
                "column": value.column,
            }
            | {"printed": value.printed, "number": value.number, "tolerance": value.tolerance, "unit": value.unit}
            | {"bold": value.bold}
            for value in all_values()
        ]
    )


@cache
def all_values() -> tuple[PublishedValue, ...]:
    """Every transcribed number, in the order of the publication's tables, then of its text."""
    frame = read_columns(VALUES, [field.name for field in fields(PublishedValue)])
    return tuple(
        PublishedValue(**{**_texts(row), "line": int(row["line"]), "bold": row["bold"] == "yes"})
        for row in frame.to_dict("records")
    )


def values_at(place: str, column: str | None = None) -> Iterator[PublishedValue]:
    """The numbers of one table or section (and, when given, of one column of it), in printed order."""
    return (value for value in all_values() if value.place == place and column in (None, value.column))


def sibling(value: PublishedValue, column: str, place: str | None = None) -> PublishedValue:
    """The number in another column of the same row (of another table, when place is given); DataError if absent."""
    row = (value.dataset, value.phenomenon, value.setting, value.parameter)
    for candidate in values_at(place or value.place, column):
        if (candidate.dataset, candidate.phenomenon, candidate.setting, candidate.parameter) == row:
            return candidate
    raise DataError(f"{place or value.place} prints no {column} for {'/'.join(row)}")


def _texts(row: Mapping[Hashable, Any]) -> dict[str, Any]:
    return {str(name): value for name, value in row.items()}
