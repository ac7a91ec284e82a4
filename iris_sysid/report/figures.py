"""Figures of a report: the track on the clip, the trajectory with its fit, the residual.

Each function returns a matplotlib ``Figure``; none shows or saves it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.mathtext import MathTextParser
from matplotlib.patches import Circle
from numpy.typing import NDArray

from fitters.ode import simulate
from iris_sysid.calibration.plane import to_pixels
from iris_sysid.types import Array, Calibration, FitResult, FrameSource, Track, Trajectory
from iris_sysid.video.multiple_exposure import PHASES, multiple_exposure, sampled_views

# Okabe and Ito (2008): eight colours that people with any colour vision can distinguish.
COLOURS = {
    "motion": "#0072B2",
    "release": "#E69F00",
    "hand": "#D55E00",
    "contact": "#CC79A7",
    "rest": "#009E73",
    "": "#999999",
}
FIT_COLOUR = "#000000"
MAX_PX = 1600  # side of a multiple exposure
TALLEST_IN, NARROWEST_IN = 9.0, 3.5  # of the picture of a tall clip
CURVE_POINTS = 600
MAX_POINTS = 5000  # of a quantity in a plot


def sample_labels(trajectory: Trajectory) -> list[str]:
    """The segment label of each sample, ``""`` outside every segment."""
    labels = [""] * trajectory.n
    for segment in trajectory.segments:
        labels[segment.start : segment.stop] = [segment.label] * (segment.stop - segment.start)
    return labels


def track_figure(
    video: FrameSource, tracks: Sequence[Track], trajectory: Trajectory, calibration: Calibration
) -> Figure:
    """Multiple exposure of the clip with the track over it, coloured by segment.

    Parameters
    ----------
    video
        The clip; a few of its frames are superposed.
    tracks
        One a body, in px.
    trajectory
        Its segments colour the samples; its geometry gives the pivot, when it has one.
    calibration
        Maps the pivot to px.

    Returns
    -------
    Figure
        As wide as a page, with the clip's aspect ratio; of a tall clip no taller than a page.
    """
    width = min(9.0, max(TALLEST_IN * video.width / video.height, NARROWEST_IN))
    figure = Figure(figsize=(width, min(width * video.height / video.width, TALLEST_IN)), layout="constrained")
    draw_track(figure.add_subplot(), video, tracks, trajectory, calibration)
    return figure


def draw_track(
    axes: Axes, video: FrameSource, tracks: Sequence[Track], trajectory: Trajectory, calibration: Calibration
) -> None:
    """Draw what :func:`track_figure` shows.

    Parameters
    ----------
    axes
        To draw on.
    video, tracks, trajectory, calibration
        As for :func:`track_figure`.
    """
    views = sampled_views(video, tracks[0] if tracks else None, MAX_PX, PHASES)
    width, height = video.width, video.height
    picture = multiple_exposure([image for _, image in views])[..., ::-1]
    axes.imshow(picture, extent=(-0.5, width - 0.5, height - 0.5, -0.5))
    labels = np.array(sample_labels(trajectory))
    for body in tracks:
        axes.plot(*body.xy_px.T, color="white", linewidth=0.6, alpha=0.6)
        for label in dict.fromkeys(labels):
            inside = (labels == label) & body.valid
            axes.plot(*body.xy_px[inside].T, ".", color=COLOURS[label], markersize=4, label=label or "not used")
    _draw_pivot(axes, trajectory, calibration)
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xlabel="x (px)", ylabel="y (px)")
    handles, names = axes.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    axes.legend(unique.values(), unique.keys(), loc="lower right", framealpha=0.8)


def _draw_pivot(axes: Axes, trajectory: Trajectory, calibration: Calibration) -> None:
    geometry = trajectory.geometry
    if not {"pivot_x", "pivot_z", "arc_radius"} <= geometry.keys():
        return
    across, height, radius = (geometry[name].value for name in ("pivot_x", "pivot_z", "arc_radius"))
    (x, y), edge = to_pixels(calibration, np.array([[across, height], [across + radius, height]]))
    radius_px = float(np.hypot(*(edge - [x, y])))
    axes.add_patch(Circle((x, y), radius_px, fill=False, color="#009E73", linewidth=1, linestyle="--"))
    axes.plot(x, y, "+", color="#009E73", markersize=12, label="pivot and arc")


def fit_figure(trajectory: Trajectory, fit: FitResult) -> Figure:
    """Each measured quantity with its fit, and under it the residual against the noise; then the inputs, if any.

    Two rows a quantity and one an input, over time in s.
    """
    d, driven = len(fit.model.observed), [quantity.name for quantity in fit.model.inputs]
    figure = Figure(figsize=(9, 4.6 * d + 1.4 * len(driven)), layout="constrained")
    heights = [3, 1.4] * d + [1.4] * len(driven)
    rows = figure.subplots(len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights})[:, 0]
    labels = np.array(sample_labels(trajectory))
    curve_s, curve = fitted_curve(fit)
    for k, quantity in enumerate(fit.model.observed):
        measured = trajectory.position[:, trajectory.column(quantity.name)]
        draw_measured(rows[2 * k], trajectory, measured, labels)
        rows[2 * k].plot(curve_s, curve[:, k], color=FIT_COLOUR, linewidth=0.9, label="fit")
        rows[2 * k].set_ylabel(f"{quantity.name} ({quantity.unit})")
        rows[2 * k].legend(loc="upper right", framealpha=0.8)
        draw_residual(rows[2 * k + 1], fit, k)
        rows[2 * k + 1].set_ylabel(f"residual ({quantity.unit})")
    for axes, name in zip(rows[2 * d :], driven, strict=True):
        draw_input(axes, trajectory, name, held=trajectory.hold == "zero-order")
    rows[-1].set_xlabel("time (s)")
    return figure


def draw_input(axes: Axes, trajectory: Trajectory, name: str, *, held: bool) -> None:
    """Draw a known input u(t) over time, in steps where it is held between samples.

    Parameters
    ----------
    axes
        To draw on.
    trajectory
        Has the input of that name.
    name
        Of the input.
    held
        Whether it keeps the value of the last sample.
    """
    k = [quantity.name for quantity in trajectory.input_quantities].index(name)
    assert trajectory.inputs is not None
    style = "steps-post" if held else "default"
    axes.plot(trajectory.t_s, trajectory.inputs[:, k], color=FIT_COLOUR, linewidth=0.9, drawstyle=style)
    axes.set_ylabel(f"{name} ({trajectory.input_quantities[k].unit})")


def fitted_curve(fit: FitResult) -> tuple[Array, Array]:
    """Times (m,) s and the fitted motion (m, d), with points between the samples where there are few samples."""
    used = np.flatnonzero(fit.used)
    if not fit.usable or used.size < 2 or used.size > CURVE_POINTS or fit.model.inputs:
        return fit.t_s, fit.predicted
    t_s = np.linspace(fit.t0_s, fit.t_s[used[-1]], CURVE_POINTS)
    return t_s, simulate(fit.model, t_s, {name: estimate.value for name, estimate in fit.estimates.items()}).observed


def draw_measured(axes: Axes, trajectory: Trajectory, measured: Array, labels: NDArray[np.str_]) -> None:
    """Draw the measured values of one quantity over time, coloured by segment.

    Parameters
    ----------
    axes
        To draw on.
    trajectory
        Gives the times in s, and which samples are valid.
    measured
        (n,) in the unit of the quantity.
    labels
        (n,) segment of each sample.
    """
    for label in dict.fromkeys(labels):
        inside = np.flatnonzero((labels == label) & trajectory.valid)
        inside = inside[outline(measured[inside])]
        axes.plot(
            trajectory.t_s[inside], measured[inside], ".", color=COLOURS[label], markersize=4, label=label or "measured"
        )
    axes.margins(x=0.01)


def draw_residual(axes: Axes, fit: FitResult, k: int) -> None:
    """Draw the residual of the k-th quantity over time, with a band of two standard deviations of the noise."""
    noise = fit.noise[k]
    axes.axhline(0, color="#888888", linewidth=0.6)
    if np.isfinite(noise):
        axes.axhspan(-2 * noise, 2 * noise, color="#009E73", alpha=0.15, label="± 2 noise")
        axes.legend(loc="upper right", framealpha=0.8)
    shown = outline(fit.residual[:, k])
    axes.plot(fit.t_s[shown], fit.residual[shown, k], ".-", color=COLOURS["motion"], markersize=3, linewidth=0.4)


def outline(values: Array) -> NDArray[np.intp]:
    """Indices (m,) of the samples to draw: all, or of a long record the lowest and the highest in each short part.

    ``values`` (n,) in any unit; NaN is not drawn.
    """
    finite = np.flatnonzero(np.isfinite(values))
    if finite.size <= MAX_POINTS:
        return np.arange(values.size)
    parts = np.array_split(finite, MAX_POINTS // 2)
    return np.unique([part[choose(values[part])] for part in parts for choose in (np.argmin, np.argmax)])


def equation_figure(equation: str) -> Figure:
    """An equation in LaTeX math, drawn with matplotlib's math text; plain text where that fails."""
    text, size = f"${equation}$", FontProperties(size=15)
    try:
        width_pt = MathTextParser("path").parse(text, dpi=72, prop=size)[0]
    except ValueError:
        text, width_pt = equation.replace("$", r"\$"), 0.0
    figure = Figure(figsize=(max(6.0, width_pt / 72 + 0.2), 0.6))
    figure.text(0.0, 0.5, text, va="center", fontproperties=size)
    return figure
