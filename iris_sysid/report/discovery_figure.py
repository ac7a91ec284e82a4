"""Figure of a discovery: inclusion and interval of each term, and the simulated motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iris_sysid.report.figures import COLOURS, FIT_COLOUR, draw_residual, fitted_curve
from iris_sysid.types import DiscoveredTerm, Discovery, FitResult, Trajectory

TERM_HEIGHT = 0.3  # inches per term
OTHER_COLOUR = "#999999"


def discovery_figure(discovery: Discovery, clips: Sequence[Trajectory]) -> Figure:
    """Every candidate with its inclusion and interval, then the data of the longest clip with the equation's motion.

    Intervals are drawn relative to their own half width, so that terms of all units share one axis and show whether
    they contain zero.

    Parameters
    ----------
    discovery
        The discovery.
    clips
        The clips that it was made from.

    Returns
    -------
    Figure
        Terms above, data and residual below.
    """
    longest = int(np.argmax([fit.n for fit in discovery.fits]))
    fit, clip = discovery.fits[longest], clips[longest]
    d = len(fit.model.observed)
    heights = [max(2.0, TERM_HEIGHT * len(discovery.terms) + 0.8), *([2.4, 1.2] * d)]
    figure = Figure(figsize=(9, sum(heights) + 0.4), layout="constrained")
    parts = figure.add_gridspec(1 + 2 * d, 2, height_ratios=heights)
    figure.suptitle("\n".join(f"${equation.latex}$" for equation in discovery.equations), fontsize=12)
    draw_terms(figure.add_subplot(parts[0, 0]), figure.add_subplot(parts[0, 1]), discovery.terms)
    for k in range(d):
        _draw_motion(figure.add_subplot(parts[1 + 2 * k, :]), fit, clip, k)
        axes = figure.add_subplot(parts[2 + 2 * k, :])
        draw_residual(axes, fit, k)
        axes.set_ylabel(f"residual ({fit.model.observed[k].unit})")
        axes.margins(x=0.01)
    axes.set_xlabel("time (s)")
    return figure


def draw_terms(inclusion: Axes, intervals: Axes, terms: Sequence[DiscoveredTerm]) -> None:
    """Draw the inclusion of every term, and beside it the interval of its coefficient."""
    _draw_inclusion(inclusion, terms)
    _draw_intervals(intervals, terms)


def _label(term: DiscoveredTerm) -> str:
    return f"{term.equation}: {term.term}"


def _draw_inclusion(axes: Axes, terms: Sequence[DiscoveredTerm]) -> None:
    rows = np.arange(len(terms))[::-1]
    colours = [COLOURS["motion"] if term.selected else OTHER_COLOUR for term in terms]
    axes.barh(rows, [term.inclusion for term in terms], color=colours, height=0.6)
    axes.set_yticks(rows, [_label(term) for term in terms], fontsize=8)
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


def _draw_motion(axes: Axes, fit: FitResult, clip: Trajectory, k: int) -> None:
    quantity = fit.model.observed[k]
    measured = clip.position[:, clip.column(quantity.name)]
    axes.plot(clip.t_s[clip.valid], measured[clip.valid], ".", color=COLOURS["motion"], markersize=3, label="measured")
    curve_s, curve = fitted_curve(fit)
    axes.plot(curve_s, curve[:, k], color=FIT_COLOUR, linewidth=0.9, label="equation, simulated")
    axes.set_ylabel(f"{quantity.name} ({quantity.unit})")
    axes.legend(loc="upper right", framealpha=0.8, fontsize=8)
    axes.margins(x=0.01)
