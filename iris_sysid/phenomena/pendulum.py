"""A bob on a cord: the angle about a pivot that follows from the arc, inside the image or outside it.

Effect of a wrong pivot: with a radius wrong by a fraction e, angles are wrong by -e and nothing else. The frequency,
and so the length in theta'' = -(g/L) sin theta, is not affected at small angles; through the amplitude's part of the
period, theta_0²/16 (Baker and Blackburn 2005, eq. 3.21), L is wrong by about -e theta_0²/4: 0.4 % at 15 degrees for
e = 0.25. The pivot's standard errors are in ``geometry`` so that this can be propagated:
d theta / d pivot_x = -cos(theta) / arc_radius, d theta / d pivot_z = -sin(theta) / arc_radius.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.phenomena._geometry import Circle, angles_about, circle_about, circle_of, noise_of
from iris_sysid.phenomena._motion import in_motion, only_body, stated, stated_length
from iris_sysid.types import Array, BenchmarkClass, Estimate, FitResult, Mask, Phenomenon, Quantity, Segment, Trajectory

TAUT = 3  # consecutive samples on the arc after which the cord counts as taut
RADIUS = ("arc_radius", "length")  # settings that give the arc's radius, in order of preference
CONTRADICTED, ALIKE = 3.0, 0.2  # standard errors and share of the arc's radius by which a length may differ from it
BOB = 0.1  # radius over length of a bob whose size is not stated: of a phone, a bottle or a ball at home
FASTEST = 0.95  # quantile of the rates that stands for the largest one: a single rate may be an error


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Find the pivot from the arc and turn positions into angles from the downward vertical, positive to the right.

    ``world`` holds one segmented trajectory of x and z in m or px. Of the ``settings``, ``pivot_x`` and ``pivot_z``
    (z up; or ``pivot_y``, the same) in its unit override the arc's; ``arc_radius`` or ``length`` in that unit fixes its
    radius only; ``ball_radius`` is passed on.

    Gives ``theta`` in rad; ``sigma`` is the error across the cord only, without the pivot's error, which all samples
    share. ``geometry``: ``pivot_x``, ``pivot_z``, ``arc_radius``, and ``arc_scatter``, the standard deviation of the
    distances from the arc. Samples off the arc by more than five of it are not valid; where the motion begins with them
    the cord is slack, and they are labelled release. Raises DataError when the motion has fewer than five samples, or
    its arc is too small for its noise to fix a pivot.
    """
    body = only_body(world, "pendulum")
    used = in_motion(body, 5)
    circle = _circle(body, used, settings)
    belongs = np.ones(body.n, dtype=np.bool_)
    belongs[used] = circle.belongs
    off = np.zeros(body.n)
    off[used] = circle.off
    theta, sigma = angles_about(circle, body)
    return body.with_(
        quantities=(Quantity("theta", "rad", r"\theta"),),
        position=theta[:, None],
        sigma=sigma[:, None],
        valid=body.valid & belongs,
        segments=_without_slack(body, used, belongs, off),
        geometry={**body.geometry, **_geometry(circle, body, theta, settings)},
        smoothed=None,
    )


def _circle(body: Trajectory, used: Mask, settings: Mapping[str, Estimate]) -> Circle:
    height = settings.get("pivot_z", settings.get("pivot_y"))
    if ("pivot_x" in settings) != (height is not None):
        raise DataError("a pivot needs both pivot_x and pivot_z")
    if height is not None:
        return circle_about(settings["pivot_x"], height, body.position[used, :2], noise_of(body, used))
    return circle_of(body, used, _stated_radius(settings, body.quantities[0].unit))


def _stated_radius(settings: Mapping[str, Estimate], unit: str) -> Estimate | None:
    """The arc's radius if the user gave it; a length in m is not used for an arc in px."""
    usable = [
        name for name in RADIUS if name == "arc_radius" or (name in settings and settings[name].unit in (unit, ""))
    ]
    return stated_length(settings, usable, unit)


def _geometry(circle: Circle, body: Trajectory, theta: Array, settings: Mapping[str, Estimate]) -> dict[str, Estimate]:
    given, unit = "pivot_x" in settings, body.quantities[0].unit
    kind, source = ("direct", "given") if given else ("fitted", "circle through the arc of the motion")
    radius = None if given else _stated_radius(settings, unit)
    geometry = {
        "pivot_x": Estimate(circle.x, float(circle.stderr[0]), unit, kind, source),
        "pivot_z": Estimate(circle.z, float(circle.stderr[1]), unit, kind, source),
        "arc_radius": radius
        or Estimate(circle.radius, float(circle.stderr[2]), unit, "fitted", "distance of the body from the pivot"),
        "arc_scatter": Estimate(
            circle.scatter, circle.scatter / math.sqrt(2 * circle.off.size), unit, "fitted", "distances from the arc"
        ),
    }
    share = "pivot's error over the arc's radius"
    across, along = (float(error) / circle.radius for error in circle.stderr[:2])
    geometry["pivot_across"] = Estimate(0.0, across, "1", "assumed", share)
    along = math.hypot(along, _exposure_share(body.t_s, theta))
    geometry["pivot_along"] = Estimate(0.0, along, "1", "assumed", f"{share}; the mean over an exposure")
    return {**geometry, **stated(settings, "ball_radius")}


