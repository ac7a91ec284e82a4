"""Tables of the studies: flat rows as a cross table, e.g. one line per setting and one column per method."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from iris_sysid.benchmark.sources.rows import COUPLING, EXTRAPOLATION, IDENTIFIABILITY, SHARING
from iris_sysid.benchmark.tables.summary import ABSENT, displayed
from iris_sysid.benchmark.tables.table import Cell, Table

Statistic = Callable[[pd.DataFrame], float]


@dataclass(frozen=True, eq=False, slots=True)
class TableLayout:
    """The layout of a cross table: ``down`` are the columns that name a line, ``across`` the one in the header.

    ``centre`` computes the number of a cell; ``spread`` the number after ±, if any. ``best`` marks the
    smallest displayed number of a line. Lines and columns keep the order of the rows.
    """

    caption: str
    down: tuple[str, ...]
    across: str
    centre: Statistic
    spread: Statistic | None = None
    best: bool = False
    notes: tuple[str, ...] = ()


def median_value(rows: pd.DataFrame) -> float:
    """Median of the values, missing ones left out."""
    return _or_nan(rows["value"], np.median)


def mean_value(rows: pd.DataFrame) -> float:
    """Mean of the values, missing ones left out."""
    return _or_nan(rows["value"], np.mean)


def sd_value(rows: pd.DataFrame) -> float:
    """Sample standard deviation of the values; NaN for fewer than two."""
    return float(rows["value"].std(ddof=1)) if rows["value"].notna().sum() > 1 else np.nan


def mean_error(rows: pd.DataFrame) -> float:
    """Mean absolute error."""
    return _or_nan(rows["error"].abs(), np.mean)


def sd_error(rows: pd.DataFrame) -> float:
    """Sample standard deviation of the absolute errors; NaN for fewer than two."""
    errors = rows["error"].abs()
    return float(errors.std(ddof=1)) if errors.notna().sum() > 1 else np.nan


def _or_nan(values: pd.Series, of: Callable[[np.ndarray], float]) -> float:
    known = values.dropna().to_numpy()
    return float(of(known)) if known.size else np.nan


_PLACE = ("dataset", "phenomenon", "setting")
_N = "In brackets: the number of clips with a value, and of failed ones where there are any."

LAYOUTS: Mapping[str, TableLayout] = {
    IDENTIFIABILITY: TableLayout(
        "Identifiability: medians over the clips of a setting",
        (*_PLACE, "method"),
        "parameter",
        median_value,
        notes=(
            "Condition number of the Fisher information (and of the Hessian at the optimum), each scaled to a unit "
            "diagonal. Gradient: norm at the first and the last iteration of the fit, relative to the values. One-step "
            "residual: mean squared error of one step of the equation, over what the noise alone makes of it.",
            _N,
        ),
    ),
    EXTRAPOLATION: TableLayout(
        "Extrapolation: error k frames beyond the 100 that were fitted",
        (*_PLACE, "method", "unit"),
        "parameter",
        mean_value,
        sd_value,
        notes=("Mean ± standard deviation of the absolute error of the observable over the clips.", _N),
    ),
    SHARING: TableLayout(
        "Several clips fitted at once against clip by clip: MAE",
        (*_PLACE, "parameter", "unit"),
        "method",
        mean_error,
        sd_error,
        best=True,
        notes=("The shared value is one number for a setting: its n is 1 whatever the number of clips.", _N),
    ),
    COUPLING: TableLayout(
        "Coupling held at 0 against fitted: root mean square error",
        (*_PLACE, "parameter", "unit"),
        "method",
        median_value,
        best=True,
        notes=("Held out is the last 30 % of each clip, predicted from the rest.", _N),
    ),
}


def study_table(rows: pd.DataFrame, study: str) -> Table:
    """The table of one study (a key of ``LAYOUTS``) from its flat rows."""
    return crossed(rows[rows["study"] == study], LAYOUTS[study])


def crossed(rows: pd.DataFrame, layout: TableLayout) -> Table:
    """Make a cross table of the flat rows of one study; a combination without a row is a dash."""
    columns = list(dict.fromkeys(rows[layout.across]))
    down = [name for name in layout.down if name != "dataset" or rows["dataset"].nunique() > 1]
    lines = []
    for key, group in rows.groupby(down, sort=False):
        cells = [group[group[layout.across] == name] for name in columns]
        shown = [cell_text(cell, layout.centre, layout.spread) for cell in cells]
        best = smallest([layout.centre(cell) for cell in cells]) if layout.best else ()
        lines.append((*(Cell(str(part)) for part in key), *(Cell(text, k in best) for k, text in enumerate(shown))))
    header = tuple("data" if name == "dataset" else name for name in down) + tuple(columns)
    return Table(layout.caption, header, tuple(lines), frozenset(columns), layout.notes)


def cell_text(rows: pd.DataFrame, centre: Statistic, spread: Statistic | None = None) -> str:
    """A cell: centre, ± spread where there is one, in brackets how many values and how many failed; a dash for none."""
    if rows.empty:
        return ABSENT
    values = int(rows["value"].notna().sum())
    failed = len(rows) - values
    count = f"({values}, {failed} failed)" if failed else f"({values})"
    half_width = np.nan if spread is None else spread(rows)
    value = displayed(centre(rows))
    return f"{value} ± {displayed(half_width, 2)} {count}" if np.isfinite(half_width) else f"{value} {count}"


def smallest(numbers: Sequence[float]) -> tuple[int, ...]:
    """Indices of the smallest numbers as displayed: several where displays are equal, never a NaN."""
    shown = [float(displayed(number)) if np.isfinite(number) else np.inf for number in numbers]
    least = min(shown, default=np.inf)
    return tuple(k for k, value in enumerate(shown) if np.isfinite(value) and value == least)
