"""The vertical, from a plumb line, from a flight or as assumed, and the scale of a flight from known gravity."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from iris_sysid.calibration.pixel_scale import MARK_SIGMA_PX, scale, to_world, uncalibrated
from iris_sysid.calibration.plane import positions_of
from iris_sysid.calibration.vertical import vertical_text, with_assumed_vertical, with_plumb_line, with_vertical
from iris_sysid.errors import CalibrationError
from iris_sysid.trajectory.segmentation import segment
from iris_sysid.types import Array, Calibration, Estimate, MotionKind, Phenomenon, Track

MIN_SAMPLES = 5
LEVEL_STDERR_DEG = 1.0  # standard uncertainty of a camera or a board that is levelled by eye
MAX_STDERR = 0.1  # rad: beyond it the image's own vertical is the better guess


def with_motion_vertical(calibration: Calibration, body: Track, kind: MotionKind) -> Calibration:
    """Turn the world so that a body in free flight accelerates straight down; the budget has the part ``vertical``.

    A parabola is fitted to x and z over time; up is against its acceleration. CalibrationError when the motion is not a
    ``flight``, which alone shows gravity's direction by itself, or does not fix the direction.
    """
    if kind != "flight":
        raise CalibrationError(
            "only a free flight shows by itself which way is down; mark a plumb line: --mark plumb=x1,y1,x2,y2"
        )
    world = segment(to_world(body, calibration), hand=body.hand, kind=kind)
    used = world.valid & world.mask("motion")
    if used.sum() < MIN_SAMPLES:
        raise CalibrationError(f"the motion cannot give the vertical: only {used.sum()} frames of flight were found")
    t_s, xy_px = world.t_s[used] - world.t_s[used].mean(), body.xy_px[used]
    stderr = _direction_stderr(t_s, world.position[used])
    if not stderr < MAX_STDERR:
        raise CalibrationError(
            f"the motion gives the vertical to {math.degrees(stderr):.2g} degrees only; mark a plumb line instead"
        )

    def angle_of(values: Array) -> float:
        ax, az = np.polyfit(t_s, positions_of(values, xy_px), 2)[0]
        return math.atan2(-ax, -az)

    return with_vertical(calibration, angle_of, stderr, "flight")


def _direction_stderr(t_s: Array, position: Array) -> float:
    """Standard error of the acceleration's direction, rad, from the residual of a parabola across it."""
    coefficients = np.polyfit(t_s, position, 2)
    acceleration = coefficients[0]
    size = float(np.hypot(*acceleration))
    across = np.array([-acceleration[1], acceleration[0]]) / size
    residual = (position - np.vander(t_s, 3) @ coefficients) @ across
    design = np.vander(t_s, 3)
    variance = residual @ residual / max(len(t_s) - 3, 1)
    return float(np.sqrt(variance * np.linalg.inv(design.T @ design)[0, 0])) / size


def vertical_note(calibration: Calibration) -> str:
    """How the direction of gravity is known, for the notes of a result."""
    source = vertical_text(calibration)
    if calibration.vertical_measured:
        return source
    return f"{source}, by assumption, to {LEVEL_STDERR_DEG:g} degree: a camera levelled by eye (GUM, type B)"


def align_vertical(
    calibration: Calibration,
    body: Track,
    phenomenon: Phenomenon,
    plumb_px: tuple[float, float, float, float] | None,
    vertical: Literal["assumed", "motion"],
) -> Calibration:
    """Turn the world so that z is up, as far as anything says which way that is.

    Parameters
    ----------
    calibration
        Of the plane.
    body
        What moves.
    phenomenon
        How it moves.
    plumb_px
        x1, y1, x2, y2 of a plumb line, px, upper end first.
    vertical
        ``motion`` takes it from the flight, ``assumed`` as the calibration has it.

    Returns
    -------
    Calibration
        Turned, with the part ``vertical`` in its budget; or the same with the part ``assumed vertical``, that of a
        camera levelled by eye, unless the calibration itself was made with a plumb line.

    Raises
    ------
    CalibrationError
        When it is given twice, or not fixed.
    """
    if plumb_px is not None and vertical == "motion":
        raise CalibrationError("the vertical is given twice: by a plumb line and by the motion; choose one")
    if plumb_px is not None:
        return with_plumb_line(calibration, plumb_px[:2], plumb_px[2:], point_stderr_px=MARK_SIGMA_PX)
    if vertical == "motion":
        return with_motion_vertical(calibration, body, phenomenon.motion)
    return with_assumed_vertical(calibration, math.radians(LEVEL_STDERR_DEG))


def gravity_calibration(body: Track, phenomenon: Phenomenon, gravity: Estimate) -> Calibration:
    """The scale at which the body's free motion, a parabola in px, falls with the known gravity in m/s^2.

    A first value only: the fit then frees the model's ``magnification``, which corrects it and carries its error.
    """
    world = segment(to_world(body, uncalibrated()), hand=body.hand, kind=phenomenon.motion)
    used = world.valid & world.mask("motion")
    if used.sum() < 5:
        raise CalibrationError(f"gravity cannot give the scale: only {used.sum()} frames of free motion were found")
    height_px = world.position[used, world.column("z")]
    coefficients, covariance = np.polyfit(world.t_s[used] - world.t_s[used][0], height_px, 2, cov=True)
    acceleration, stderr = -2 * coefficients[0], 2 * np.sqrt(covariance[0, 0])
    if acceleration < 3 * stderr:
        raise CalibrationError(
            f"gravity cannot give the scale: the body accelerates downwards by {acceleration:.3g} +- {stderr:.3g} "
            "px/s^2; is the true frame rate given (--fps), and is down really down in the image?"
        )
    source = f"scale at which the body falls with g = {gravity.value:.6g} m/s^2"
    first = scale(acceleration / gravity.value, 1.0, px_stderr=stderr / gravity.value, source=source)
    return replace(first, budget={})  # the fit's own magnification carries the error
