"""A CSV file as columns of cells, whichever program wrote it; every complaint names line, column and cell."""

from __future__ import annotations

import csv
import io
import math
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.io.files import read_file
from iris_sysid.types import Array

BLANK = frozenset({"", "nan", "NaN", "NAN", "NA", "N/A", "null", "None"})
FLAGS = {"1": 1.0, "0": 0.0, "true": 1.0, "false": 0.0, "1.0": 1.0, "0.0": 0.0} | dict.fromkeys(
    (text.lower() for text in BLANK), math.nan
)
ROWS_AT_ONCE = 5_000  # are taken apart into columns: a list a row takes three times what a cell does
BETWEEN = "\0"  # of the cells of a block: a file that holds it is refused
FIRST_LINE = 100_000  # bytes in which the header of an own table ends
UTF_16 = (b"\xff\xfe", b"\xfe\xff")


class PackedCells:
    """The cells of a column, thousands in one text: a separate text takes six times the content of a cell."""

    __slots__ = ("_blocks", "_size")

    def __init__(self) -> None:
        self._blocks: list[str] = []
        self._size = 0

    def append(self, cells: Sequence[str]) -> None:
        """Add a block of cells."""
        self._blocks.append(BETWEEN.join(cells))
        self._size += len(cells)

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, row: int) -> str:
        return next(islice(self, row, None))

    def __iter__(self) -> Iterator[str]:
        for block in self.blocks():
            yield from block

    def blocks(self) -> Iterator[list[str]]:
        """The cells, block by block."""
        return (block.split(BETWEEN) for block in self._blocks)


@dataclass(frozen=True, eq=False, slots=True)
class Sheet:
    """The cells of a file: ``columns`` by header, all of one length, and the ``lines`` they stand in.

    ``factors``: from the number in a cell to the unit of its header, where that is not 1; ``zeros``: what a cell of
    zero is in that unit, where it is not zero.
    """

    label: str
    columns: Mapping[str, list[str] | PackedCells]
    lines: Sequence[int]
    decimal_comma: bool = False
    factors: Mapping[str, float] = field(default_factory=dict)
    zeros: Mapping[str, float] = field(default_factory=dict)

    def __contains__(self, column: str) -> bool:
        return column in self.columns

    def refuse(self, column: str, row: int, problem: str) -> NoReturn:
        """Raise the DataError that says where a cell is, by column and row of data from 0, and what is wrong with it.

        The problem is put behind the cell's text.
        """
        cell = f"{self.columns[column][row].strip()!r:.44}"
        raise DataError(f"{self.label} line {self.lines[row]}, column {column}: {cell} {problem}")

    def numbers(self, column: str, *, gaps: bool = True) -> Array:
        """The column as numbers (n,), NaN for a blank cell; with ``gaps=False`` a blank cell is refused too.

        They have the unit of the column.
        """
        cells, parts = self.columns[column], list[Array]()
        for block in cells.blocks() if isinstance(cells, PackedCells) else [cells]:
            block = [cell.replace(",", ".") for cell in block] if self.decimal_comma else block
            numbers = _numbers(block)
            if numbers is None:
                wrong = next(k for k, cell in enumerate(block) if not _is_number(cell.strip()))
                self.refuse(column, sum(part.size for part in parts) + wrong, "is not a number")
            parts.append(numbers)
        values = np.concatenate(parts)
        if np.isinf(values).any():
            self.refuse(column, int(np.argmax(np.isinf(values))), "is infinite; leave the cell blank for a gap")
        if not gaps and np.isnan(values).any():
            self.refuse(column, int(np.argmax(np.isnan(values))), "is blank or not a number; every row needs one")
        scaled = values * self.factors[column] if column in self.factors else values
        return scaled + self.zeros[column] if column in self.zeros else scaled

    def amounts(self, column: str) -> Array:
        """The column as numbers that are not below zero, NaN for a blank cell.

        Shape (n,), in the unit of the column.
        """
        values = self.numbers(column)
        if np.any(values < 0):
            self.refuse(column, int(np.argmax(values < 0)), "is below zero")
        return values

    def whole_numbers(self, column: str) -> NDArray[np.int64]:
        """The column as whole numbers (n,) int64, none blank. They are counts or indices."""
        values = self.numbers(column, gaps=False)
        whole = (values == np.round(values)) & (np.abs(values) < 2**53)
        if not whole.all():
            self.refuse(column, int(np.argmin(whole)), "is not a whole number")
        return values.astype(np.int64)

    def flags(self, column: str) -> Array:
        """The column of 1/0 or true/false as 1.0 and 0.0 (n,), NaN for a blank cell. They are dimensionless."""
        cells = [cell.strip().lower() for cell in self.columns[column]]
        for row, cell in enumerate(cells):
            if cell not in FLAGS:
                self.refuse(column, row, "is neither 1 nor 0")
        return np.array([FLAGS[cell] for cell in cells])


