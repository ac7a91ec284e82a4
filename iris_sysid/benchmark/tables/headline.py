"""The publication's main table from flat rows: one line per parameter and setting, one column per method."""

from __future__ import annotations

import re
from collections.abc import Hashable, Iterator

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.null_baselines import INITIAL, METADATA
from iris_sysid.benchmark.sources.rows import method_name
from iris_sysid.benchmark.tables.study_tables import smallest
from iris_sysid.benchmark.tables.summary import ABSENT, competing, displayed, parameter_summary
from iris_sysid.benchmark.tables.table import Cell, Table

LINE = ["phenomenon", "setting", "parameter", "unit"]
NULLS = (INITIAL, METADATA)
NOTES = (
    "MAE ± standard deviation of the absolute errors (n values, failed runs). A failed run is in no mean.",
    "Where no truth is known, the mean of the values themselves is shown, as 'mean'.",
    "Bold: the smallest displayed MAE among the methods on the same clips; null baselines, and methods scored on fewer "
    "clips, do not compete.",
    "Latent methods are shown under the publication's own reading of alpha and beta; the other one is in the long "
    "table. The best of several start values is shown as the initial value.",
)


def headline_table(rows: pd.DataFrame) -> Table:
    """The errors of all methods side by side, the null baselines of each data set included.

    Rows of the study ``parameters`` count. A column is one method on one data set. Errors on different clips are shown
    side by side but never compared: bold marks the best within a data set, among the methods that were scored on the
    largest number of clips.
    """
    summary = parameter_summary(rows)
    summary["stem"] = summary["method"].map(method_name)
    columns = list(_columns(summary))
    lines = []
    for key, group in sorted(summary.groupby(LINE, sort=False), key=lambda pair: _sort_key(pair[0], summary)):
        entries = [_entry(group, *column) for column in columns]
        best = _best(entries, columns)
        cells = [Cell(_text(entry), k in best) for k, entry in enumerate(entries)]
        lines.append((*(Cell(str(part)) for part in key), *cells))
    several = summary["dataset"].nunique() > 1
    heads = tuple(f"{stem} [{dataset}]" if several and dataset else stem for dataset, stem in columns)
    return Table("Parameter errors, all methods", (*LINE, *heads), tuple(lines), frozenset(heads), NOTES)


def _sort_key(key: tuple[Hashable, ...], summary: pd.DataFrame) -> tuple[int, list[tuple[str, int]], int]:
    """Sort key of a line: phenomena and parameters in the order of the rows, settings by the numbers in them."""
    parts = re.findall(r"(\D*)(\d*)", str(key[1]))
    order = [(letters, int(digits or 0)) for letters, digits in parts]
    phenomena = list(dict.fromkeys(summary["phenomenon"]))
    parameters = list(dict.fromkeys(summary.loc[summary["phenomenon"] == key[0], "parameter"]))
    return phenomena.index(str(key[0])), order, parameters.index(str(key[2]))


def _columns(summary: pd.DataFrame) -> Iterator[tuple[str, str]]:
    """Data set and method of each column: a data set's methods, then its null baselines."""
    for dataset, group in summary.groupby("dataset", sort=False):
        stems = list(dict.fromkeys(group["stem"]))
        for stem in (*(stem for stem in stems if stem not in NULLS), *(null for null in NULLS if null in stems)):
            yield str(dataset), stem


def _entry(group: pd.DataFrame, dataset: str, stem: str) -> pd.Series | None:
    """The line of a method: its first reading, or the best of several initial values."""
    candidates = group[(group["dataset"] == dataset) & (group["stem"] == stem)]
    if candidates.empty:
        return None
    best = int(candidates["mae"].fillna(np.inf).argmin()) if stem == INITIAL else 0
    return candidates.iloc[best]


def _best(entries: list[pd.Series | None], columns: list[tuple[str, str]]) -> set[int]:
    best: set[int] = set()
    for dataset in dict.fromkeys(name for name, _ in columns):
        indices = [k for k, (name, stem) in enumerate(columns) if name == dataset and stem not in NULLS]
        lines = [entries[k] for k in indices]
        errors = [
            float(line["mae"]) if line is not None and competes else np.nan
            for line, competes in zip(lines, competing(lines), strict=True)
        ]
        best |= {indices[k] for k in smallest(errors)}
    return best


def _text(entry: pd.Series | None) -> str:
    if entry is None:
        return ABSENT
    count = f"({entry['n']}, {entry['failed']} failed)" if entry["failed"] else f"({entry['n']})"
    known = bool(np.isfinite(entry["mae"]))
    centre, spread = (entry["mae"], entry["mae_sd"]) if known else (entry["mean"], entry["sd"])
    width = f" ± {displayed(spread, 2)}" if np.isfinite(spread) and entry["n"] > 1 else ""
    return f"{'' if known or not np.isfinite(centre) else 'mean '}{displayed(centre)}{width} {count}"
