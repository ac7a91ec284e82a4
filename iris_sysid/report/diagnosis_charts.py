"""The charts of a diagnosis: the parts of the residual, the residual before and after, and the motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iris_sysid.report.chart import Band, Chart, Series
from iris_sysid.report.component_figure import MAX_CURVES, axis_titles
from iris_sysid.report.diagnosis_tables import WITH, WITHOUT, fits_of
from iris_sysid.report.diagnosis_text import share_text
from iris_sysid.report.figures import MAX_POINTS
from iris_sysid.report.page import Bar, PageImage, png_of
from iris_sysid.report.residual_budget import parts_bar
from iris_sysid.report.residual_charts import input_charts, motion_chart, residual_chart
from iris_sysid.report.text import shown_unit
from iris_sysid.types import (
    KIND_NAMES,
    Array,
    Component,
    ComponentCurve,
    Diagnosis,
    FitResult,
    Trajectory,
)


def component_bars(diagnosis: Diagnosis) -> list[Bar]:
    """The parts of the residual as a bar, and of the one that remains as a shorter bar below it."""
    components, remaining = diagnosis.components, diagnosis.remaining
    if components is None:
        return []
    bars = [parts_bar("The residual" if not diagnosis.added else "Without the added effects", components, 1.0)]
    if remaining is not None and diagnosis.added:
        ratio = remaining.residual_rms / components.residual_rms if components.residual_rms > 0 else 1.0
        bars.append(parts_bar("With the added effects, at the same scale", remaining, min(ratio**2, 1.0)))
    return bars


def component_charts(diagnosis: Diagnosis) -> list[Chart]:
    """The largest parts of the residual over what they depend on, each with its 95 % band."""
    parts = diagnosis.components.parts if diagnosis.components is not None else ()
    drawn = [part for part in parts if part.curve is not None][:MAX_CURVES]
    return [_component_chart(part, k, diagnosis.bases) for k, part in enumerate(drawn)]


def _component_chart(part: Component, number: int, fits: Sequence[FitResult]) -> Chart:
    assert part.curve is not None
    curve = part.curve
    unit, factor = shown_unit(curve.argument.unit)
    order, (lower, upper) = _visited(curve, fits), curve.band
    at, over_time = factor * curve.at[order], curve.argument.unit == "s"
    scale = np.array([180 / math.pi if one.unit.startswith("rad") else 1.0 for one in curve.quantities])  # to degrees
    names = [one.name for one in curve.quantities] if len(curve.quantities) > 1 else ["estimate"]
    values, lower, upper = (scale * some[order] for some in (curve.values, lower, upper))
    series = [Series(name, at, values[:, k], part.side, "dashes" if k else "line") for k, name in enumerate(names)]
    bands = [Band("95 % band", at, lower[:, k], upper[:, k], part.side) for k in range(len(names))]
    units = ", ".join(dict.fromkeys(quantity.unit.replace("rad", "°") for quantity in curve.quantities))
    along, up = axis_titles(part.side, curve)
    return Chart(
        f"component-{number}",
        f"{KIND_NAMES[part.kind].capitalize()}, {share_text(part)} of the residual.",
        f"{along} ({unit})",
        f"{up} ({units})",
        series,
        bands,
        words="What the fitted values can imitate is left out.",
        over_time=over_time,
    )


def _visited(curve: ComponentCurve, fits: Sequence[FitResult]) -> NDArray[np.intp]:
    """The points of a curve over a velocity, in order, that the motion has; all of any other curve."""
    order = np.argsort(curve.at)
    if not curve.argument.name.endswith(" rate") or any(fit.predicted.shape[1] > 1 for fit in fits):
        return order
    speeds = np.concatenate([_speed(fit, 0) for fit in fits])
    step = float(np.median(np.diff(curve.at[order])))
    inside = (curve.at[order] > speeds.min() - step) & (curve.at[order] < speeds.max() + step)
    return order[inside] if inside.sum() > 1 else order


def residual_charts(diagnosis: Diagnosis, clip: Trajectory) -> list[Chart]:
    """The residual of each quantity without the effects and with them, then its motion, then the inputs."""
    named = {"": "before", WITHOUT: "before", WITH: "after"}
    charts: list[Chart] = []
    fits = fits_of(diagnosis)[::-1]
    for k in range(len(diagnosis.base.model.observed)):
        for number, (fit, which) in enumerate(fits):
            noise = diagnosis.noise_floor if len(diagnosis.base.model.observed) == 1 else float(fit.noise[k])
            name, colour = f"residual-{k}-{number}", named[which] if which else ""
            charts.append(residual_chart(fit, k, noise, name=name, which=which, colour=colour))
        models = [(fit, f"the model {which}".strip(), named[which]) for fit, which in fits]
        charts.append(motion_chart(clip, models, k))
    return [*charts, *input_charts(clip, diagnosis.base)]


def state_image(diagnosis: Diagnosis) -> PageImage | None:
    """The residual in the phase plane; None for a model that has none."""
    if not diagnosis.base.model.second_order:
        return None
    caption = "Residual in the phase plane; its sign and size as colour"
    caption += ", without (left) and with (right) the added effects" if diagnosis.added else ""
    return PageImage("state", png_of(state_figure(diagnosis)), caption)


def state_figure(diagnosis: Diagnosis) -> Figure:
    """The residual's sign and size as colour in the phase plane, without and with the effects, on one scale."""
    fits = fits_of(diagnosis)[::-1]
    first = diagnosis.base
    k = int(
        np.argmax([np.ptp(_speed(first, k)) for k in range(first.predicted.shape[1])])
    )  # a throw's height, not its x
    largest = float(np.nanpercentile(np.abs(first.residual[:, k]), 98))
    figure = Figure(figsize=(9, 4), layout="constrained")
    panels = figure.subplots(1, len(fits), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (fit, which) in zip(panels, fits, strict=True):
        points = _draw_state(axes, fit, k, largest)
        axes.set(xlabel=f"{fit.model.observed[k].name} ({diagnosis.unit})")
        axes.set_title(which, loc="left", fontsize=10)
    panels[0].set_ylabel(f"speed ({diagnosis.unit}/s)")
    figure.colorbar(points, ax=panels, label=f"residual ({diagnosis.unit})")
    return figure


def _speed(fit: FitResult, k: int) -> Array:
    """Rate of change (n,) of the k-th quantity at the samples used."""
    return np.asarray(np.gradient(fit.predicted[fit.used, k], fit.t_s[fit.used]))


def _draw_state(axes: Axes, fit: FitResult, k: int, largest: float) -> PathCollection:
    some = slice(None, None, -(-fit.n // MAX_POINTS))
    position, colour = fit.predicted[fit.used, k][some], fit.residual[fit.used, k][some]
    size = float(np.clip(3600.0 / max(fit.n, 1), 4.0, 36.0))  # larger where there are few samples
    speed = _speed(fit, k)[some]
    return axes.scatter(position, speed, s=size, c=colour, cmap="RdBu_r", vmin=-largest, vmax=largest)
