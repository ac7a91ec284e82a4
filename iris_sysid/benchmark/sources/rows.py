"""The flat row: one value of one parameter, from one method on one clip. Every table is made from these rows alone.

``study`` assigns a row to a table: ``parameters``, or another of ``STUDIES``. ``dataset`` names the clips, so that
only errors on the same clips are compared; ``condition`` is a change that was made to a clip before the measurement;
``answer`` is the predicted class or equation.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.reading import read_columns
from iris_sysid.errors import DataError
from iris_sysid.io.formula_cells import guarded, unguarded

PARAMETERS = "parameters"
SELECTION = "selection"
IDENTIFIABILITY = "identifiability"
EXTRAPOLATION = "extrapolation"
SHARING = "sharing"
COUPLING = "coupling"
STUDIES = (PARAMETERS, SELECTION, IDENTIFIABILITY, EXTRAPOLATION, SHARING, COUPLING)

COLUMNS = (
    "study",
    "dataset",
    "phenomenon",
    "setting",
    "clip",
    "method",
    "condition",
    "parameter",
    "seed",
    "value",
    "stderr",
    "unit",
    "truth",
    "truth_source",
    "error",
    "status",
    "answer",
    "source",
)
KEY = ("study", "dataset", "phenomenon", "setting", "clip", "method", "condition", "parameter", "seed")
GROUP = ("dataset", "phenomenon", "setting", "parameter")
NUMBERS = ("value", "stderr", "truth", "error")
TEXTS = tuple(name for name in COLUMNS if name not in (*NUMBERS, "seed"))
OK = "ok"  # a usable value; any other status gives the reason why it is missing or doubtful
FAILED = "failed"  # the run gave no value; it is NaN and never 0


def flat_rows(records: Iterable[Mapping[str, Any]]) -> pd.DataFrame:
    """Make the table of flat rows from mappings with some of its columns.

    A missing number is NaN, a missing text is empty, a missing seed is <NA>, a missing study is ``parameters``.
    ``error`` is always value - truth, in ``unit``, and NaN where either is unknown.

    Raises DataError as :func:`check_rows` does.
    """
    listed = list(records)
    unknown = sorted({name for record in listed for name in record} - set(COLUMNS))
    if unknown:
        raise DataError(f"flat rows have no column {unknown[0]!r}; they have {', '.join(COLUMNS)}")
    frame = pd.DataFrame([[record.get(name) for name in COLUMNS] for record in listed], columns=list(COLUMNS))
    for name in COLUMNS:
        frame[name] = _typed(frame[name], name)
    frame["study"] = frame["study"].replace("", PARAMETERS)
    frame["error"] = frame["value"] - frame["truth"]
    return check_rows(frame)


def _typed(column: pd.Series, name: str) -> pd.Series:
    if name in NUMBERS:
        return pd.to_numeric(column, errors="coerce").astype("float64")
    if name == "seed":
        return column.astype("Int64")
    return column.fillna("").astype("str")


def check_rows(rows: pd.DataFrame) -> pd.DataFrame:
    """Return ``rows`` when they are valid flat rows, else raise a DataError that names the first bad row.

    Each ``KEY`` occurs once and its study is known; a row with status ``ok`` has a finite value, and one with status
    ``failed`` has none.
    """
    missing = [name for name in COLUMNS if name not in rows.columns]
    if missing:
        raise DataError(f"flat rows lack the column {missing[0]!r}; they need {', '.join(COLUMNS)}")
    finite = np.isfinite(rows["value"].to_numpy(dtype=np.float64))
    _refuse(rows, (rows["status"] == OK).to_numpy() & ~finite, "has status ok but no finite value; mark it as failed")
    _refuse(rows, (rows["status"] == FAILED).to_numpy() & finite, "failed but has a value; a failed run has NaN")
    _refuse(rows, ~rows["study"].isin(STUDIES).to_numpy(), f"is of no known study; there are {', '.join(STUDIES)}")
    _refuse(rows, rows.duplicated(list(KEY)).to_numpy(), "occurs twice; name the clips or the seeds apart")
    return rows


def _refuse(rows: pd.DataFrame, bad: np.ndarray, reason: str) -> None:
    if bad.any():
        first = rows.iloc[int(np.argmax(bad))]
        name = "/".join(str(first[name]) for name in KEY if not pd.isna(first[name]) and first[name] != "")
        raise DataError(f"flat row {name} {reason}")


# --------------------------------------------------------------------------- rows.csv


def rows_text(rows: pd.DataFrame) -> str:
    """Flat rows as CSV text that reads back exactly: an empty field is a missing number, seed or text."""
    text = io.StringIO()
    texts = {name: rows[name].map(guarded) for name in TEXTS}
    rows.assign(**texts).to_csv(text, index=False, lineterminator="\n")
    return text.getvalue()


def read_rows(path: str | Path) -> pd.DataFrame:
    """Read flat rows from a file as :func:`rows_text` makes it; a DataError names the first invalid line."""
    frame = read_columns(path, COLUMNS)
    for name in (*NUMBERS, "seed"):
        numbers = pd.to_numeric(frame[name].replace("", np.nan), errors="coerce")
        bad = (numbers.isna() & (frame[name] != "")).to_numpy()
        if bad.any():
            first = int(np.argmax(bad))
            raise DataError(
                f"{path}, data row {first + 1}: {name} is {frame[name].iloc[first]!r:.40}, which is not a number"
            )
        if name == "seed" and (numbers.dropna() % 1 != 0).any():
            raise DataError(f"{path}: a seed is a whole number")
        frame[name] = numbers.astype("Int64" if name == "seed" else "float64")
    for name in TEXTS:
        frame[name] = frame[name].map(unguarded)
    frame["error"] = frame["value"] - frame["truth"]
    return check_rows(frame)


def method_name(method: str) -> str:
    """The name of a method without its reading in brackets: ``baseline`` for ``baseline (g/alpha)``."""
    return method.partition(" (")[0]


def joined(frames: Iterable[pd.DataFrame]) -> pd.DataFrame:
    """Concatenate tables of flat rows and check the result; empty when there are none."""
    parts = [frame for frame in frames if len(frame)]
    return check_rows(pd.concat(parts, ignore_index=True)) if parts else flat_rows([])
