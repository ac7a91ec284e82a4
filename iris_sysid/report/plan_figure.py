"""What the names in question predict: the difference in a repeat of today's clip, and in the one that is proposed."""

from __future__ import annotations

from itertools import cycle

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure

from iris_sysid.diagnosis.planning.detection_limit import DetectionLimits
from iris_sysid.diagnosis.planning.plan import Plan
from iris_sysid.report.plan_text import percent_of

COLOURS = ("#0072B2", "#D55E00", "#009E73")  # Okabe and Ito (2008); more lines cannot be told apart
MAX_ROWS = 12  # proposals drawn


def plan_figure(planned: Plan) -> Figure:
    """Two panels, a repeat and the best proposal, with the noise of a sample as a band.

    The plan has two names in question, or more.
    """
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    draw_differences(figure, planned)
    return figure


def draw_differences(figure: Figure | SubFigure, planned: Plan) -> list[Axes]:
    """The two panels of :func:`plan_figure` in a figure."""
    noise, quantity = float(planned.fitted.rms[0]), planned.fitted.model.observed[0]
    left, right = figure.subplots(1, 2)
    first = next(iter(planned.probabilities))
    panels = ((left, planned.repeat, "today's set-up"), (right, planned.best, planned.best.text))
    for axes, proposal, title in panels:
        axes.axhspan(-noise, noise, color="0.9", label="noise of a sample")
        for colour, (name, change) in zip(COLOURS, proposal.differences.items(), strict=False):
            axes.plot(proposal.t_s, change[:, 0], color=colour, label=f"{name} less {first}")
        axes.set_title(f"{title}: {percent_of(proposal)}", fontsize=10)
        axes.set_xlabel("time (s)")
    left.set_ylabel(f"difference of {quantity.name} after a refit ({quantity.unit})")
    right.legend(fontsize=8)
    return [left, right]


def draw_remaining_errors(figure: Figure | SubFigure, planned: Plan) -> list[Axes]:
    """The standard errors after each proposal as a share of today's, best first: a row each, a mark for each value.

    Of the proposals the first MAX_ROWS are drawn.
    """
    axes = figure.subplots()
    shown = planned.proposals[:MAX_ROWS]
    names = [name for name, today in planned.stderr.items() if today > 0 and any(name in one.stderr for one in shown)]
    for colour, name in zip(cycle(COLOURS), names, strict=False):
        rows = [k for k, proposal in enumerate(shown) if name in proposal.stderr]
        shares = [shown[k].stderr[name] / planned.stderr[name] for k in rows]
        axes.plot(shares, rows, "o", color=colour, label=f"error of {name}")
    axes.axvline(1.0, color="0.6", linewidth=0.8)
    axes.set_yticks(range(len(shown)), [proposal.change.name for proposal in shown])
    axes.yaxis.set_inverted(True)
    axes.set_xlim(left=0.0)
    axes.set_xlabel("standard error, as a share of today's")
    axes.legend(fontsize=8)
    return [axes]


def limits_figure(limits: DetectionLimits, wanted: float | None) -> Figure:
    """The smallest size over the length of the clip, a line for each start, and one across for the size to be found."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    shades = np.linspace(0.8, 0.1, len(limits.starts))
    for shade, start, sizes in zip(shades, limits.starts, limits.sizes, strict=True):
        line = np.where(np.isfinite(sizes), sizes, np.nan)
        axes.plot(limits.seconds, line, "o-", color=f"{shade:.2f}", label=f"{limits.varied} = {start:.2g}")
    if wanted is not None:
        axes.axhline(abs(wanted), color=COLOURS[1], label=f"to be found: {wanted:g}")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("length of the clip (s)")
    axes.set_ylabel(f"smallest {limits.effect} ({limits.unit})")
    axes.legend(fontsize=8)
    return figure
