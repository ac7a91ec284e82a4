"""Charts of a fit: each measured quantity with the model, its residual against the noise, and the inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.report.chart import Band, Chart, ChartMark, Series
from iris_sysid.report.figures import fitted_curve, sample_labels
from iris_sysid.report.film import BODIES
from iris_sysid.report.residual_words import largest_text, residual_words
from iris_sysid.report.text import as_sentence, shown_unit
from iris_sysid.report.typeset import name_with_symbol
from iris_sysid.types import Array, FitResult, Quantity, SegmentLabel, Trajectory

LABEL_COLOURS: dict[SegmentLabel | str, str] = {
    "hand": "input",
    "release": "clock",
    "contact": "force",
    "rest": "unused",
    "": "unused",
}
MARGIN = 0.03  # of the time of the fit, shown before and after it


def body_colour(quantities: Sequence[Quantity], k: int) -> str:
    """The class of the colour of the body that the ``k``-th quantity is of: x and z are of one, others of one each."""
    names = [quantity.name for quantity in quantities]
    return "body-1" if names == ["x", "z"] else f"body-{k % BODIES + 1}"


def motion_chart(trajectory: Trajectory, fits: Sequence[tuple[FitResult, str, str]], k: int) -> Chart:
    """The ``k``-th observed quantity over time with its fits, each with its name and the class of its colour."""
    quantity = fits[0][0].model.observed[k]
    named = name_with_symbol(quantity)
    unit, factor = shown_unit(quantity.unit)
    measured = factor * trajectory.position[:, trajectory.column(quantity.name)]
    labels, series = np.array(sample_labels(trajectory)), []
    for label in dict.fromkeys(labels.tolist()):
        inside = (labels == label) & trajectory.valid
        colour = LABEL_COLOURS.get(label, body_colour(fits[0][0].model.observed, k))
        if not trajectory.segments:
            label, colour = "measured", body_colour(fits[0][0].model.observed, k)
        if inside.any():
            series.append(Series(label or "not used", trajectory.t_s[inside], measured[inside], colour))
    fits = [one for one in fits if one[0].usable]
    for fit, name, colour in fits:
        curve_s, curve = fitted_curve(fit)
        finite = np.isfinite(curve[:, k])
        series.append(Series(name, curve_s[finite], factor * curve[finite, k], colour, "line"))
    with_models = f", with {' and '.join(name for _, name, _ in fits)}" if fits else ""
    return Chart(
        f"motion-{k}",
        f"Motion: {named} measured{with_models}.",
        "time (s)",
        f"{named} ({unit})",
        series,
        over_time=True,
        reach=_reach(fits[0][0]) if fits else None,
        shows_motion=True,
    )


def _reach(fit: FitResult) -> tuple[float, float]:
    """The time, s, that a fit covers, and a little on both sides."""
    first, last = fit.t_s[np.flatnonzero(fit.used)[[0, -1]]].tolist()
    return first - MARGIN * (last - first), last + MARGIN * (last - first)


def residual_chart(fit: FitResult, k: int, noise: float, *, name: str, which: str = "", colour: str = "") -> Chart:
    """The residual of one observed quantity over time, with its features written on it.

    Parameters
    ----------
    fit
        Of the residual.
    k
        Which of the observed quantities.
    noise
        Its standard deviation in the unit of the quantity; NaN where it is not known.
    name
        Of the chart, for the page.
    which
        What was fitted, in words, for the title.
    colour
        The class of the colour; that of the body where it is empty.
    """
    quantity = fit.model.observed[k]
    unit, factor = shown_unit(quantity.unit)
    seen = residual_words(fit, k)
    shown = np.isfinite(fit.residual[:, k])
    t_s, values = fit.t_s[shown], factor * fit.residual[shown, k]
    title = f"Residual of {name_with_symbol(quantity)}{f' {which}' if which else ''}."
    curve = Series("residual", t_s, values, colour or body_colour(fit.model.observed, k))
    words = "" if seen is None else as_sentence(f"{largest_text(seen, quantity.unit)}; {seen.looks}")
    marks = (
        []
        if seen is None
        else [ChartMark(seen.t_s, factor * seen.value, largest_text(seen, quantity.unit), seen.looks)]
    )
    bands = [_noise_band(t_s, factor * noise)] if np.isfinite(noise) and t_s.size else []
    label, reach = f"residual ({unit})", _reach(fit) if fit.used.any() else None
    return Chart(name, title, "time (s)", label, [curve], bands, marks, words, over_time=True, reach=reach)


def _noise_band(t_s: Array, noise: float) -> Band:
    ends = np.array([t_s[0], t_s[-1]])
    return Band("± 2 noise", ends, np.full(2, -2 * noise), np.full(2, 2 * noise), "noise")


def input_charts(trajectory: Trajectory, fit: FitResult) -> list[Chart]:
    """The known inputs of a model over time."""
    charts: list[Chart] = []
    names = [quantity.name for quantity in trajectory.input_quantities]
    for quantity in fit.model.inputs:
        if trajectory.inputs is not None and quantity.name in names:
            values = trajectory.inputs[:, names.index(quantity.name)]
            series = [Series(quantity.name, trajectory.t_s, values, "model", "line")]
            label = f"{quantity.name} ({quantity.unit})"
            name, title = f"input-{len(charts)}", f"Input {quantity.name}."
            charts.append(Chart(name, title, "time (s)", label, series, over_time=True))
    return charts
