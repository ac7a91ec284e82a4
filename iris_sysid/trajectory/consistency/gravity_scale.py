"""Clock and scale against gravity: the metre that gravity demands beside the metre that was stated.

A body that swings or falls shows gravity in its own unit of length per second squared. With the stated scale that must
be 9.81 m/s^2. Where it is q times that, the lengths are q times what they should be, or the times 1 / sqrt(q) times.
Where no scale was stated, gravity gives it, and the size of the body tells whether it can be right.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.trajectory.circle import circle_through
from iris_sysid.types import Array, Calibration, Doubt, Estimate, FitResult, Phenomenon, Track, Trajectory

STANDARD_GRAVITY = 9.80665  # m/s^2
OFF = 1.2  # ratio of two lengths that common sense allows beside the stated errors
BOW = 0.01  # bow of a straight line over its length, by a lens or a camera that is not square to the plane
SLOW_MOTION = 3.0  # ratio of two lengths beyond which the clock is more likely wrong than the scale
MAX_M, MIN_M = 0.5, 1e-3  # diameter of a body that people drop, throw or hang on a cord
SIZE_OFF = 2.0  # ratio of a stated radius to the tracked one: a tracker sees an edge, a shadow, part of a body
RATES_HZ = (24, 25, 30, 50, 60, 90, 100, 120, 200, 240, 300, 400, 480, 500, 600, 960, 1000)
NEAR_RATE = 0.08  # natural logarithm
MIN_SAMPLES = 5
ROUGH = 0.15  # relative standard error of a radius that tells no frame rate
MIN_SIGMAS = 3.0  # standard errors by which a fall must differ from none


@dataclass(frozen=True, slots=True)
class GravityMetre:
    """How many metres one unit of the positions is by gravity, its relative standard error, and what shows it."""

    metres: float
    relative_stderr: float
    shown_by: str


def gravity_doubts(
    tracks: Sequence[Track],
    world: Sequence[Trajectory],
    calibration: Calibration,
    phenomenon: Phenomenon,
    fit: FitResult,
    trajectory: Trajectory,
) -> tuple[Doubt, ...]:
    """What gravity says against the clock and the scale, the gravest first; at most one doubt.

    Parameters
    ----------
    tracks
        One per body, in px.
    world
        Its positions, x and z, in m or px.
    calibration
        Pixels to metres.
    phenomenon
        What it was taken for: a swing or a flight.
    fit
        The model fitted, for the period of a swing.
    trajectory
        What was fitted: its ``known`` gravity is taken where it was stated, otherwise that of the Earth.
    """
    known = trajectory.known.get("gravity")
    gravity = STANDARD_GRAVITY if known is None else known.value
    rate_hz = 1.0 / float(np.median(np.diff(trajectory.t_s)))
    for found, body, path in zip(_metres(world, phenomenon, fit, gravity), tracks, world, strict=False):
        if found is None:
            continue
        unit_m = path.quantities[0].unit == "m"
        if unit_m and _beyond(found.metres, OFF, found.relative_stderr):
            return (_doubt(found.metres, rate_hz, found.shown_by, rough=found.relative_stderr > ROUGH),)
        size = _diameter(body, found.metres * (1.0 / calibration.scale.value if unit_m else 1.0))
        stated = trajectory.known.get("ball_radius", trajectory.geometry.get("ball_radius"))
        if stated is not None and size is not None and _beyond(size / (2 * stated.value), SIZE_OFF, 0.0):
            shown = f"by gravity the body is {size:.3g} m across, not {2 * stated.value:.3g} m"
            return (_doubt(size / (2 * stated.value), rate_hz, shown),)
        if size is not None and not MIN_M < size < MAX_M:
            way = "slow motion? the clock seems too slow" if size > MAX_M else "the clock seems too fast"
            finding = f"{way}: by gravity the body is {size:.3g} m across"
            return (Doubt("clock", finding, "give the true frame rate with --fps, or the scale with --scale"),)
    return ()


def _beyond(ratio: float, allowed: float, relative_stderr: float) -> bool:
    return abs(math.log(ratio)) > math.log(allowed) + 2 * relative_stderr


def _doubt(ratio: float, rate_hz: float, shown_by: str, *, rough: bool = False) -> Doubt:
    """The doubt about clock or scale where lengths are by gravity ``ratio`` times what they are stated to be."""
    true_hz = rate_hz * math.sqrt(ratio) if rough else _usual_rate(rate_hz * math.sqrt(ratio))
    factor, about = true_hz / rate_hz, "about " if rough else ""
    clock = f"the clock seems {about}{max(factor, 1 / factor):.2g} times too {'slow' if ratio > 1 else 'fast'}"
    scale = f"lengths are {about}{max(ratio, 1 / ratio):.2g} times too {'small' if ratio > 1 else 'large'}"
    fps = f"the true frame rate with --fps, {about}{true_hz:.2g}" if rough else f"--fps {true_hz:.4g}"
    if max(ratio, 1 / ratio) > SLOW_MOTION:
        question = "slow motion? " if ratio > 1 else ""
        finding, remedy = f"{question}{clock}, or {scale}: {shown_by}", f"give {fps}, or check the scale"
        return Doubt("clock", finding, remedy)
    remedy = f"check the scale (--scale, --square, --plane-view), or give {fps}"
    return Doubt("scale", f"{scale}, or {clock}: {shown_by}", remedy)


def _usual_rate(rate_hz: float) -> float:
    """The frame rate of a camera that is nearest, where one is near."""
    nearest = min(RATES_HZ, key=lambda rate: abs(math.log(rate / rate_hz)))
    return nearest if abs(math.log(nearest / rate_hz)) < NEAR_RATE else rate_hz


def _diameter(body: Track, metres_per_px: float) -> float | None:
    """Diameter of the body, m, from its radius or its area in the image; None where neither was tracked."""
    if body.radius_px is not None and np.isfinite(body.radius_px[body.valid]).any():
        return 2 * float(np.nanmedian(body.radius_px[body.valid])) * metres_per_px
    if body.area_px is not None and np.isfinite(body.area_px[body.valid]).any():
        return 2 * math.sqrt(float(np.nanmedian(body.area_px[body.valid])) / math.pi) * metres_per_px
    return None


# --------------------------------------------------------------------------- the metre that gravity demands


def _metres(
    world: Sequence[Trajectory], phenomenon: Phenomenon, fit: FitResult, gravity: float
) -> Iterator[GravityMetre | None]:
    """For each body, the metres that one unit of its positions is by gravity; None where the motion does not say."""
    if phenomenon.measures != "position":
        return
    for number, body in enumerate(world, start=1):
        if phenomenon.motion == "flight":
            yield _of_a_flight(body, gravity)
        elif phenomenon.motion == "oscillation" or phenomenon.bodies > 1:
            yield _of_a_swing(body, fit, gravity, "length" if phenomenon.bodies == 1 else f"length_{number}")


def _of_a_flight(body: Trajectory, gravity: float) -> GravityMetre | None:
    """From the parabola of the height over time, whose acceleration is uncertain by how much it changes on the way.

    A wrong clock changes the acceleration of a fall, but leaves it constant.
    """
    used = body.valid & body.mask("motion")
    if used.sum() < MIN_SAMPLES:
        return None
    t_s, height = body.t_s[used] - body.t_s[used][0], body.position[used, body.column("z")]
    coefficients, covariance = np.polyfit(t_s, height, 2, cov=True)
    acceleration, random = -2 * float(coefficients[0]), 2 * math.sqrt(float(covariance[0, 0]))
    stderr = math.hypot(random, _change_of_acceleration(t_s, height))
    if not acceleration > MIN_SIGMAS * stderr:
        return None
    unit = body.quantities[0].unit
    shown = f"it falls with {acceleration:.3g} {unit}/s^2, not {gravity:.4g} m/s^2"
    return GravityMetre(gravity / acceleration, stderr / acceleration, shown)


def _change_of_acceleration(t_s: Array, height: Array) -> float:
    """Standard deviation of the acceleration along a flight, from its cubic term; 0 where noise explains that term.

    ``t_s`` (n,) and ``height`` (n,).
    """
    if t_s.size <= MIN_SAMPLES:
        return 0.0
    (jerk, *_), covariance = np.polyfit(t_s, height, 3, cov=True)
    beyond_noise = max(float(jerk) ** 2 - MIN_SIGMAS**2 * float(covariance[0, 0]), 0.0)
    return 6 * math.sqrt(beyond_noise / 12) * float(np.ptp(t_s))  # 12: variance of a uniform distribution


def _of_a_swing(body: Trajectory, fit: FitResult, gravity: float, name: str) -> GravityMetre | None:
    """From the length by the period, over the radius of the arc; where the equation of a pendulum explains the path."""
    length, fitted = fit.estimates.get(name), fit.estimates.get("gravity")
    if not fit.usable or length is None or fitted is None or not length.value > 0:
        return None
    if any(doubt.kind == "little-explained" for doubt in fit.verdict.reasons):
        return None
    used = body.valid & body.mask("motion")
    if used.sum() < MIN_SAMPLES:
        return None
    radius, stderr = circle_radius(body.position[used, :2])
    if not stderr < radius:
        return None
    by_period = length.value * gravity / fitted.value
    unit = body.quantities[0].unit
    shown = f"by its period the pendulum is {by_period:.3g} m long, its arc has a radius of {radius:.3g} {unit}"
    shown += "; for a rod, whose mass lies all along it, both can be right"
    return GravityMetre(by_period / radius, math.hypot(stderr / radius, relative_error(length)), shown)


def relative_error(estimate: Estimate) -> float:
    """Standard error over value; 0 where the error is not known."""
    return estimate.stderr / estimate.value if math.isfinite(estimate.stderr) else 0.0


def circle_radius(position: Array, bow: float = BOW) -> tuple[float, float]:
    """Radius of the circle through positions (n, 2), and its standard error, in their unit; infinite for a line.

    The error is at least that of an arc whose chord c is bowed by the share ``bow`` of it, 8 R / c times that.
    """
    *_, radius, random = circle_through(position, "soft_l1")
    if not math.isfinite(radius):
        return math.inf, math.inf
    chord = min(float(np.max(np.ptp(position, axis=0))), 2 * radius)
    return radius, math.hypot(random, bow * 8 * radius**2 / chord)
