"""The picture of a class: each group's value with its error, those that stand out, the mean, what is known."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iris_sysid.classroom.summary import ClassResult, GroupResult, shown_name
from iris_sysid.report.text import shown_unit
from iris_sysid.types import NORMAL_975

USUAL, OUTLYING, MEAN, KNOWN = "#0072B2", "#D55E00", "#0072B2", "#009E73"  # Okabe and Ito (2008)
AXIS = "#808080"  # seen on white and on black
WIDTH_IN, PHONE_IN, ROW_IN, MIN_IN = 8.0, 4.2, 0.24, 2.0
BEYOND = 1.6  # widths of the usual groups on either side, beyond which a value is drawn as an arrow at the edge
MAX_NAME = 24


def class_figure(result: ClassResult, width_in: float = WIDTH_IN) -> Figure:
    """Draw the value of every group with its 95 % interval, one below the other.

    A value that is so far off that the others would be one point is an arrow at the edge, with its number.
    """
    shown = [group for group in (*result.groups, *([result.teacher] if result.teacher else [])) if group.value]
    figure = Figure(figsize=(width_in, max(MIN_IN, ROW_IN * len(shown) + 1.0)), layout="constrained")
    axes = figure.add_subplot()
    if not shown:
        axes.text(0.5, 0.5, "no group has a value", ha="center", va="center", transform=axes.transAxes)
        axes.set_axis_off()
        return figure
    unit, factor = shown_unit(shown[0].value.unit if shown[0].value else "")
    low, high = _limits(result, shown, factor)
    _draw_mean(axes, result, factor)
    for row, group in enumerate(shown):
        _draw_group(axes, group, row, factor, (low, high), teacher=group is result.teacher)
    axes.set_yticks(range(len(shown)), [_short(group.name) for group in shown], fontsize=8)
    for label in axes.get_yticklabels():
        label.set_parse_math(False)  # a group may be called $x$
    axes.set(xlim=(low, high), ylim=(len(shown) - 0.4, -0.6))
    axes.set_xlabel(f"{shown_name(result.value)} ({unit})" if unit not in ("", "1") else shown_name(result.value))
    axes.locator_params(axis="x", nbins=8 if width_in > PHONE_IN else 4)
    axes.grid(axis="x", linewidth=0.4, alpha=0.5)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(AXIS)
    axes.tick_params(color=AXIS)
    axes.tick_params(axis="y", length=0, pad=9)
    figure.legend(loc="outside lower left", ncols=4 if width_in > PHONE_IN else 2, frameon=False, fontsize=8)
    return figure


def svg_of(figure: Figure) -> str:
    """A figure as SVG that stands in a page, the same text for the same figure; its letters are text."""
    buffer = io.StringIO()
    with rc_context({"svg.hashsalt": "iris-sysid", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None}, transparent=True)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _limits(result: ClassResult, shown: Sequence[GroupResult], factor: float) -> tuple[float, float]:
    """The range of the axis: that of the groups that belong together, and of an outlier that is not far off."""
    usual = [group for group in shown if group.pooled] or list(shown)
    ends = np.array([_ends(group, factor) for group in usual]).ravel()
    marks = [factor * item.reference.value for item in result.comparisons[:1]]
    low, high = min([*ends, *marks]), max([*ends, *marks])
    width = max(high - low, 1e-9 * max(abs(high), 1e-9))
    for group in shown:
        first, last = _ends(group, factor)
        if first > low - BEYOND * width and last < high + BEYOND * width:
            low, high = min(low, first), max(high, last)
    margin = 0.06 * (high - low or abs(high) or 1.0)
    return low - margin, high + margin


def _ends(group: GroupResult, factor: float) -> tuple[float, float]:
    if group.value is None:
        return math.nan, math.nan
    half = NORMAL_975 * group.value.stderr
    return factor * (group.value.value - half), factor * (group.value.value + half)


def _draw_group(
    axes: Axes, group: GroupResult, row: int, factor: float, limits: tuple[float, float], *, teacher: bool
) -> None:
    if group.value is None:
        return
    value, (low, high) = factor * group.value.value, limits
    colour = KNOWN if teacher else OUTLYING if group.named else USUAL
    if low <= value <= high:
        marker = "D" if teacher else "s" if group.named else "o"
        first, last = _ends(group, factor)
        axes.plot([max(first, low), min(last, high)], [row, row], color=colour, linewidth=1.5, solid_capstyle="butt")
        face = "none" if group.outlying else colour
        axes.plot([value], [row], marker, color=colour, markerfacecolor=face, markersize=5)
        return
    at, way, side = (high, "left", ">") if value > high else (low, "right", "<")
    axes.plot([at], [row], side, color=colour, markersize=7, clip_on=False)
    pad = -8 if value > high else 8
    axes.annotate(
        f"{value:.4g}", (at, row), xytext=(pad, 0), textcoords="offset points", ha="right" if way == "left" else "left",
        va="center", fontsize=8, color=colour,
    )  # fmt: skip


def _draw_mean(axes: Axes, result: ClassResult, factor: float) -> None:
    if result.pooled is not None:
        mean, between = factor * result.pooled.mean.value, factor * result.pooled.between.value
        low, high = (factor * end for end in result.pooled.mean.interval)
        if between > 0:
            axes.axvspan(mean - between, mean + between, color=MEAN, alpha=0.08, linewidth=0, label="scatter of groups")
        axes.axvline(mean, color=MEAN, linewidth=1.0, label="mean of the class")
        axes.axvspan(low, high, color=MEAN, alpha=0.15, linewidth=0, label="its 95 % interval")
    for item in result.comparisons[:1]:
        axes.axvline(factor * item.reference.value, color=KNOWN, linestyle="--", linewidth=1.2, label=item.label)
    axes.plot([], [], "s", color=OUTLYING, markerfacecolor="none", markersize=5, label="look at this group")
    if result.teacher is not None and result.teacher.value is not None:
        axes.plot([], [], "D", color=KNOWN, markersize=5, label="the teacher's own")


def _short(name: str) -> str:
    return name if len(name) <= MAX_NAME else f"{name[: MAX_NAME - 1]}…"
