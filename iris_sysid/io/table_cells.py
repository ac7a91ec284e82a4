"""The cells of a table that any program wrote: separator, decimal comma, encoding, comments, header rows, Excel.

Python's csv module splits the lines and calamine opens Excel files; here is only found which separator and which header
a file has. What the columns mean is decided in :mod:`iris_sysid.io.table_headers`.
"""

from __future__ import annotations

import csv
import io
import re
import zipfile
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from iris_sysid.errors import DataError
from iris_sysid.io.archives import ZIP_TROUBLE
from iris_sysid.io.array_files import array_columns, is_array_file
from iris_sysid.io.csv_cells import BLANK, UTF_16
from iris_sysid.io.files import MAX_BYTES, read_file

LOOKED_AT = 200  # lines from which the separator is chosen
MAX_HEADER_ROWS = 8
SEPARATORS = (";", "\t", ",", " ")  # the first of those that split the lines into numbers best
COMMENT = re.compile(r"\s*(#|//|%|!)")
SEPARATOR_LINE = re.compile(r"sep=(.)", re.IGNORECASE)
NUMERIC = re.compile(r"[-+]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][-+]?[0-9]+)?")
SEALED = ".sealed"  # a record that only a logged look opens
EXCEL = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")  # .xlsx, also under the name .xls; and .xls


@dataclass(frozen=True, eq=False, slots=True)
class Cells:
    """The rows of a table, all of one length, and the ``lines`` they stand in; the ``header`` rows apart.

    ``file`` is the path without the name of a sheet; ``said`` tells what was guessed about the file, for the user.
    """

    label: str
    file: str
    header: tuple[tuple[str, ...], ...]
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[int, ...]
    decimal_comma: bool
    said: tuple[str, ...]


def read_cells(path: str | Path) -> Cells:
    """Read a table: text with commas, semicolons, tabs or spaces, the only filled Excel sheet, or arrays (.mat, .npy).

    ``FILE.xlsx:SHEET`` names one of several sheets. Text is UTF-8, UTF-16 or Windows-1252; blank lines and lines that
    begin with ``#``, ``//``, ``%`` or ``!`` are skipped. Raises DataError for anything but a table.
    """
    file, sheet = _file_and_sheet(str(path))
    if file.endswith(SEALED):
        raise DataError(f"{file} is sealed: iris-sysid sealed {file} --fit fit.json opens it, and logs the look")
    data = read_file(file)
    if is_array_file(data):
        titles, columns, said = array_columns(data, file)
        rows = tuple(tuple(_cell(float(number)) for number in row) for row in zip(*columns, strict=True))
        return Cells(str(path), file, (titles,), rows, tuple(range(1, len(rows) + 1)), False, said)
    if data.startswith(EXCEL):
        return _split_header(_sheet_rows(data, file, sheet), (str(path), file), False, ())
    if sheet is not None:
        raise DataError(f"{file} is no Excel file, so it has no sheet {sheet!r:.60}")
    text, said = _text(data, file)
    return _from_text(text, file, said)


def _file_and_sheet(path: str) -> tuple[str, str | None]:
    """The file and the sheet of ``FILE:SHEET``; a file of that whole name comes first."""
    file, colon, sheet = path.rpartition(":")
    if colon and not Path(path).exists() and Path(file).is_file():
        return file, sheet
    return path, None


def _text(data: bytes, file: str) -> tuple[str, tuple[str, ...]]:
    """The decoded text, and what had to be guessed."""
    said: tuple[str, ...] = ()
    try:
        text = data.decode("utf-16" if data.startswith(UTF_16) else "utf-8-sig")
    except UnicodeDecodeError:
        text, said = data.decode("cp1252", errors="replace"), ("not UTF-8: read as Windows-1252",)
    if "\0" in text:
        raise DataError(f"{file} is not a table: it holds NUL bytes; save it as CSV (UTF-8)")
    return text, said


# --------------------------------------------------------------------------- text


def _from_text(text: str, label: str, said: tuple[str, ...]) -> Cells:
    filled = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    lines = [(number, line) for number, line in filled if not COMMENT.match(line)]
    stated = SEPARATOR_LINE.fullmatch(lines[0][1].strip()) if lines else None
    if stated:
        lines = lines[1:]
    if not lines:
        raise DataError(f"{label} is empty: it needs a header line, e.g. t_s,theta_rad, and a line a sample")
    separator = stated[1] if stated else _separator([line for _, line in lines[:LOOKED_AT]])
    rows = [(number, _split(line, separator)) for number, line in lines]
    if _is_sample(rows[0][1], separator != ","):
        rows = [*_commented_header(filled, separator, len(rows[0][1])), *rows]
    return _split_header(rows, (label, label), separator != ",", said)


