"""Strict readers of the published CSV files; errors name the damaged line or the missing column."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from iris_sysid.errors import DataError
from iris_sysid.io.files import read_file

Lines = list[tuple[int, list[str]]]


def read_lines(path: str | Path) -> Lines:
    """The non-empty rows of a CSV file, each with its line number (from 1), header first.

    Raises DataError when the file cannot be read, or holds no row below the header.
    """
    path = Path(path)
    if not path.exists():
        raise DataError(f"{path} does not exist; what depends on it cannot be derived")
    try:
        text = read_file(path).decode("utf-8-sig")
        reader = csv.reader(io.StringIO(text, newline=""), strict=True)
        rows = [(reader.line_num, [field.strip() for field in row]) for row in reader]
    except UnicodeDecodeError as error:
        raise DataError(f"cannot read {path}: {error}; is it a CSV file?") from error
    except csv.Error as error:
        raise DataError(f"cannot read {path} after line {reader.line_num}: {error}") from error
    rows = [(number, row) for number, row in rows if any(row)]
    if len(rows) < 2:
        raise DataError(f"{path} holds {len(rows)} lines; expected a header line and at least one row")
    return rows


def read_columns(path: str | Path, names: Sequence[str]) -> pd.DataFrame:
    """Read the columns of these names, as text and in this order, of a CSV file whose header is as long as its rows.

    DataError when the file cannot be read, a column is absent, or a line is damaged; the text names the line.
    """
    return columns_of(read_lines(path), names, path)


def columns_of(lines: Lines, names: Sequence[str], path: str | Path) -> pd.DataFrame:
    """The named columns of the lines of a file, header first, as of :func:`read_columns`; errors name its ``path``."""
    (_, header), *rows = lines
    absent = [name for name in names if name not in header]
    if absent:
        raise DataError(f"{path} has no column {absent[0]!r}; it has {', '.join(header)[:200]}")
    for number, row in rows:
        if len(row) != len(header):
            raise DataError(f"{path} line {number} has {len(row)} fields where the header has {len(header)}")
    return pd.DataFrame({name: [row[header.index(name)] for _, row in rows] for name in names}, dtype="str")


def parse_number(text: str) -> float:
    """The number in a field; NaN for any other text."""
    try:
        return float(text)
    except ValueError:
        return math.nan
