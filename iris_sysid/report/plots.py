"""Plots for notebooks and scripts: one function for every result, which returns matplotlib axes."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, SubFigure
from numpy.typing import NDArray

from fitters.ode.prediction import Prediction
from iris_sysid.diagnosis.planning.plan import Plan
from iris_sysid.errors import DataError, VideoError
from iris_sysid.report.discovery_figure import draw_terms
from iris_sysid.report.figures import (
    COLOURS,
    FIT_COLOUR,
    draw_measured,
    draw_residual,
    draw_track,
    fitted_curve,
    outline,
    sample_labels,
)
from iris_sysid.report.plan_figure import draw_differences, draw_remaining_errors
from iris_sysid.types import (
    NORMAL_975,
    Array,
    Diagnosis,
    Discovery,
    FitResult,
    Quantity,
    Run,
    Smoothed,
    Track,
    Trajectory,
)

WIDTH_IN = 8.0
TALL_IN, LOW_IN = 2.6, 1.2  # rows of data, rows of residuals
MIN_OF_A_LINE = 30  # times of a prediction: fewer are shown as points too
WITHOUT_COLOUR = "#D55E00"  # Okabe and Ito (2008), as on the page of a diagnosis
Result = Trajectory | Track | Smoothed | FitResult | Diagnosis | Discovery | Run | Prediction | Plan


def plot(result: Result, figure: Figure | SubFigure | None = None) -> NDArray[np.object_]:
    """Draw a result: data with fit, residual before and after, the path of a track, the terms of an equation.

    Parameters
    ----------
    result
        A trajectory, its smoothed state, a track, a fit, a prediction, a diagnosis, a plan, a discovery, or the run
        of a clip.
    figure
        Figure or subfigure to draw in; without one, pyplot makes one, which a notebook shows.

    Returns
    -------
    numpy.ndarray
        The axes (k,) as a count from the top down, to be changed as any others; ``axes[0].figure`` is the figure.

    Raises
    ------
    DataError
        When there is no plot of such an object.

    Examples
    --------
    >>> import matplotlib; matplotlib.use("agg")
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, fit, plot, simulate
    >>> fall, t_s = MODELS["free-fall"], np.arange(60) / 60
    >>> z = simulate(fall, t_s, {"gravity": 9.81, "z_0": 5.0, "vz_0": 0.0}).observed
    >>> z += 1e-3 * np.random.default_rng(0).standard_normal(z.shape)
    >>> clip = Trajectory(t_s, fall.observed, z, np.full_like(z, np.nan), np.ones(60, bool))
    >>> [axes.get_ylabel() for axes in plot(fit(clip, fall))]
    ['z (m)', 'residual (m)']
    """
    heights = _heights(result)
    if figure is None:
        from matplotlib import pyplot as plt

        figure = plt.figure(figsize=(WIDTH_IN, sum(heights) + 0.5), layout="constrained")
    return np.array(_draw(result, figure, heights), dtype=object)


def figure_of(result: Result) -> Figure:
    """The plot as a figure that pyplot does not know, to be written to a file."""
    figure = Figure(figsize=(WIDTH_IN, sum(_heights(result)) + 0.5), layout="constrained")
    plot(result, figure)
    return figure


def _rows(figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    """Axes below each other, over one time."""
    rows = figure.subplots(len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights})
    return list(rows[:, 0])


def _halves(figure: Figure | SubFigure, heights: list[float]) -> NDArray[np.object_]:
    """A subfigure for the first row, and one for those below."""
    return np.array(figure.subfigures(2, 1, height_ratios=[heights[0], sum(heights[1:])]), dtype=object)


# --------------------------------------------------------------------------- heights of the rows, in inches


@functools.singledispatch
def _heights(result: Any) -> list[float]:
    raise DataError(f"there is no plot of an object of type {type(result).__name__}")


def _height_of_run(result: Run) -> list[float]:
    picture = (WIDTH_IN - 1.0) * result.video.height / result.video.width
    return [min(picture, 2 * TALL_IN), *_heights(result.fit)]


_heights.register(Trajectory, lambda it: [TALL_IN] * len(it.quantities) + [LOW_IN] * len(it.input_quantities))
_heights.register(Smoothed, lambda it: [TALL_IN] * (2 * it.position.shape[1]))
_heights.register(Track, lambda it: [1.6 * TALL_IN, LOW_IN, LOW_IN])
_heights.register(FitResult, lambda it: [TALL_IN, LOW_IN] * len(it.model.observed))
_heights.register(Diagnosis, lambda it: [TALL_IN, *[LOW_IN] * (2 if it.added else 1)] * len(it.base.model.observed))
_heights.register(Discovery, lambda it: [max(2.0, 0.28 * len(it.terms) + 0.8), *_heights(_longest(it))])
_heights.register(Run, _height_of_run)
_heights.register(Prediction, lambda it: [TALL_IN] * len(it.fitted.model.observed))
_heights.register(Plan, lambda it: [1.3 * TALL_IN])


# --------------------------------------------------------------------------- drawings


@functools.singledispatch
def _draw(result: Any, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    raise DataError(f"there is no plot of an object of type {type(result).__name__}")


@_draw.register
def _(result: Trajectory, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    rows, labels, d = _rows(figure, heights), np.array(sample_labels(result)), len(result.quantities)
    for k, quantity in enumerate(result.quantities):
        draw_measured(rows[k], result, result.position[:, k], labels)
        if result.smoothed is not None:
            rows[k].plot(result.t_s, result.smoothed.position[:, k], color=FIT_COLOUR, linewidth=0.8, label="smoothed")
        _finish(rows[k], quantity, legend=bool(result.segments) or result.smoothed is not None)
    for row, quantity, column in zip(
        rows[d:], result.input_quantities, () if result.inputs is None else result.inputs.T, strict=True
    ):
        row.plot(result.t_s, column, color=COLOURS["release"], linewidth=1.0)
        _finish(row, quantity)
    rows[-1].set_xlabel("time (s)")
    return rows


@_draw.register
def _(result: Smoothed, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    rows, d = _rows(figure, heights), result.position.shape[1]
    sigma = np.sqrt(np.diagonal(result.covariance, axis1=1, axis2=2))
    for k, row in enumerate(rows):
        value = (result.position if k < d else result.velocity)[:, k % d]
        _draw_band(row, np.arange(value.size), value, sigma[:, k])
        row.set_ylabel(f"{'position' if k < d else 'velocity'}{f' {k % d + 1}' if d > 1 else ''}")
    rows[-1].set_xlabel("sample")
    return rows


@_draw.register
def _(result: Track, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    path, *over_time = (figure.add_subplot(grid[k]) for k in range(len(heights)))
    found = result.valid
    path.plot(*result.xy_px[found].T, ".-", color=COLOURS["motion"], markersize=4, linewidth=0.5)
    path.set(xlabel="x (px)", ylabel="y (px)", aspect="equal")
    path.yaxis.set_inverted(True)  # as in the image
    for k, row in enumerate(over_time):
        row.plot(result.t_s[found], result.xy_px[found, k], ".", color=COLOURS["motion"], markersize=3)
        _finish(row, Quantity("xy"[k], "px"))
    over_time[0].sharex(over_time[1])
    over_time[0].tick_params(labelbottom=False)
    over_time[-1].set_xlabel("time (s)")
    return [path, *over_time]


@_draw.register
def _(result: FitResult, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    rows = _rows(figure, heights)
    for k, quantity in enumerate(result.model.observed):
        _draw_fits(rows[2 * k], k, (result, FIT_COLOUR, "fit"))
        _draw_residual(rows[2 * k + 1], result, k, f"residual ({quantity.unit})")
    rows[-1].set_xlabel("time (s)")
    return rows


@_draw.register
def _(result: Diagnosis, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    rows, each = _rows(figure, heights), 3 if result.added else 2
    names = ", ".join(effect.name for effect in result.added)
    for k in range(len(result.base.model.observed)):
        data, before, *after = rows[each * k : each * (k + 1)]
        without = (result.base, WITHOUT_COLOUR if after else FIT_COLOUR, result.base.model.name)
        _draw_fits(data, k, without, *([(result.final, FIT_COLOUR, f"with {names}")] if after else []))
        _draw_residual(before, result.base, k, "residual before" if after else "residual")
        if after:
            _draw_residual(after[0], result.final, k, "residual after")
    rows[-1].set_xlabel("time (s)")
    return rows


@_draw.register
def _(result: Discovery, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    figure.suptitle("\n".join(f"${equation.latex}$" for equation in result.equations), fontsize=11)
    top, bottom = _halves(figure, heights)
    inclusion, intervals = top.subplots(1, 2)
    draw_terms(inclusion, intervals, result.terms)
    return [inclusion, intervals, *_draw(_longest(result), bottom, heights[1:])]


@_draw.register
def _(result: Run, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    top, bottom = _halves(figure, heights)
    picture = top.subplots()
    try:
        draw_track(picture, result.video, result.tracks, result.trajectory, result.calibration)
    except VideoError as error:  # the file is gone: the rest is still to be seen
        picture.set_title(str(error)[:100], fontsize=8)
    return [picture, *_draw(result.fit, bottom, heights[1:])]


@_draw.register
def _(result: Prediction, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    rows, along = _rows(figure, heights), np.argsort(result.t_s)
    marker = "o" if along.size < MIN_OF_A_LINE else None
    for k, row in enumerate(rows):
        t_s, ends = result.t_s[along], (result.lower[along, k], result.upper[along, k])
        row.fill_between(t_s, *ends, color=WITHOUT_COLOUR, alpha=0.3, linewidth=0, label="95 % of the equation")
        row.plot(t_s, result.observed[along, k], color=WITHOUT_COLOUR, marker=marker, linewidth=1.0, label="predicted")
        _draw_fits(row, k, (result.fitted, FIT_COLOUR, "fit"))
    rows[-1].set_xlabel("time (s)")
    return rows


@_draw.register
def _(result: Plan, figure: Figure | SubFigure, heights: list[float]) -> list[Axes]:
    return (draw_differences if result.repeat.differences else draw_remaining_errors)(figure, result)


def _longest(result: Discovery) -> FitResult:
    """The fit of the clip with the most samples."""
    return max(result.fits, key=lambda fit: fit.n)


def _draw_fits(axes: Axes, k: int, *fits: tuple[FitResult, str, str]) -> None:
    """The samples that the fits used, and the curve of each, with its colour and its name."""
    fitted = fits[0][0]
    observed = (fitted.predicted + fitted.residual)[:, k]
    shown = outline(observed)
    axes.plot(fitted.t_s[shown], observed[shown], ".", color=COLOURS["motion"], markersize=4, label="measured")
    for one, colour, name in fits:
        curve_s, curve = fitted_curve(one)
        axes.plot(curve_s, curve[:, k], color=colour, linewidth=1.0, label=name)
    _finish(axes, fitted.model.observed[k], legend=True)


def _draw_residual(axes: Axes, fitted: FitResult, k: int, label: str) -> None:
    draw_residual(axes, fitted, k)
    axes.set_ylabel(label)
    axes.margins(x=0.01)


def _draw_band(axes: Axes, along: NDArray[np.int_], value: Array, sigma: Array) -> None:
    axes.fill_between(
        along, value - NORMAL_975 * sigma, value + NORMAL_975 * sigma, color=COLOURS["motion"], alpha=0.25, linewidth=0
    )
    axes.plot(along, value, color=COLOURS["motion"], linewidth=1.0)
    axes.margins(x=0.01)


def _finish(axes: Axes, quantity: Quantity, *, legend: bool = False) -> None:
    axes.set_ylabel(f"{quantity.name} ({quantity.unit})")
    axes.margins(x=0.01)
    if legend:
        axes.legend(loc="upper right", framealpha=0.8, fontsize=8)
