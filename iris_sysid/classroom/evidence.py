"""What a motion itself shows of its clock, its scale and its vertical: the numbers by which groups are compared."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from iris_sysid.calibration.pixel_scale import to_world
from iris_sysid.errors import IrisError
from iris_sysid.trajectory.consistency.gravity_scale import circle_radius, relative_error
from iris_sysid.types import Array, Calibration, Estimate, FitResult, Mask, Phenomenon, Track, Trajectory

PERIOD, ARC, TILT = "period", "arc", "tilt"
ACCELERATION, HEIGHT, FALL_TIME = "acceleration", "fall_height", "fall_time"
DIAMETER, STEP, AMPLITUDE, CAPTURE = "diameter", "time_step", "amplitude", "capture_rate"
MIN_SAMPLES = 5  # samples of a motion
BOW = 0.002  # bow of an arc's chord by a lens: what is more of it, the scatter of the class shows


def evidence_of(
    phenomenon: Phenomenon,
    world: Trajectory | None,
    trajectory: Trajectory,
    fit: FitResult,
    diameter: Estimate | None = None,
) -> dict[str, Estimate]:
    """What one motion shows, by name; what it does not show is left out.

    Parameters
    ----------
    phenomenon
        What it was taken for: a swing, a flight.
    world
        x and z in m or px, segmented; None where only the observed quantity was measured.
    trajectory
        What was fitted.
    fit
        The model fitted to it.
    diameter
        Of the body, as it was tracked.

    Returns
    -------
    dict
        ``period`` (s) of small swings and ``arc``, the radius of the path; ``acceleration``, ``fall_height`` and
        ``fall_time`` of a flight; ``tilt`` (rad) of the motion's vertical against the one that was taken;
        ``amplitude`` of an angle (rad), ``diameter``, and ``time_step`` (s) between samples.
    """
    found: dict[str, Estimate] = {STEP: _shown(float(np.median(np.diff(trajectory.t_s))), 0.0, "s")}
    if diameter is not None:
        found[DIAMETER] = diameter
    if phenomenon.motion == "oscillation":
        found |= _of_a_swing(world, trajectory, fit)
    elif phenomenon.free_flight:
        found |= _of_a_flight(world, trajectory)
    return {name: value for name, value in found.items() if math.isfinite(value.value) and math.isfinite(value.stderr)}


def diameter_of(track: Track, calibration: Calibration) -> Estimate | None:
    """Diameter of a tracked body, m or px; None where neither its radius nor its area was tracked."""
    sizes = _diameters_px(track)
    if sizes is None or not (known := np.isfinite(sizes) & track.valid).any():
        return None
    try:
        scale = _per_px(track, calibration)
    except IrisError:
        return None
    values = sizes[known]
    scatter = 1.4826 * float(np.median(np.abs(values - np.median(values)))) / math.sqrt(values.size)
    return _shown(float(np.median(values)) * scale, scatter * scale, calibration.unit)


def _diameters_px(track: Track) -> Array | None:
    if track.radius_px is not None:
        return 2 * track.radius_px
    return None if track.area_px is None else 2 * np.sqrt(track.area_px / math.pi)


def _per_px(track: Track, calibration: Calibration) -> float:
    """Units of the world in one px, where the body moves."""
    middle = np.nanmedian(track.xy_px[track.valid], axis=0)
    corners = Track(
        t_s=np.arange(3.0),
        xy_px=middle + np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]),
        sigma_px=np.full((3, 2), 0.1),
        valid=np.ones(3, dtype=np.bool_),
        frame=np.arange(3),
    )
    steps = np.diff(to_world(corners, calibration).position[:, :2][[1, 0, 2]], axis=0)
    return float(np.mean(np.hypot(*steps.T)))


def _of_a_swing(world: Trajectory | None, trajectory: Trajectory, fit: FitResult) -> dict[str, Estimate]:
    found = _by_the_fit(fit.estimates) if fit.usable else {}
    names = [quantity.name for quantity in trajectory.quantities if quantity.unit == "rad"]
    if names:
        angles = trajectory.position[trajectory.valid, trajectory.column(names[0])]
        if angles.size:
            low, high = np.percentile(angles, (1, 99))
            found[AMPLITUDE] = _shown(float(high - low) / 2, 0.0, "rad")
    if world is not None and (used := _in_motion(world)).sum() >= MIN_SAMPLES:
        radius, stderr = circle_radius(world.position[used, :2], BOW)
        if stderr < radius:
            found[ARC] = _shown(radius, stderr, world.quantities[0].unit)
    return found


def _by_the_fit(estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """The period of small swings, and the direction in which the pendulum rests."""
    found = {}
    length, gravity, rest = (estimates.get(name) for name in ("length", "gravity", "vertical"))
    if length is not None and gravity is not None and length.value > 0 and gravity.value > 0:
        period = 2 * math.pi * math.sqrt(length.value / gravity.value)
        found[PERIOD] = _shown(period, period / 2 * relative_error(length), "s")
    if rest is not None and rest.measurement_type == "fitted":
        found[TILT] = _shown(rest.value, rest.stderr, "rad")
    return found


def _of_a_flight(world: Trajectory | None, trajectory: Trajectory) -> dict[str, Estimate]:
    body = trajectory if world is None else world
    names = [quantity.name for quantity in body.quantities]
    used = _in_motion(body)
    if "z" not in names or used.sum() < MIN_SAMPLES:
        return {}
    t_s, height = body.t_s[used] - body.t_s[used][0], body.position[used, names.index("z")]
    unit = body.quantities[names.index("z")].unit
    down, down_stderr = _acceleration(t_s, height)
    found = {
        HEIGHT: _shown(float(np.ptp(height)), 0.0, unit),
        FALL_TIME: _shown(float(t_s[-1]), 0.0, "s"),
    }
    across, across_stderr = (0.0, 0.0)
    if "x" in names:
        across, across_stderr = _acceleration(t_s, body.position[used, names.index("x")])
    size = math.hypot(down, across)
    if size > 0:
        found[ACCELERATION] = _shown(size, down_stderr, f"{unit}/s^2")
    if size > 0 and "x" in names:
        found[TILT] = _shown(math.atan2(-across, -down), math.hypot(across_stderr, down_stderr) / size, "rad")
    return found


def _acceleration(t_s: Array, values: Array) -> tuple[float, float]:
    """Second derivative of a parabola through values (n,), with its standard error."""
    coefficients, covariance = np.polyfit(t_s, values, 2, cov=True)
    return 2 * float(coefficients[0]), 2 * math.sqrt(max(float(covariance[0, 0]), 0.0))


def _in_motion(body: Trajectory) -> Mask:
    return body.valid & body.mask("motion")


def _shown(value: float, stderr: float, unit: str) -> Estimate:
    return Estimate(value, stderr, unit, "derived")
