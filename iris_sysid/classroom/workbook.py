"""The workbook of a class: one sheet of the groups, one of the means, for a spreadsheet."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import xlsxwriter

from iris_sysid.classroom.summary import ClassResult, GroupResult
from iris_sysid.io.files import write_atomic
from iris_sysid.types import SPOKEN, Population

# text stays text: a group may be called =1+1, or have an address for a name
PLAIN = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False, "strings_to_numbers": False}
MAX_CELL = 32_000  # characters that a cell may hold
CREATED = datetime(2020, 1, 1)  # the same bytes for the same class
WIDE, NARROW = 40, 14

Row = Sequence[Any]


def write_workbook(result: ClassResult, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write the groups and the means of a class as .xlsx; values are in SI units, which the headers name.

    OutputError when the file exists, unless ``overwrite`` allows that, or cannot be written.
    """
    buffer = io.BytesIO()
    book = xlsxwriter.Workbook(buffer, PLAIN)
    book.set_properties({"title": "Class", "created": CREATED})
    bold = book.add_format({"bold": True, "text_wrap": True, "valign": "top"})
    for name, rows in (("groups", _group_rows(result)), ("means", _mean_rows(result))):
        sheet = book.add_worksheet(name)
        sheet.freeze_panes(1, 1)
        for k, row in enumerate(rows):
            for column, value in enumerate(row):
                _write(sheet, k, column, value, bold if k == 0 else None)
        sheet.autofilter(0, 0, len(rows) - 1, len(rows[0]) - 1)
        for column, title in enumerate(rows[0]):
            sheet.set_column(column, column, WIDE if title in ("what is wrong", "message") else NARROW)
    book.close()
    return write_atomic(path, buffer.getvalue(), overwrite=overwrite)


def _write(sheet: Any, row: int, column: int, value: Any, shape: Any) -> None:
    if isinstance(value, str):
        sheet.write_string(row, column, value[:MAX_CELL], shape)
    elif value is not None and math.isfinite(value):
        sheet.write_number(row, column, value, shape)


def _group_rows(result: ClassResult) -> list[Row]:
    names = [result.value, *result.others]
    units = {name: _unit_of(result, name) for name in names}
    head = ["group"]
    for name in names:
        head += [f"{name}{units[name]}", f"standard error{units[name]}", "95 % from", "95 % to"]
    head += ["standard errors from the others", "in the mean", "what is wrong", "numbers"]
    groups = [*result.groups, *([result.teacher] if result.teacher else [])]
    return [[*head, "message", "file"], *(_row(group, names, teacher=group is result.teacher) for group in groups)]


def _unit_of(result: ClassResult, name: str) -> str:
    known = (group.document.estimate(name) for group in result.groups)
    unit = next((estimate.unit for estimate in known if estimate is not None), "")
    return f" ({unit})" if unit not in ("", "1") else ""


def _row(group: GroupResult, names: Sequence[str], *, teacher: bool) -> Row:
    estimates = [group.document.estimate(name) if group.document.usable else None for name in names]
    verdict = group.document.verdict
    return [
        group.name,
        *(n for e in estimates for n in ((None,) * 4 if e is None else (e.value, e.stderr, *e.interval))),
        group.in_errors,
        "teacher" if teacher else "yes" if group.pooled else "no",
        group.cause,
        "failed" if verdict is None else SPOKEN[verdict.word],
        group.document.message,
        group.document.source,
    ]


def _mean_rows(result: ClassResult) -> list[Row]:
    head = ["value", "groups", "mean", "standard error", "95 % from", "95 % to", "unit", "scatter between groups"]
    rows: list[Row] = [[*head, "error within one", "chance of such a scatter"]]
    some_outlying = any(group.outlying for group in result.groups)
    for name, of, population in [
        (result.value, "without outliers", result.pooled),
        *([(result.value, "with outliers", result.every)] if some_outlying else []),
        *((name, "without outliers", population) for name, population in result.others.items()),
    ]:
        if population is not None:
            rows.append([name, of, *_numbers(population)])
    for item in result.comparisons:
        reference = item.reference
        rows.append([item.label, "reference", reference.value, reference.stderr, *reference.interval, reference.unit])
    return rows


def _numbers(population: Population) -> Row:
    mean = population.mean
    return [
        mean.value,
        mean.stderr,
        *mean.interval,
        mean.unit,
        population.between.value,
        population.within,
        population.p_value,
    ]
