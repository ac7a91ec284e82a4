"""Summary of flat rows: error, spread, n and failures of each method on each parameter, and the best method."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.null_baselines import INITIAL, SOURCE, null_rows
from iris_sysid.benchmark.sources.rows import GROUP, PARAMETERS, check_rows, method_name

ABSENT = "–"


def displayed(value: float, digits: int = 3) -> str:
    """A number as the tables show it: ``digits`` significant digits, a dash for NaN.

    Whole digits are never rounded away (1234.6 is shown as 1235); below 0.0001 and from 10 million on the form is
    5.55e-17.
    """
    if not math.isfinite(value):
        return ABSENT
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e7:
        return f"{value:.{digits - 1}e}"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{value:.{max(decimals, 0)}f}"


def parameter_summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Summarise flat rows: one line per data set, phenomenon, setting, parameter and method, with null baselines.

    Only rows of the study ``parameters`` count.

    Parameters
    ----------
    rows
        Flat rows.

    Returns
    -------
    DataFrame
        ``dataset, phenomenon, setting, parameter, unit, truth`` (the mean, where it differs from clip to clip),
        ``method``; ``n`` values and ``failed`` rows without one;
        ``mean`` and ``sd`` (n - 1) of the values; ``mae`` and ``mae_sd``, mean and sd of the absolute errors;
        ``relative_percent``, the mean of the absolute errors over their truths; ``best``, whether the *displayed* mae
        is the smallest of the group's methods (null baselines, and methods that were scored on fewer clips, do not
        compete); ``beats_initial``, ``yes`` or ``no``, against the best displayed null baseline of initial values,
        empty where there is none. Failed rows count in no mean. NaN where a number is undefined.

    Raises
    ------
    DataError
        When the rows are not flat rows.
    """
    check_rows(rows)
    known = rows[(rows["source"] != SOURCE) & (rows["study"] == PARAMETERS)]
    every = pd.concat([known, null_rows(known)], ignore_index=True) if len(known) else known
    lines: list[dict[str, Any]] = []
    for _, group in every.groupby(list(GROUP), sort=False):
        lines += _group_lines(group)
    return pd.DataFrame(lines, columns=SUMMARY_COLUMNS)


SUMMARY_COLUMNS = (
    *("dataset", "phenomenon", "setting", "parameter", "unit", "truth", "method", "n", "failed", "mean", "sd"),
    *("mae", "mae_sd", "relative_percent", "best", "beats_initial"),
)


def _group_lines(group: pd.DataFrame) -> list[dict[str, Any]]:
    lines = [_line(part) for _, part in group.groupby("method", sort=False)]
    shown = {line["method"]: _shown(line["mae"]) for line in lines}
    nulls = set(group.loc[group["source"] == SOURCE, "method"])
    rivals = [line for line in lines if line["method"] not in nulls]
    on_all = {line["method"] for line, competes in zip(rivals, competing(rivals), strict=True) if competes}
    best = min((shown[name] for name in on_all), default=math.inf)
    initial = min((shown[name] for name in shown if method_name(name) == INITIAL), default=math.inf)
    for line in lines:
        name = line["method"]
        line["best"] = name in on_all and math.isfinite(best) and shown[name] == best
        judged = name not in nulls and math.isfinite(initial) and math.isfinite(shown[name])
        line["beats_initial"] = ("yes" if shown[name] < initial else "no") if judged else ""
    return lines


def competing(lines: Sequence[Mapping[str, Any] | pd.Series | None]) -> list[bool]:
    """Which of a group's lines may be the best: those with a value and with the largest number of scored clips."""
    scored = [line["n"] + line["failed"] if line is not None and line["n"] else 0 for line in lines]
    return [0 < count == max(scored) for count in scored]


def _shown(error: float) -> float:
    """The error as displayed, as a number; infinite where there is none, so that it is never the smallest."""
    return float(displayed(error)) if math.isfinite(error) else math.inf


def _line(rows: pd.DataFrame) -> dict[str, Any]:
    values = rows.loc[np.isfinite(rows["value"]), ["value", "error", "truth"]]
    errors = values["error"].abs().dropna()
    first = rows.iloc[0]
    return {
        **{name: first[name] for name in ("dataset", "phenomenon", "setting", "parameter", "unit", "method")},
        "truth": _mean(rows["truth"]),
        "n": len(values),
        "failed": len(rows) - len(values),
        "mean": _mean(values["value"]),
        "sd": _spread(values["value"]),
        "mae": _mean(errors),
        "mae_sd": _spread(errors),
        "relative_percent": 100 * _mean(errors / values["truth"].abs().replace(0.0, math.nan)),
    }


def _mean(values: pd.Series) -> float:
    """Mean of the known values; exactly the value where all are equal. NaN without any."""
    known = values.dropna()
    return float(known.iloc[0] if known.nunique() == 1 else known.mean()) if len(known) else math.nan


def _spread(values: pd.Series) -> float:
    """Sample standard deviation; exactly 0 for equal values, where rounding would leave 1e-17. NaN for fewer than 2."""
    return 0.0 if len(values) > 1 and values.nunique() == 1 else float(values.std(ddof=1))