def _exposure_share(t_s: Array, theta: Array) -> float:
    """By what share angles may look too small, as a position is the mean over an exposure of unknown length T.

    The mean is off by T²/24 of the acceleration: nearer to the pivot where the bob is fast, which moves the centre of
    the arc up by g T²/12, and nearer to the middle where it turns, by g T²/24. T is at most the time between frames;
    evenly distributed below that, T² is 1/sqrt(5) of its square (root mean square).
    """
    seen = np.flatnonzero(np.isfinite(theta))
    rate = np.abs(np.gradient(theta[seen], t_s[seen]))
    frequency = float(np.quantile(rate, FASTEST)) / (2.0 * math.sin(float(np.max(np.abs(theta[seen]))) / 2.0))
    frame_s = float(np.median(np.diff(t_s[seen])))
    return (frequency * frame_s) ** 2 * (1.0 / 12.0 + 1.0 / 24.0) / math.sqrt(5.0)


def _without_slack(body: Trajectory, used: Mask, belongs: Mask, off: Array) -> tuple[Segment, ...]:
    """The segments; each motion begins where the cord is taut, and its reason lists the rejected samples."""
    segments = []
    for segment in body.segments or (Segment("motion", 0, body.n, "the whole clip"),):
        if segment.label != "motion":
            segments.append(segment)
            continue
        inside = np.flatnonzero(used[segment.start : segment.stop]) + segment.start
        taut = _taut_from(belongs[inside])
        start = segment.start if taut == 0 else int(inside[taut])
        if start > segment.start:
            worst = off[inside[:taut]][np.argmax(np.abs(off[inside[:taut]]))]
            where = "inside" if worst < 0 else "outside"
            text = f"off the arc, up to {abs(worst):.3g} {body.quantities[0].unit} {where} it: the cord is not taut"
            segments.append(Segment("release", segment.start, start, text))
        segments.append(replace(segment, start=start, reason=_reason(body, segment, inside[taut:], belongs, off)))
    return tuple(segments)


def _taut_from(on_arc: Mask) -> int:
    """Index of the first of three consecutive samples on the arc; 0 where the first sample is on it, or none are."""
    if on_arc[0] or on_arc.size < TAUT:
        return 0
    taut = np.lib.stride_tricks.sliding_window_view(on_arc, TAUT).all(axis=1)
    return int(np.argmax(taut))


def _reason(body: Trajectory, motion: Segment, inside: NDArray[np.intp], belongs: Mask, off: Array) -> str:
    left_out = inside[~belongs[inside]]
    if not left_out.size:
        return motion.reason
    times = ", ".join(f"{body.t_s[k]:.3g}" for k in left_out[:5]) + (", ..." if left_out.size > 5 else "")
    worst, unit = float(np.max(np.abs(off[left_out]))), body.quantities[0].unit
    return f"{motion.reason}; {left_out.size} left out, off the arc by up to {worst:.3g} {unit}, at {times} s"


def refine(fit: FitResult, trajectory: Trajectory) -> Mapping[str, Estimate]:
    """Take the arc's radius from the period where that is more precise than the arc, and the unit is m.

    On a short arc the radius is poorly known, but a bob on a taut cord moves at its pendulum's length from the
    pivot, but for its own inertia: (2/5) (ball radius / length)^2, which is in the error. A length that the arc
    contradicts is that of a wrong scale or clock, and not taken.
    """
    radius, length = trajectory.geometry["arc_radius"], fit.estimates["length"]
    known = radius.measurement_type == "direct" or radius.unit != "m" or not fit.usable
    if known or not length.value > 0:
        return {}
    ball = trajectory.geometry.get("ball_radius")
    inertia_m = 0.4 * (BOB * length.value if ball is None else ball.value) ** 2 / length.value
    stderr = math.hypot(length.stderr, inertia_m)
    if not stderr / length.value < radius.stderr / radius.value:
        return {}
    if abs(length.value - radius.value) > CONTRADICTED * radius.stderr + ALIKE * radius.value:
        return {}
    return {"arc_radius": Estimate(length.value, stderr, "m", "derived", "the period, for a bob on a taut cord")}


PHENOMENON = Phenomenon(
    name="pendulum",
    summary="a bob swings on a cord; its angle about the pivot that its arc shows",
    tracker="auto",
    model="pendulum",
    observe=observe,
    motion="oscillation",
    settings=("pivot_x", "pivot_z", "pivot_y", "arc_radius"),
    free=("vertical",),
    refine=refine,
    classes=(
        BenchmarkClass(
            "Pendulum",
            ("pendulum_20", "pendulum_45", "pendulum_90"),
            10,
            {"length": "rope_length", "damping": "damping"},
            dataset="iris",
        ),
        BenchmarkClass(
            "pendulum",
            ("pendulum_45", "pendulum_90", "pendulum_150"),
            5,
            {"length": "length", "damping": "damping"},
            dataset="delfys75",
        ),
    ),
)
