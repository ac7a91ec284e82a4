"""Figures of a calibration: corners with their residuals, their coverage of the image, the world's grid on a frame.

Each function returns a matplotlib ``Figure``; none shows or saves it.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iris_sysid.calibration.camera import CameraCalibration, FittedView
from iris_sysid.calibration.plane import to_pixels, to_plane
from iris_sysid.errors import CalibrationError
from iris_sysid.report.text import round_step, with_error
from iris_sysid.types import Array, Calibration

USED, LEFT_OUT, GRID, ORIGIN = "#0072B2", "#D55E00", "#56B4E9", "#E69F00"
ARROW_PART = 0.03  # length of the arrow of a typical residual, as a fraction of the image's width
LINES = 12  # approximate number of grid lines across the image
POINTS_A_LINE = 60
NAMES_SHOWN = 40
LABEL_PART = 0.06  # margin for labels, as a fraction of the image


def camera_figure(camera: CameraCalibration) -> Figure:
    """All corners in image coordinates with their residuals, and the error of each view.

    ``camera`` must have been fitted to views. Arrows go from the predicted to the detected corner, enlarged;
    views that were left out are in another colour. Raises CalibrationError where there are no views to draw.
    """
    if not camera.views:
        raise CalibrationError("this camera was not calibrated from views, so there is nothing to draw")
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [1.7, 1]})
    enlarged = _enlargement(camera.rms_px, camera.image_size)
    for fitted in camera.views:
        _draw_residuals(left, fitted, enlarged, size=8)
    _frame(left, camera.image_size)
    left.set_title(f"corners cover {100 * camera.coverage:.0f} % of the image; residuals × {enlarged:.0f}")
    _draw_errors(right, camera)
    return figure


def view_figure(fitted: FittedView, image: NDArray[np.uint8]) -> Figure:
    """One view's corners over its own image, grey (h, w) or BGR (h, w, 3) in grey levels, with residual arrows.

    The first corner is marked; rows run from it along the arrow.
    """
    enlarged = _enlargement(fitted.rms_px, fitted.view.image_size)
    figure = Figure(figsize=(9, 9 * image.shape[0] / image.shape[1] + 0.6), layout="constrained")
    axes = figure.subplots()
    _show(axes, image)
    _draw_residuals(axes, fitted, enlarged, size=14)
    first, *_, last = fitted.view.corners_px
    axes.plot(*first, "o", color=ORIGIN, fillstyle="none", markersize=12)
    along = fitted.view.corners_px[1]
    axes.annotate("", xy=along, xytext=first, arrowprops={"arrowstyle": "->", "color": ORIGIN, "linewidth": 1.5})
    axes.plot(*last, "s", color=ORIGIN, fillstyle="none", markersize=9)
    why = f"; left out: {fitted.left_out}" if fitted.left_out else ""
    axes.set_title(
        f"{fitted.view.name}: reprojection error {fitted.rms_px:.3f} px rms, residuals × {enlarged:.0f}{why}", wrap=True
    )
    return figure


def grid_figure(calibration: Calibration, image: NDArray[np.uint8]) -> Figure:
    """The world's grid over a frame of the clip: lines of equal x and z, bent as the lens bends them.

    The image is grey (h, w) or BGR (h, w, 3), in grey levels. Lines are a round number apart, about a
    twelfth of the image. The origin is marked, and the scale stated at the position where it was calibrated.
    """
    size = image.shape[1], image.shape[0]
    step = round_step(size[0] / calibration.scale.value / LINES)
    figure = Figure(figsize=(10, 10 * size[1] / size[0] + 0.6), layout="constrained")
    axes = figure.subplots()
    _show(axes, image)
    low, high = _reach(calibration, size)
    for axis in (0, 1):
        first, last = (int(bound) for bound in (np.ceil(low[axis] / step), np.floor(high[axis] / step)))
        for k in range(first, min(last, first + 5 * LINES) + 1):
            _draw_line(axes, calibration, axis, k * step, (low, high), size)
    origin = to_pixels(calibration, np.zeros((1, 2)))[0]
    axes.plot(*origin, "+", color=ORIGIN, markersize=14, markeredgewidth=2)
    _frame(axes, size)
    scale, (x, y) = calibration.scale, calibration.centre_px
    axes.set_title(f"grid of {step:g} m, x right, z up; {with_error(scale)} at ({x:.0f}, {y:.0f}) px")
    return figure


# --------------------------------------------------------------------------- parts


def _enlargement(rms_px: float, image_size: tuple[int, int]) -> float:
    """A round factor that makes a typical residual visible."""
    return round_step(ARROW_PART * image_size[0] / max(rms_px, 1e-6))


def _show(axes: Axes, image: NDArray[np.uint8]) -> None:
    shown = image if image.ndim == 2 else image[:, :, ::-1]
    axes.imshow(shown, cmap="gray", vmin=0, vmax=255, interpolation="nearest")


def _frame(axes: Axes, image_size: tuple[int, int]) -> None:
    """Limits of the image, y down, in px."""
    axes.set_xlim(-0.5, image_size[0] - 0.5)
    axes.set_ylim(image_size[1] - 0.5, -0.5)
    axes.set_aspect("equal")
    axes.set_xlabel("x (px)")
    axes.set_ylabel("y (px)")


def _draw_residuals(axes: Axes, fitted: FittedView, enlarged: float, size: float) -> None:
    colour = LEFT_OUT if fitted.left_out else USED
    predicted = fitted.view.corners_px - fitted.residual_px
    arrows = fitted.residual_px * enlarged
    (x, y), (right, down) = predicted.T, arrows.T
    axes.scatter(x, y, s=size, color=colour, linewidths=0, alpha=0.6)
    axes.quiver(x, y, right, down, angles="xy", scale_units="xy", scale=1, color=colour, width=0.0018, headwidth=3.5)


def _draw_errors(axes: Axes, camera: CameraCalibration) -> None:
    """One bar a view, the worst on top, with its name."""
    views = sorted(camera.views, key=lambda view: view.rms_px)[-NAMES_SHOWN:]
    colours = [LEFT_OUT if view.left_out else USED for view in views]
    axes.barh(range(len(views)), [view.rms_px for view in views], color=colours)
    axes.set_yticks(range(len(views)), [view.view.name for view in views], fontsize=7)
    axes.axvline(camera.rms_px, color="#000000", linewidth=0.8, linestyle="--")
    axes.set_xlabel("reprojection error of the view, rms (px)")
    left_out = f"; {len(camera.left_out)} left out" if camera.left_out else ""
    axes.set_title(f"all views: {camera.rms_px:.3f} px{left_out}")


def _reach(calibration: Calibration, size: tuple[int, int]) -> tuple[Array, Array]:
    """Least and largest x and z (2,) that the edge of the image shows, as far as the calibration reaches."""
    x, y = np.linspace(0, size[0] - 1, 9), np.linspace(0, size[1] - 1, 9)
    inside = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    seen = [position for position in (_position(calibration, point) for point in inside) if position is not None]
    if not seen:
        raise CalibrationError("no part of this image shows the calibrated plane; does the calibration belong to it?")
    return np.min(seen, axis=0), np.max(seen, axis=0)


def _position(calibration: Calibration, point: Array) -> Array | None:
    try:
        return np.asarray(to_plane(calibration, point[None])[0][0])
    except CalibrationError:  # beyond the horizon or the lens model the grid is undefined
        return None


def _draw_line(
    axes: Axes,
    calibration: Calibration,
    axis: int,
    value: float,
    reach: tuple[Array, Array],
    size: tuple[int, int],
) -> None:
    """One line of the grid, labelled with its value where it crosses the edge of the image."""
    other = np.linspace(reach[0][1 - axis], reach[1][1 - axis], POINTS_A_LINE)
    points = np.empty((POINTS_A_LINE, 2))
    points[:, axis], points[:, 1 - axis] = value, other
    line = to_pixels(calibration, points)
    inside = np.all((line > -0.5) & (line < np.array(size) - 0.5), axis=1)
    if inside.sum() < 2:
        return
    zero = abs(value) < 1e-12
    axes.plot(*line.T, color=ORIGIN if zero else GRID, linewidth=1.1 if zero else 0.7, alpha=0.9)
    x, y = line[inside][0]
    if (x > LABEL_PART * size[0]) if axis == 1 else (y < (1 - LABEL_PART) * size[1]):
        return  # labels only at the left and bottom edge
    label = axes.text(x, y, f"{value:g}", fontsize=7, color="#000000", clip_on=True)
    label.set_bbox({"facecolor": "#ffffff", "alpha": 0.6, "linewidth": 0, "pad": 0.8})