def _commented_header(filled: Sequence[tuple[int, str]], separator: str, width: int) -> list[tuple[int, list[str]]]:
    """The comment line right above the samples, where it names as many columns as they have."""
    above: tuple[int, str] | None = None
    for number, line in filled:
        if not COMMENT.match(line):
            break
        above = (number, COMMENT.sub("", line, count=1).strip())
    row = [] if above is None else _split(above[1], separator)
    return [(above[0], row)] if above is not None and len(row) == width > 1 else []


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader(io.StringIO(line), delimiter=separator))]
    except (csv.Error, StopIteration):
        return [cell.strip() for cell in line.split(separator)]


def _separator(lines: Sequence[str]) -> str:
    """The separator that gives the largest share of rows with the usual number of numeric cells."""

    def score(separator: str) -> tuple[int, int]:
        rows = [_split(line, separator) for line in lines]
        numbers = [sum(_is_number(cell, separator != ",") for cell in row) for row in rows]
        usual, often = Counter(count for count in numbers if count).most_common(1)[0] if any(numbers) else (0, 0)
        wasted = sum(len(row) for row in rows) - sum(numbers)
        return (often if usual > 1 else 0, -wasted)

    return max(SEPARATORS, key=score)


def _is_number(cell: str, decimal_comma: bool) -> bool:
    return NUMERIC.fullmatch(cell) is not None and (decimal_comma or "," not in cell)


# --------------------------------------------------------------------------- Excel


def _sheet_rows(data: bytes, file: str, wanted: str | None) -> list[tuple[int, list[str]]]:
    """Line number and cells of every row of one sheet that is not blank."""
    import python_calamine

    _check_unpacked(data, file)
    try:
        book = python_calamine.CalamineWorkbook.from_filelike(io.BytesIO(data))
        names = [wanted] if wanted is not None else list(book.sheet_names)
        if wanted is not None and wanted not in book.sheet_names:
            raise DataError(f"{file} has no sheet {wanted!r:.60}; it has {', '.join(book.sheet_names):.300}")
        sheets = {name: book.get_sheet_by_name(name).to_python() for name in names}
    except (python_calamine.CalamineError, ValueError, OSError) as error:
        raise DataError(f"{file} cannot be read as an Excel file: {error!s:.200}; save the table as CSV") from error
    filled = {name: rows for name, rows in sheets.items() if rows}
    if len(filled) != 1:
        found = f"has the sheets {', '.join(filled):.300}" if filled else "has no filled sheet"
        raise DataError(f"{file} {found}" + (f"; name one: {file}:{next(iter(filled))}" if filled else ""))
    (rows,) = filled.values()
    cells = [(number, [_cell(value) for value in row]) for number, row in enumerate(rows, start=1)]
    return [(number, row) for number, row in cells if any(row)]


def _check_unpacked(data: bytes, file: str) -> None:
    """DataError where an Excel file claims to unpack to more than a table may have."""
    if not data.startswith(EXCEL[0]):
        return
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            size = sum(member.file_size for member in archive.infolist())
    except ZIP_TROUBLE as error:
        raise DataError(f"{file} cannot be read as an Excel file: {error!s:.200}") from error
    if size > MAX_BYTES:
        raise DataError(f"{file} unpacks to {size / 1e6:.0f} MB; a table may have {MAX_BYTES / 1e6:.0f} MB: split it")


def _cell(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value).strip()


# --------------------------------------------------------------------------- header


def _split_header(
    rows: Sequence[tuple[int, list[str]]], label_and_file: tuple[str, str], decimal_comma: bool, said: tuple[str, ...]
) -> Cells:
    """Take the header rows from the samples; both are brought to one width."""
    label, file = label_and_file
    first = next((k for k, (_, row) in enumerate(rows) if _is_sample(row, decimal_comma)), None)
    if first is None or first > MAX_HEADER_ROWS:
        raise DataError(f"{label} holds no rows of numbers under its first lines; is it a table?")
    body = rows[first:]
    width = Counter(len(row) for _, row in body).most_common(1)[0][0]
    header = [row for _, row in rows[:first]]
    width = max(width, len(header[-1]) if header else 0)
    for number, row in body:
        if len(row) > width and any(row[width:]):
            raise DataError(f"{label} line {number} has {len(row)} cells, where most have {width}")
    return Cells(
        label=label,
        file=file,
        header=tuple(_wide(row, width) for row in header),
        rows=tuple(_wide(row, width) for _, row in body),
        lines=tuple(number for number, _ in body),
        decimal_comma=decimal_comma,
        said=said,
    )


def _is_sample(row: Sequence[str], decimal_comma: bool) -> bool:
    """Whether a row holds measurements: two numbers or more, or numbers only."""
    filled = [cell for cell in row if cell not in BLANK]
    numbers = sum(_is_number(cell, decimal_comma) for cell in filled)
    return numbers >= 2 or 0 < numbers == len(filled)


def _wide(row: Sequence[str], width: int) -> tuple[str, ...]:
    return (*row[:width], *[""] * (width - len(row)))
