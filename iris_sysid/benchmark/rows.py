"""The flat row: one value of one parameter, from one method on one clip. Every table is made from these alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from iris_sysid.errors import DataError

COLUMNS = (
    "phenomenon",
    "setting",
    "clip",
    "method",
    "parameter",
    "seed",
    "value",
    "stderr",
    "unit",
    "truth",
    "truth_source",
    "error",
    "status",
    "source",
)
KEY = ("phenomenon", "setting", "clip", "method", "parameter", "seed")
GROUP = ("phenomenon", "setting", "parameter")
NUMBERS = ("value", "stderr", "truth", "error")
OK = "ok"  # a value that can be used; any other status says why it cannot, or with what reservation
FAILED = "failed"  # the run gave nothing; its value is NaN and never 0


def flat_rows(records: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Make the table of flat rows from mappings with some of its columns.

    A missing number is NaN, a missing text is empty, a missing seed is <NA>. ``error`` is always value - truth,
    in ``unit``, and NaN where either is not known.

    Raises DataError as :func:`check_rows` does.
    """
    listed = list(records)
    unknown = sorted({name for record in listed for name in record} - set(COLUMNS))
    if unknown:
        raise DataError(f"flat rows have no column {unknown[0]!r}; they have {', '.join(COLUMNS)}")
    frame = pd.DataFrame([[record.get(name) for name in COLUMNS] for record in listed], columns=list(COLUMNS))
    for name in COLUMNS:
        frame[name] = _typed(frame[name], name)
    frame["error"] = frame["value"] - frame["truth"]
    return check_rows(frame)


def _typed(column: pd.Series, name: str) -> pd.Series:
    if name in NUMBERS:
        return pd.to_numeric(column, errors="coerce").astype("float64")
    if name == "seed":
        return column.astype("Int64")
    return column.fillna("").astype("str")


def check_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Return ``rows`` when they mean what flat rows should, else raise DataError that names the first bad row.

    Each (phenomenon, setting, clip, method, parameter, seed) occurs once; a row with status ``ok`` has a finite
    value, and one with status ``failed`` has none.
    """
    missing = [name for name in COLUMNS if name not in rows.columns]
    if missing:
        raise DataError(f"flat rows lack the column {missing[0]!r}; they need {', '.join(COLUMNS)}")
    finite = np.isfinite(rows["value"].to_numpy(dtype=np.float64))
    _refuse(rows, (rows["status"] == OK).to_numpy() & ~finite, "has status ok but no finite value; mark it as failed")
    _refuse(rows, (rows["status"] == FAILED).to_numpy() & finite, "failed but has a value; a failed run has NaN")
    _refuse(rows, rows.duplicated(list(KEY)).to_numpy(), "occurs twice; name the clips or the seeds apart")
    return rows


def _refuse(rows: pd.DataFrame, bad: np.ndarray, why: str) -> None:
    if bad.any():
        first = rows.iloc[int(np.argmax(bad))]
        raise DataError(f"flat row {'/'.join(str(first[name]) for name in KEY)} {why}")
