"""The direction of gravity in a calibrated plane: measured by a plumb line or by the motion, or assumed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from iris_sysid.calibration.plane import STEP, geometry_of, positions_of
from iris_sysid.errors import CalibrationError
from iris_sysid.types import N_VALUES, Array, Calibration, VerticalSource

VERTICAL_TEXTS: Mapping[VerticalSource, str] = MappingProxyType(
    {
        "unstated": "the vertical is as the calibration has it",
        "image": "the vertical is the image's",
        "board-edge": "the vertical is the board's edge",
        "file-axes": "the vertical is that of the file's axes",
        "plumb-line": "the vertical, by a plumb line",
        "flight": "the vertical, by the flight's acceleration",
    }
)


def with_plumb_line(
    calibration: Calibration,
    top_px: tuple[float, float],
    bottom_px: tuple[float, float],
    *,
    point_stderr_px: float = 0.5,
) -> Calibration:
    """Turn the world's axes so that z runs along a plumb line that hangs in the plane of motion.

    Parameters
    ----------
    calibration
        Of the plane.
    top_px, bottom_px
        Two points of the plumb line, px.
    point_stderr_px
        Standard error of each marked coordinate, px.

    Returns
    -------
    Calibration
        Its budget has the part ``vertical``, the angle's error.

    Raises
    ------
    CalibrationError
        When the two points are too close together to give a direction.
    """
    distance_px = math.dist(top_px, bottom_px)
    angle_stderr = math.sqrt(2) * point_stderr_px / distance_px if distance_px else math.inf
    if not angle_stderr < 0.1:
        raise CalibrationError(
            f"the ends of the plumb line, {top_px} and {bottom_px}, are {distance_px:.1f} px apart, which gives its "
            "direction to no better than 6 degrees; mark them further apart"
        )

    def angle_of(values: Array) -> float:
        top, bottom = positions_of(values, np.array([top_px, bottom_px], dtype=np.float64))
        return math.atan2(*(top - bottom))

    return with_vertical(calibration, angle_of, angle_stderr, "plumb-line")


def with_vertical(
    calibration: Calibration, angle_of: Callable[[Array], float], angle_stderr: float, source: VerticalSource
) -> Calibration:
    """Turn the world's axes by a measured angle.

    ``angle_of`` takes the values (18,).

    Parameters
    ----------
    calibration
        Of the plane.
    angle_of
        Angle by which to turn the world anticlockwise, rad, as a function of the 18 numbers of a calibration, so that
        their errors propagate.
    angle_stderr
        Standard error of the angle by its own measurement, rad.
    source
        How the vertical was determined.
    """
    turned = _turned_by(calibration, angle_of)
    spin = _spin(turned.homography)
    return replace(
        turned,
        budget={**turned.budget, "vertical": angle_stderr**2 * np.outer(spin, spin)},
        vertical_source=source,
    )


def with_assumed_vertical(calibration: Calibration, angle_stderr: float) -> Calibration:
    """Add the standard uncertainty of an assumed vertical, rad, to a calibration's budget, as ``assumed vertical``.

    A calibration whose vertical was measured is unchanged.
    """
    if calibration.vertical_measured:
        return calibration
    spin = _spin(calibration.homography)
    part = angle_stderr**2 * np.outer(spin, spin)
    return replace(calibration, budget={**calibration.budget, "assumed vertical": part})


def vertical_stderr(calibration: Calibration, source: str) -> float:
    """Standard error, rad, of the vertical: that part of its budget, ``vertical`` or ``assumed vertical``."""
    spin = _spin(calibration.homography)
    return math.sqrt(float(np.trace(calibration.budget[source])) / float(spin @ spin))


def turned(calibration: Calibration, angle: float) -> Calibration:
    """The ``calibration`` with its world turned anticlockwise by an ``angle``, rad."""
    return _turned_by(calibration, lambda _: angle)


def upright(calibration: Calibration, up: Literal["image", "board"]) -> Calibration:
    """Turn the world so that z is up at ``centre_px``, where the ``calibration`` was made.

    ``up``: ``image`` takes the upward direction of the image there, ``board`` the axis of the world nearest to it.
    """
    quarter = math.pi / 2

    def by_image(values: Array) -> float:
        return float(geometry_of(values, calibration.centre_px)[3])

    nearest = round(by_image(calibration.values) / quarter) * quarter
    turned = _turned_by(calibration, by_image if up == "image" else lambda _: nearest)
    return replace(turned, vertical_source="image" if up == "image" else "board-edge")


def vertical_text(calibration: Calibration) -> str:
    """How the direction of gravity was determined, in words."""
    return VERTICAL_TEXTS[calibration.vertical_source]


def fixed_by_data(calibration: Calibration) -> tuple[str, ...]:
    """Quantities that the data determine, in words, including a measured vertical."""
    return (*calibration.fixed, vertical_text(calibration)) if calibration.vertical_measured else calibration.fixed


def assumptions(calibration: Calibration) -> tuple[str, ...]:
    """The assumptions, in words, including a vertical that was not measured."""
    stated = calibration.vertical_measured or calibration.vertical_source == "unstated"
    return calibration.assumed if stated else (*calibration.assumed, vertical_text(calibration))


def _turned_by(calibration: Calibration, angle_of: Callable[[Array], float]) -> Calibration:
    """Turn the world anticlockwise by an angle computed from the calibration's numbers, with error propagation."""
    values = calibration.values
    angle = angle_of(values)
    cos, sin = math.cos(angle), math.sin(angle)
    homography = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]]) @ calibration.homography
    change = np.eye(N_VALUES)
    change[:9, :9] = np.kron([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]], np.eye(3))
    steps = STEP * np.sqrt(np.maximum(np.diag(calibration.covariance), 0))
    slopes = [
        math.remainder(angle_of(values + step) - angle_of(values - step), 2 * math.pi) / (2 * step.sum())
        if step.any()
        else 0.0
        for step in np.diag(steps)
    ]
    change += np.outer(_spin(homography), slopes)
    return replace(
        calibration,
        homography=homography,
        budget={name: change @ part @ change.T for name, part in calibration.budget.items()},
    )


def _spin(homography: Array) -> Array:
    """Change (18,) of a calibration's numbers for each radian that its world turns anticlockwise."""
    out = np.zeros(N_VALUES)
    out[:3], out[3:6] = -homography[1], homography[0]
    return out
