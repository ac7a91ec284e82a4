"""Charts of the benchmark from its flat rows: errors, and errors of extrapolation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from iris_sysid.benchmark.sources.rows import EXTRAPOLATION, PARAMETERS, method_name
from iris_sysid.benchmark.tables.headline import NULLS
from iris_sysid.benchmark.tables.summary import parameter_summary

# Okabe and Ito (2008): colours that are distinct for every kind of colour vision; markers differ as well
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
MARKERS = "osD^vP*X"
NULL_COLOUR = "#999999"
LINE_HEIGHT = 0.24  # inches a line of the error chart
SMALLEST = 1e-3  # %, where the error axis ends: smaller errors are drawn there


def charts_of(rows: pd.DataFrame) -> dict[str, tuple[Figure, str]]:
    """Every chart that has rows, by name, with its caption."""
    makers = {
        "errors": (
            PARAMETERS,
            error_chart,
            "Mean relative error of each parameter, from 0.001 % on.",
        ),
        "extrapolation": (EXTRAPOLATION, extrapolation_chart, "Error k frames beyond the 100 fitted; mean of clips."),
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
