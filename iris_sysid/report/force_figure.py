"""The force that a model lacks, drawn over time, position and velocity."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from iris_sysid.types import Array, MissingForce

ESTIMATE, EFFECTS = "#0072B2", "#D55E00"  # Okabe and Ito (2008)
HEIGHT_IN = 2.8


def force_figure(force: MissingForce) -> Figure:
    """The force with its 95 % band over time, position and velocity, one row for each degree of freedom.

    Parameters
    ----------
    force
        What the model lacks; the contribution of the effects that were added is drawn as a line.
    """
    count = len(force.quantities)
    figure = Figure(figsize=(9, HEIGHT_IN * count), layout="constrained")
    rows = figure.subplots(count, 3, sharey="row", squeeze=False, width_ratios=(1.6, 1, 1))
    for k, (over_time, over_position, over_velocity) in enumerate(rows):
        quantity = force.quantities[k]
        _draw_course(over_time, force, k)
        over_time.set(xlabel="time (s)", ylabel=f"force on {quantity.name} ({force.units[k]})")
        _draw_points(over_position, force.position[:, k], force, k)
        over_position.set_xlabel(f"{quantity.name} ({quantity.unit})")
        _draw_points(over_velocity, force.velocity[:, k], force, k)
        over_velocity.set_xlabel(f"rate of {quantity.name} ({quantity.unit}/s)")
    if force.by_effects is not None:
        rows[0][0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    return figure


def force_caption(force: MissingForce) -> str:
    """What the figure shows, in words."""
    end = "" if force.whole else f", in the first {force.t_s[-1] - force.t_s[0]:.3g} s"
    effects = "" if force.by_effects is None else ", and what the added effects contribute to it"
    return (
        f"Force that the model lacks, as an acceleration with its 95 % band, over time, position and velocity{end}"
        f"{effects}; without the part that changes of the fitted parameters can imitate"
    )


def _draw_course(axes: Axes, force: MissingForce, k: int) -> None:
    lower, upper = (end[:, k] for end in force.band)
    axes.axhline(0, color="#888888", linewidth=0.6)
    axes.fill_between(force.t_s, lower, upper, color=ESTIMATE, alpha=0.2, linewidth=0)
    axes.plot(force.t_s, force.force[:, k], color=ESTIMATE, linewidth=1.2, label="estimate and 95 % band")
    if force.by_effects is not None:
        axes.plot(force.t_s, force.by_effects[:, k], color=EFFECTS, linewidth=1.0, label="added effects")
    axes.margins(x=0.01)
    axes.set_ylim(_limits(force, k))


def _limits(force: MissingForce, k: int) -> tuple[float, float]:
    """Range of the drawing: that of the band, without the few widest places at the ends of a clip."""
    lower, upper = (end[:, k] for end in force.band)
    low, high = float(np.percentile(lower, 4)), float(np.percentile(upper, 96))
    drawn = [force.force[:, k]] + ([] if force.by_effects is None else [force.by_effects[:, k]])
    low, high = min(low, *(float(line.min()) for line in drawn)), max(high, *(float(line.max()) for line in drawn))
    margin = 0.05 * (high - low) or 1.0
    return low - margin, high + margin


def _draw_points(axes: Axes, along: Array, force: MissingForce, k: int) -> None:
    axes.axhline(0, color="#888888", linewidth=0.6)
    error = (force.band[1] - force.force)[:, k]
    axes.errorbar(
        along,
        force.force[:, k],
        error,
        fmt=".",
        color=ESTIMATE,
        markersize=4,
        ecolor=(0.0, 0.45, 0.7, 0.2),
        elinewidth=2,
    )
    if force.by_effects is not None:
        axes.plot(along, force.by_effects[:, k], "_", color=EFFECTS, markersize=5)
