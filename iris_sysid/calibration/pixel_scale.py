"""Pixels per metre, and the one function by which pixels become metres and y down becomes z up.

A calibration is a homography from the image to the plane of motion. A plain scale, a scale bar and the axes of an
Open Source Physics Tracker file are homographies too, so :func:`to_world` knows one case only.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from iris_sysid.calibration.plane import common_errors, to_plane
from iris_sysid.errors import CalibrationError, DataError
from iris_sysid.types import N_VALUES, Array, Calibration, Estimate, Quantity, Track, Trajectory
from iris_sysid.units import SCALE_EXAMPLE, parse_scale, parse_scale_bar

STRAIGHT_ON = "the camera looks straight at the plane of motion"
NO_LENS = "the lens does not distort"

MARK_SIGMA_PX = 1.0  # how well a person points at something
# standard deviation, on synthetic clips, of the autocorrelation of position errors about that of the outline's errors
AUTOCORRELATION_ERROR = 0.1
COMMON_PREFIX = "calibration: "  # of the parts of a calibration among the sources of error of a trajectory or a fit


class TrackerAxes(Protocol):
    """What an Open Source Physics Tracker file says about its axes.

    ``origin_px`` is in our pixels (y down, origin at the centre of pixel (0, 0)); ``angle_rad`` turns the x axis
    anticlockwise as seen, from right.
    """

    @property
    def scale_px_per_m(self) -> float:
        """Pixels a metre."""

    @property
    def angle_rad(self) -> float:
        """Angle of the x axis."""

    @property
    def origin_px(self) -> tuple[float, float]:
        """Origin of the axes."""


# --------------------------------------------------------------------------- making one


def scale(
    px: float, metres: float, *, px_stderr: float = 0.0, metres_stderr: float = 0.0, source: str = "stated scale"
) -> Calibration:
    """Calibrate by a plain scale: ``px`` pixels in the image are ``metres`` in the plane of motion.

    The relative standard error is ``sqrt((px_stderr/px)^2 + (metres_stderr/metres)^2)`` (GUM, 5.1.6).

    Parameters
    ----------
    px
        Length in the image, px.
    metres
        The same length, m.
    px_stderr, metres_stderr
        Their standard errors; 0 where none is stated, and the scale is then ``assumed``.
    source
        Where the scale comes from, in words.

    Returns
    -------
    Calibration
        x right, z up, origin at the centre of pixel (0, 0).

    Raises
    ------
    CalibrationError
        When a length is not positive and finite, or not larger than its standard error.

    Examples
    --------
    >>> from iris_sysid import scale
    >>> scale(640.0, 1.0, px_stderr=1.0).unit
    'm'
    """
    for name, length, stderr, unit in (("px", px, px_stderr, "px"), ("metres", metres, metres_stderr, "m")):
        _check_length(name, length, stderr, unit)
    px_per_m = px / metres
    relative = {"length in px": px_stderr / px, "length in m": metres_stderr / metres}
    stderr = px_per_m * math.hypot(*relative.values())
    _check_length("px per m", px_per_m, stderr, "px/m")
    kind = "direct" if stderr > 0 else "assumed"
    return Calibration(
        homography=_turned_homography(px_per_m),
        scale=Estimate(px_per_m, stderr, "px/m", kind, source),
        source=source,
        budget={name: scale_part(_turned_homography(px_per_m), part) for name, part in relative.items() if part},
        fixed=("scale",),
        assumed=(STRAIGHT_ON, NO_LENS),
        vertical_source="image",
    )


def scale_part(homography: Array, relative_stderr: float) -> Array:
    """The part (18, 18) of a calibration's covariance that is a ``relative_stderr`` of all lengths.

    In the squared units of the calibration's values.

    ``homography`` (3, 3) is what it maps with.
    """
    growth = np.zeros(N_VALUES)
    growth[:6] = homography[:2].ravel()
    return relative_stderr**2 * np.outer(growth, growth)


def _check_length(name: str, length: float, stderr: float, unit: str) -> None:
    if not (math.isfinite(length) and length > 0):
        raise CalibrationError(
            f"a scale needs a length above zero: {name} = {length:g} {unit}; write it as {SCALE_EXAMPLE}"
        )
    if not (math.isfinite(stderr) and 0 <= stderr < length):
        raise CalibrationError(
            f"the standard error of {name} must be at least zero and below the length: {length:g} +- {stderr:g} {unit}"
        )


def scale_bar(
    point_1: tuple[float, float],
    point_2: tuple[float, float],
    length_m: float,
    *,
    point_stderr_px: float = 0.5,
    length_stderr_m: float = 0.0,
) -> Calibration:
    """Calibrate by two marked points a known length apart in the plane of motion.

    The distance in px has the standard error ``sqrt(2) point_stderr_px``: each point's error along the bar counts once.

    Parameters
    ----------
    point_1, point_2
        (x, y) of the ends, px.
    length_m
        True length between them, m.
    point_stderr_px
        Standard error of each marked coordinate, px.
    length_stderr_m
        Standard error of the true length, m.

    Returns
    -------
    Calibration
        As :func:`scale`.

    Raises
    ------
    CalibrationError
        When the points are too close together, or the length is not positive and finite.
    """
    distance_px = math.dist(point_1, point_2)
    stderr_px = math.sqrt(2) * point_stderr_px
    if not distance_px > stderr_px:
        raise CalibrationError(
            f"the two ends of the scale bar, {point_1} and {point_2}, are {distance_px:g} px apart, "
            f"known to {stderr_px:.2g} px; mark two points far apart"
        )
    return scale(
        distance_px,
        length_m,
        px_stderr=stderr_px,
        metres_stderr=length_stderr_m,
        source=f"scale bar of {length_m:g} m, {distance_px:.1f} px long",
    )


def scale_from_text(text: str) -> Calibration:
    """Read ``640px=1m``: pixels on one side, m, cm or mm on the other, each with its standard error when known.

    ``398.7(5)px`` is 398.7 with 0.5 in its last digit; ``640+-3px`` and ``640±3px`` are the same in full. Raises
    CalibrationError with an example of what is right.

    Examples
    --------
    >>> from iris_sysid import scale_from_text
    >>> scale_from_text("640px=1m").unit
    'm'
    """
    try:
        px, metres = parse_scale(text)
    except DataError as error:
        raise CalibrationError(str(error)) from error
    source = f"stated: {text.strip()}"
    return scale(px.value, metres.value, px_stderr=px.stderr, metres_stderr=metres.stderr, source=source)


def scale_bar_from_text(text: str) -> Calibration:
    """Read ``x1,y1,x2,y2=0.84m``: the ends of a scale bar in px, and its length in m, cm or mm, e.g. ``84.0(5)cm``.

    Raises CalibrationError with an example of what is right.
    """
    try:
        point_1, point_2, length = parse_scale_bar(text)
    except DataError as error:
        raise CalibrationError(str(error)) from error
    return scale_bar(point_1, point_2, length.value, length_stderr_m=length.stderr)


def from_osp(project: TrackerAxes) -> Calibration:
    """Take scale, origin and direction of the axes from an Open Source Physics Tracker file (read by ``read_osp``).

    The file does not say how well its scale is known: the standard error is 0 and the scale ``assumed``.
    """
    px_per_m, angle_rad = float(project.scale_px_per_m), float(project.angle_rad)
    if not (math.isfinite(px_per_m) and px_per_m > 0):
        raise CalibrationError(
            f"the Tracker file fixes no length (its scale is {px_per_m:g} px/m): put a calibration stick or tape on it "
            "in Tracker, or give --scale instead"
        )
    source = "axes of an Open Source Physics Tracker file"
    if angle_rad:
        source += f", turned by {math.degrees(angle_rad):.3g} degrees"
    homography = _turned_homography(px_per_m, angle_rad, project.origin_px)
    estimate = Estimate(px_per_m, 0.0, "px/m", "assumed", source)
    return Calibration(
        homography,
        estimate,
        "m",
        source,
        fixed=("scale",),
        assumed=(STRAIGHT_ON, NO_LENS),
        vertical_source="file-axes",
    )


def uncalibrated() -> Calibration:
    """No scale is known: the world is in px, z up. Angles and times are right all the same."""
    source = "no scale was given: lengths are in px"
    estimate = Estimate(1.0, 0.0, "px/px", "assumed", source)
    assumed = (STRAIGHT_ON, NO_LENS)
    return Calibration(_turned_homography(1.0), estimate, "px", source, assumed=assumed, vertical_source="image")


def _turned_homography(
    px_per_unit: float, angle_rad: float = 0.0, origin_px: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """Similarity from px (y down) to the world (z up) whose x axis is turned anticlockwise as seen."""
    cos, sin = math.cos(angle_rad) / px_per_unit, math.sin(angle_rad) / px_per_unit
    linear = np.array([[cos, -sin], [-sin, -cos]])
    homography = np.eye(3)
    homography[:2, :2] = linear
    homography[:2, 2] = 0.0 - linear @ np.asarray(origin_px, dtype=np.float64)  # 0.0 -: no negative zero
    return homography


# --------------------------------------------------------------------------- using one


def to_world(track: Track, calibration: Calibration, *, body: int | None = None) -> Trajectory:
    """Map a track from pixels, y down, to the plane of motion, z up.

    Pixels are undistorted and then mapped: with ``(u, v, w) = H (x, y, 1)``, ``x = u/w`` and ``z = v/w`` (Hartley and
    Zisserman 2004, eq. 2.5). Standard errors of the samples go through the Jacobian of this map (eq. 5.10); what x
    and z then have in common is left out. The calibration's own errors (scale, tilt, lens, offset) are common to all
    samples: they are not in ``sigma`` but, by source, in ``systematic``.

    Parameters
    ----------
    track
        One body, px and s.
    calibration
        Pixels to metres, or to px with z up where no scale is known.
    body
        Number to put behind the names, ``x1`` and ``z1``; ``x`` and ``z`` when not given.

    Returns
    -------
    Trajectory
        Quantities x and z in ``calibration.unit``; gaps are NaN and not valid; ``systematic`` holds the calibration's
        errors as ``calibration: corners`` and so on; ``origin`` names the body and the calibration; ``first_frame`` is
        None where frames were left out.

    Raises
    ------
    CalibrationError
        When the homography has no inverse, or a sample lies beyond the lens model or the horizon of the plane.
    """
    check_homography(calibration.homography)
    xy_px = np.where(track.valid[:, None], track.xy_px, np.nan)
    position, by_px, by_calibration = to_plane(calibration, xy_px)
    sigma_px = np.broadcast_to(track.sigma_px[:, None, :], by_px.shape)
    # where= : a coordinate that does not matter adds nothing, even if its error is not known
    parts = np.multiply(by_px, sigma_px, out=np.zeros_like(by_px), where=by_px != 0)
    ending = "" if body is None else str(body)
    quantities = tuple(
        Quantity(f"{name}{ending}", calibration.unit, f"{name}_{{{ending}}}" if ending else name) for name in "xz"
    )
    changes = common_errors(calibration, xy_px) if track.n_valid else {}
    known = track.error_autocorrelation
    return Trajectory(
        t_s=track.t_s,
        quantities=quantities,
        position=position,
        sigma=np.sqrt(np.square(parts).sum(axis=2)),
        valid=track.valid,
        geometry={"scale": calibration.scale} if calibration.unit == "m" else {},
        origin={**track.origin, "body": track.body, "calibration": calibration.source},
        systematic={
            common_source(name): np.moveaxis(by_calibration @ change.T, 2, 0) for name, change in changes.items()
        },
        error_autocorrelation=known and known.with_model_error(AUTOCORRELATION_ERROR),
        first_frame=int(track.frame[0]) if np.all(np.diff(track.frame) == 1) else None,
        sensor="camera",
        doubts=track.quality.doubts if track.quality else (),
    )


def common_source(name: str) -> str:
    """What the part ``name`` of a calibration's budget is called among the errors of a trajectory or a fit."""
    return f"{COMMON_PREFIX}{name}"


def is_common_source(source: str) -> bool:
    """Whether a ``source`` of error of a trajectory or a fit is a part of a calibration's budget."""
    return source.startswith(COMMON_PREFIX)


def check_homography(homography: Array) -> None:
    """CalibrationError when a ``homography`` (3, 3) has no inverse. It takes px to m."""
    # 1e-12: a homography of rank 2 has a condition number of 1e16, one of a tilted camera below 1e9
    if not np.all(np.isfinite(homography)) or 1 / np.linalg.cond(homography) < 1e-12:
        raise CalibrationError("the calibration's homography has no inverse, so it maps the image on a line; redo it")