def _numbers(cells: list[str]) -> Array | None:
    """The numbers (n,), NaN for a blank cell; None where a cell holds something else."""
    if any("_" in cell for cell in cells):  # Python reads 1_0 as 10
        return None
    try:
        return np.fromiter(map(float, cells), np.float64, len(cells))
    except ValueError:  # a blank cell, or no number
        pass
    stripped = [cell.strip() for cell in cells]
    try:
        return np.array([math.nan if cell in BLANK else float(cell) for cell in stripped], dtype=np.float64)
    except ValueError:
        return None


def _is_number(cell: str) -> bool:
    try:
        float(cell or "nan")
    except ValueError:
        return cell in BLANK
    return "_" not in cell


def is_own_table(path: str | Path) -> bool:
    """Whether the first line of a file names a column ``t_s`` or ``x_px``, as this project's tables do."""
    with suppress(OSError, ValueError):
        if not Path(path).is_file():
            return False
        with Path(path).open("rb") as file:
            start = file.read(FIRST_LINE)
        text = start.decode("utf-16" if start.startswith(UTF_16) else "utf-8-sig", errors="ignore").lstrip()
        names = {name.strip(' "') for name in re.split(r"[,;\t]", re.split(r"[\r\n]", text, maxsplit=1)[0])}
        return not names.isdisjoint(("t_s", "x_px"))
    return False


def read_sheet(path: str | Path) -> Sheet:
    """Read a CSV file: comma, semicolon or tab between cells, with decimal commas where the comma is not the separator.

    UTF-8, with or without a byte order mark, or UTF-16 with one. Blank lines are skipped, unnamed empty columns left
    out. Raises DataError for another kind of file, and for one without rows or with a row or column too many.
    """
    return sheet_of(read_file(path), str(path))


def sheet_of(data: bytes, label: str) -> Sheet:
    """The cells of a CSV file from its bytes; see :func:`read_sheet`."""
    text = _decode(data, label)
    header_line = re.split(r"[\r\n]", text.lstrip()[:FIRST_LINE], maxsplit=1)[0]
    separator = next((character for character in ",;\t" if character in header_line), ",")
    blocks = _blocks(text, separator, label)
    del text
    (_, header), *first = next(blocks, [(0, list[str]())])
    if not header:
        raise DataError(f"{label} is empty: it needs a header line, e.g. t_s,theta_rad, and a line a sample")
    lines, cells = array("q"), [PackedCells() for _ in header]
    for body in filter(None, chain([first], blocks)):
        _check_width(header, body, separator, label)
        lines.extend(line for line, _ in body)
        for column, more in zip(cells, zip(*(row for _, row in body), strict=True), strict=True):
            column.append(more)
    if not lines:
        raise DataError(f"{label} has a header but no line of data")
    return Sheet(label, _named([name.strip() for name in header], cells, label), lines, decimal_comma=separator != ",")


def _decode(data: bytes, label: str) -> str:
    encoding = "utf-16" if data.startswith(UTF_16) else "utf-8-sig"
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise DataError(
            f"{label} is not text: byte {error.start} is {data[error.start]:#04x}; is it a CSV file, saved as UTF-8?"
        ) from error
    if "\0" in text:
        raise DataError(f"{label} is not a CSV file: it holds NUL bytes; save the table as CSV (UTF-8)")
    return text


def _blocks(text: str, separator: str, label: str) -> Iterator[list[tuple[int, list[str]]]]:
    """Line number and cells of every line that is not blank, of up to ROWS_AT_ONCE lines at a time."""
    # as bytes: a StringIO takes four bytes a character
    lines = io.TextIOWrapper(io.BytesIO(text.encode()), encoding="utf-8", newline="")
    del text
    reader = csv.reader(lines, delimiter=separator)
    try:
        before = -1
        while before < reader.line_num:
            before = reader.line_num
            body = [(reader.line_num, row) for row in islice(reader, ROWS_AT_ONCE) if "".join(row).strip()]
            if body:
                yield body
    except csv.Error as error:
        raise DataError(f"{label} line {reader.line_num}: {error}; is a quotation mark left open?") from error


def _check_width(header: list[str], body: list[tuple[int, list[str]]], separator: str, label: str) -> None:
    wrong = next(((line, row) for line, row in body if len(row) != len(header)), None)
    if wrong is None:
        return
    line, row = wrong
    hint = "; decimal commas? separate the cells by semicolons, or write decimal points" if separator == "," else ""
    raise DataError(
        f"{label} line {line} has {len(row)} cells, but the header has {len(header)} columns"
        + (hint if len(row) > len(header) else "")
    )


def _named(header: list[str], cells: list[PackedCells], label: str) -> dict[str, PackedCells]:
    columns: dict[str, PackedCells] = {}
    for position, (name, column) in enumerate(zip(header, cells, strict=True), start=1):
        if not name and not any(cell.strip() for cell in column):
            continue
        if not name:
            raise DataError(f"{label}: column {position} has no name; name it or delete it")
        if name in columns:
            raise DataError(f"{label} has two columns {name!r:.60}; rename or delete one")
        columns[name] = column
    return columns
