"""Charts of the benchmark from its flat rows: errors, confusion matrices, extrapolation errors, robustness."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iris_sysid.benchmark.sources.rows import EXTRAPOLATION, PARAMETERS, ROBUSTNESS, SELECTION, method_name
from iris_sysid.benchmark.tables.headline import NULLS
from iris_sysid.benchmark.tables.study_tables import relative_error
from iris_sysid.benchmark.tables.summary import parameter_summary

# Okabe and Ito (2008): colours that are distinct for every kind of colour vision; markers differ as well
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
MARKERS = "osD^vP*X"
NULL_COLOUR = "#999999"
LINE_HEIGHT = 0.24  # inches a line of the error chart
SMALLEST = 1e-3  # %, where the error axis ends: smaller errors are drawn there
MAX_CONFUSIONS = 6  # matrices in one chart


def charts_of(rows: pd.DataFrame) -> dict[str, tuple[Figure, str]]:
    """Every chart that has rows, by name, with its caption."""
    makers = {
        "errors": (
            PARAMETERS,
            error_chart,
            "Mean relative error of each parameter, from 0.001 % on.",
        ),
        "confusion": (SELECTION, confusion_chart, "Answers (across) by true class (down), as shares of a class."),
        "extrapolation": (EXTRAPOLATION, extrapolation_chart, "Error k frames beyond the 100 fitted; mean of clips."),
        "robustness": (ROBUSTNESS, robustness_chart, "Median relative error after each change to the clips."),
    }
    present = set(rows["study"])
    return {name: (make(rows), text) for name, (study, make, text) in makers.items() if study in present}


def error_chart(rows: pd.DataFrame) -> Figure:
    """Relative errors of all methods on every parameter and setting, null baselines in grey; from flat ``rows``."""
    summary = parameter_summary(rows)
    summary["line"] = summary["phenomenon"] + " " + summary["setting"] + " " + summary["parameter"]
    summary["stem"] = summary["method"].map(method_name)
    first = summary.drop_duplicates(["dataset", "line", "stem"])
    first = first[first["relative_percent"].notna()]
    lines = list(dict.fromkeys(first["line"]))
    figure = Figure(figsize=(10, max(2.5, LINE_HEIGHT * len(lines) + 1.6)), layout="constrained")
    axes = figure.add_subplot()
    series = list(first.groupby(["stem", "dataset"], sort=False))
    styles = _styles([str(stem) for (stem, _), _ in series if stem not in NULLS])
    for (stem, dataset), group in series:
        null = stem in NULLS
        style: dict[str, Any] = (
            {"color": NULL_COLOUR, "marker": "x" if stem == NULLS[0] else "+"} if null else styles[str(stem)]
        )
        error = np.maximum(group["relative_percent"].to_numpy(dtype=np.float64), SMALLEST)
        height = [lines.index(line) for line in group["line"]]
        axes.plot(error, height, linestyle="none", markersize=5, label=_named(str(stem), str(dataset)), **style)
    axes.set(xscale="log", xlabel="error (%)", ylim=(len(lines) - 0.5, -0.5))
    axes.set_yticks(range(len(lines)), lines, fontsize=8)
    axes.grid(axis="both", alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


def _styles(names: Sequence[str]) -> Mapping[str, dict[str, Any]]:
    known = dict.fromkeys(names)
    return {name: _style(k) for k, name in enumerate(known)}


def _style(k: int) -> dict[str, Any]:
    return {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}


def _named(method: str, dataset: str) -> str:
    return f"{method} [{dataset}]" if dataset else method


def confusion_chart(rows: pd.DataFrame) -> Figure:
    """Confusion matrices side by side, darker for a larger share of the true class; from flat ``rows``."""
    groups = list(rows[rows["study"] == SELECTION].groupby(["dataset", "method"], sort=False))[:MAX_CONFUSIONS]
    across = min(2, len(groups))
    down = -(-len(groups) // across)
    figure = Figure(figsize=(6.5 * across, 5.0 * down), layout="constrained")
    for k, ((dataset, method), group) in enumerate(groups):
        counts = pd.crosstab(group["phenomenon"], group["answer"])
        own = [name for name in counts.index if name in counts.columns]
        counts = counts[[*own, *(name for name in counts.columns if name not in own)]]
        _matrix(figure.add_subplot(down, across, k + 1), counts, _named(str(method), str(dataset)))
    return figure


def _matrix(axes: Axes, counts: pd.DataFrame, title: str) -> None:
    shares = counts.to_numpy(dtype=np.float64)
    shares = shares / np.maximum(shares.sum(axis=1, keepdims=True), 1.0)
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    for (i, j), share in np.ndenumerate(shares):
        if share > 0:
            colour = "white" if share > 0.6 else "black"
            axes.text(j, i, str(counts.iat[i, j]), ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(counts.shape[1]), list(counts.columns), rotation=60, ha="right", fontsize=7)
    axes.set_yticks(range(counts.shape[0]), list(counts.index), fontsize=7)
    axes.set_title(title, fontsize=9)


def extrapolation_chart(rows: pd.DataFrame) -> Figure:
    """Mean error against the number of frames beyond the fit, one panel per unit; from flat ``rows``."""
    chosen = rows[(rows["study"] == EXTRAPOLATION) & rows["value"].notna()]
    chosen = chosen.assign(k=chosen["parameter"].str.removeprefix("E_").astype(float))
    units = list(dict.fromkeys(chosen["unit"]))
    figure = Figure(figsize=(5.2 * max(len(units), 1), 4.4), layout="constrained")
    for panel, unit in enumerate(units):
        axes = figure.add_subplot(1, len(units), panel + 1)
        series = list(chosen[chosen["unit"] == unit].groupby(["phenomenon", "method"], sort=False))
        for k, ((phenomenon, method), group) in enumerate(series):
            mean = group.groupby("k")["value"].mean()
            axes.plot(mean.index, mean.to_numpy(), label=f"{phenomenon}, {method}", markersize=4, **_style(k))
        axes.set(xlabel="frames beyond the fit", ylabel=f"error ({unit})", yscale="log")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7)
    return figure


def robustness_chart(rows: pd.DataFrame) -> Figure:
    """Median relative error after each change, one line per phenomenon and parameter; from flat ``rows``."""
    chosen = rows[rows["study"] == ROBUSTNESS]
    conditions = list(dict.fromkeys(chosen["condition"]))
    figure = Figure(figsize=(10, 4.8), layout="constrained")
    axes = figure.add_subplot()
    for k, ((phenomenon, parameter), group) in enumerate(chosen.groupby(["phenomenon", "parameter"], sort=False)):
        errors = [relative_error(group[group["condition"] == name]) for name in conditions]
        shown = [max(error, SMALLEST) if np.isfinite(error) else np.nan for error in errors]
        axes.plot(range(len(conditions)), shown, label=f"{phenomenon}, {parameter}", markersize=4, lw=0.8, **_style(k))
    axes.set_xticks(range(len(conditions)), conditions, rotation=45, ha="right", fontsize=8)
    axes.set(yscale="log", ylabel="error (%)")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right upper", fontsize=7)
    return figure
