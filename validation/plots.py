"""One figure for each page of ``docs/validation``, drawn from the table that the page is about.

``python -m validation.plots`` draws all of them anew; a program that writes its table with ``--write-docs`` draws that
of its page. A figure states the fingerprint of the tables that it shows, so that a test finds one that is older.
"""

from __future__ import annotations

import argparse
import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from validation.gallery import INK, LINES, STYLE

RESULTS = Path(__file__).parent / "results"
FIGURES = Path(__file__).parent.parent / "docs" / "validation" / "figures"
WIDTH_IN, ROW_IN, FRAME_IN = 7.0, 0.2, 0.9
MAX_LABEL = 48  # letters
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
COLOURS = (LINES[2], "#999999", LINES[1], LINES[0])  # in order: good, neutral, bad


@dataclass(frozen=True, slots=True)
class Plot:
    """What a figure shows of a table.

    ``labels`` name the columns whose texts label a row, ``values`` those of the numbers; several are stacked. Where
    ``counted``, the figure shows how often each text of the column stands there instead. ``target`` is drawn as a line;
    ``axis`` says what the numbers are; beyond ``linear_to``, where that is given, it is logarithmic.
    """

    table: str
    labels: tuple[str, ...]
    values: tuple[str, ...]
    axis: str
    target: float | None = None
    counted: bool = False
    linear_to: float = 0.0


PLOTS: Mapping[str, Plot] = {
    "audit": Plot("audit", ("outcome",), ("numbers",), "published numbers"),
    "benchmark": Plot("benchmark-selection", ("data", "method"), ("accuracy (%)",), "right model (%)", target=100.0),
    "calibration": Plot("calibration-fall-4k", ("seed",), ("g m/s²",), "g (m/s²), truth 9.80665", target=9.80665),
    "diagnosis": Plot("blind-independent", ("hidden",), ("in class",), "named, or in the class named (%)"),
    "faults": Plot("clip-faults", ("clip",), ("off",), "error of the length (%)", target=0.0, linear_to=0.1),
    "fitting": Plot("coverage", ("model", "rho"), ("covered / %",), "truth in the 95 % interval (%)", target=95.0),
    "ground_truth": Plot(
        "groundtruth",
        ("class", "parameter"),
        ("rms of error / standard error",),
        "rms of error over standard error",
        1.0,
    ),
    "plans": Plot("plans-2", ("predicted power",), ("happened",), "cases in which one name was left (%)"),
    "scaling": Plot("scaling-clips", ("clips measured by",), ("clock, s",), "time for the same clips (s)"),
    "torture": Plot(
        "torture-clips", ("clip", "harm"), ("refused", "whole", "silent loss", "said"), "damaged clips: what happened"
    ),
    "tracking": Plot("real-tracks", (), ("result",), "clips of others", counted=True),
    "world": Plot("world-effects", (), ("verdict",), "recordings of others", counted=True),
}


def main() -> None:
    """Draw every figure."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    for page in PLOTS:
        draw(page)


def draw(page: str) -> Path:
    """Draw the figure of a page into ``docs/validation/figures``."""
    FIGURES.mkdir(exist_ok=True)
    path = FIGURES / f"{page}.svg"
    plot = PLOTS[page]
    figure = figure_of(plot, pd.read_csv(RESULTS / f"{plot.table}.csv", dtype=str, keep_default_na=False))
    with mpl.rc_context({"svg.hashsalt": page}):
        figure.savefig(path, transparent=True, metadata={"Date": None, "Description": fingerprint(page)})
    return path


def fingerprint(page: str) -> str:
    """What the figure of a page shows: its settings and the bytes of its table."""
    plot = PLOTS[page]
    return hashlib.sha256(repr(plot).encode() + (RESULTS / f"{plot.table}.csv").read_bytes()).hexdigest()


def figure_of(plot: Plot, rows: pd.DataFrame) -> Figure:
    """The figure of a table: a bar or a point for each row, the first row at the top.

    Parameters
    ----------
    plot
        What to show.
    rows
        The table, all cells as text.
    """
    labels, values, errors = counts(rows[plot.values[0]]) if plot.counted else numbers(plot, rows)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, FRAME_IN + ROW_IN * len(labels)), layout="constrained")
        axes = figure.add_subplot()
        at = np.arange(len(labels))[::-1]
        if len(plot.values) > 1:
            _stack(axes, at, values, plot.values)
        elif plot.target is None:
            axes.barh(at, values[:, 0], color=LINES[0], height=0.7)
        else:
            axes.axvline(plot.target, color=INK, linewidth=0.8)
            axes.errorbar(values[:, 0], at, xerr=errors[:, 0], fmt="o", color=LINES[0], markersize=4)
        if plot.linear_to:
            axes.set_xscale("symlog", linthresh=plot.linear_to)
        axes.set_yticks(at, labels, fontsize=8)
        axes.set_ylim(-0.6, len(labels) - 0.4)
        axes.set_xlabel(plot.axis)
    return figure


def _stack(axes: Axes, at: np.ndarray, values: np.ndarray, names: tuple[str, ...]) -> None:
    left = np.zeros(len(at))
    for column, (name, colour) in enumerate(zip(names, COLOURS, strict=False)):
        axes.barh(at, values[:, column], left=left, color=colour, height=0.7, label=name)
        left += values[:, column]
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=len(names), fontsize=8)


def counts(column: pd.Series) -> tuple[list[str], np.ndarray, np.ndarray]:
    """How often each text stands in a column, the most frequent first, without Markdown: labels, (n, 1), zeros."""
    number = column.str.replace("*", "").value_counts()
    return [str(text) for text in number.index], number.to_numpy(float)[:, None], np.zeros((len(number), 1))


def numbers(plot: Plot, rows: pd.DataFrame) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Labels, values (n, v) and half widths of the 95 % intervals of cells with ±.

    A cell without a number is 0; rows that have none at all are left out.
    """
    rows = rows[rows[list(plot.values)].map(lambda cell: bool(NUMBER.search(cell))).any(axis=1)]
    labels = [" ".join(words)[:MAX_LABEL] for words in rows[list(plot.labels)].to_numpy()]
    cells = [[_value_and_error(cell) for cell in row] for row in rows[list(plot.values)].to_numpy()]
    values = np.array(cells, dtype=float).reshape(len(rows), len(plot.values), 2)
    return labels, values[:, :, 0], 1.96 * values[:, :, 1]


def _value_and_error(cell: str) -> tuple[float, float]:
    """The first number of a cell, and the one behind ±; 0 where there is none."""
    value, _, error = cell.partition("±")
    return tuple(
        float(found[0].replace("−", "-")) if (found := NUMBER.search(part)) else 0.0 for part in (value, error)
    )


if __name__ == "__main__":
    main()
