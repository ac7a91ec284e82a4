"""The table of extrapolation errors from flat rows: one line per setting and method, one column per horizon."""

from __future__ import annotations

import math

import pandas as pd

from iris_sysid.benchmark.sources.rows import EXTRAPOLATION
from iris_sysid.benchmark.tables.summary import ABSENT, displayed
from iris_sysid.benchmark.tables.table import Cell, Table

LINE = ("dataset", "phenomenon", "setting", "method", "unit")
NOTES = (
    "Mean ± standard deviation of the squared error of the observable over the clips.",
    "In brackets: the number of clips with a value, and of failed ones where there are any.",
)


def extrapolation_table(rows: pd.DataFrame) -> Table:
    """The table of the study ``extrapolation`` in flat ``rows``; a combination without a row is a dash."""
    chosen = rows[rows["study"] == EXTRAPOLATION]
    horizons = list(dict.fromkeys(chosen["parameter"]))
    line = [name for name in LINE if name != "dataset" or chosen["dataset"].nunique() > 1]
    lines = [
        (*(Cell(str(part)) for part in key), *(Cell(_text(group[group["parameter"] == name])) for name in horizons))
        for key, group in chosen.groupby(line, sort=False)
    ]
    header = ("data" if name == "dataset" else name for name in line)
    caption = "Extrapolation: error k frames beyond the 100 that were fitted"
    return Table(caption, (*header, *horizons), tuple(lines), frozenset(horizons), NOTES)


def _text(rows: pd.DataFrame) -> str:
    """Mean, ± spread, and in brackets how many values, and how many failed."""
    if rows.empty:
        return ABSENT
    values = rows["value"].dropna()
    failed = len(rows) - len(values)
    count = f"({len(values)}, {failed} failed)" if failed else f"({len(values)})"
    mean, spread = (float(values.mean()), float(values.std(ddof=1))) if len(values) else (math.nan, math.nan)
    shown = f" ± {displayed(spread, 2)}" if math.isfinite(spread) else ""
    return f"{displayed(mean)}{shown} {count}"
