"""The terms of a discovery, drawn: inclusion and interval of each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from iris_sysid.report.figures import COLOURS
from iris_sysid.types import DiscoveredTerm

OTHER_COLOUR = "#999999"


def draw_terms(inclusion: Axes, intervals: Axes, terms: Sequence[DiscoveredTerm]) -> None:
    """Draw the inclusion of every term, and beside it the interval of its coefficient.

    Intervals are drawn relative to their own half width, so that terms of all units share one axis and show whether
    they contain zero.
    """
    _draw_inclusion(inclusion, terms)
    _draw_intervals(intervals, terms)


def _draw_inclusion(axes: Axes, terms: Sequence[DiscoveredTerm]) -> None:
    rows = np.arange(len(terms))[::-1]
    colours = [COLOURS["motion"] if term.selected else OTHER_COLOUR for term in terms]
    axes.barh(rows, [term.inclusion for term in terms], color=colours, height=0.6)
    axes.set_yticks(rows, [f"{term.equation}: {term.term}" for term in terms], fontsize=8)
    axes.set(xlim=(0, 1.02), xlabel="inclusion in resampled data", title="blue: selected")
    axes.title.set_fontsize(9)


def _draw_intervals(axes: Axes, terms: Sequence[DiscoveredTerm]) -> None:
    """Coefficients in units of their 95 % half width, on a scale that is linear near zero."""
    rows = np.arange(len(terms))[::-1]
    for row, term in zip(rows, terms, strict=True):
        lower, upper = term.coefficient.interval
        half = (upper - lower) / 2
        if not (np.isfinite(half) and half > 0):
            continue
        centre = term.coefficient.value / half
        colour = COLOURS["motion"] if term.selected else OTHER_COLOUR
        axes.plot([centre - 1, centre + 1], [row, row], color=colour, linewidth=2)
        axes.plot(centre, row, "o", color=colour, markersize=4)
        text = f"{term.coefficient.value:.4g} ± {half:.1g}" if term.selected else ""
        axes.annotate(text, (centre, row), textcoords="offset points", xytext=(0, 5), ha="center", fontsize=7)
    axes.axvline(0, color="#444444", linewidth=0.8)
    axes.set_xscale("symlog", linthresh=10)
    axes.set_xticks([-1e4, -1e2, -10, 0, 10, 1e2, 1e4])
    axes.set_yticks(rows, [""] * len(terms))
    axes.set(xlabel="coefficient / half width of its 95 % interval", ylim=(-0.7, len(terms) - 0.3))
    axes.set_title("95 % interval (grey: if added)", fontsize=9)
    axes.margins(x=0.15)
