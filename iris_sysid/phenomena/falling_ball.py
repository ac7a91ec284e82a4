"""A ball that falls away from a camera that looks down on it: its apparent radius until the first bounce.

Radius and time alone do not determine a common factor of gravity, distance and r0 f: r = r0 f / h with h'' = g is
unchanged when all three are multiplied by it. One of them must be known. Gravity is assumed unless h0, the distance
from the camera at the release, is given: then gravity follows from it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from iris_sysid.phenomena._motion import in_motion, only_measured, stated, stated_length
from iris_sysid.types import BenchmarkClass, Estimate, FitResult, Phenomenon, Segment, Trajectory, runs

Index = NDArray[np.int64]

MIN_SAMPLES = 5  # samples of the fall
MIN_SIGMAS = 3.0  # standard errors by which the radius shrinks from sample to sample
LONGER = 1.5  # times the fall in the motion: a longer fall in the release before it is the first one
MAX_GAP = 3.5  # times the usual step: a bounce may hide in a longer one


def observe(world: Sequence[Trajectory], settings: Mapping[str, Estimate]) -> Trajectory:
    """Keep the apparent radius r in px of a segmented trajectory.

    The motion is the fall from the release to the first contact: the run of consecutive decreases with the largest
    total decrease of the radius, without its last sample where the radius grows again. ``h0`` of the ``settings``, the
    distance from the camera at the release, in m, is passed on. Raises DataError when the motion has fewer than five
    samples, or h0 is not a length in m.
    """
    body = only_measured(world, "falling-ball", "r")
    in_motion(body, 5)
    stated_length(settings, ("h0",), "m")
    segments = tuple(part for segment in _with_missed_fall(body) for part in _split(segment, body))
    return body.with_(segments=segments, geometry={**body.geometry, **stated(settings, "h0")}, smoothed=None)


def _with_missed_fall(body: Trajectory) -> list[Segment]:
    """The segments; a release with a longer fall than the motion after it joins that motion: it was no release."""
    segments: list[Segment] = []
    for segment in body.segments:
        if segments and segments[-1].label == "release" and segment.label == "motion":
            both = replace(segment, start=segments[-1].start)
            if _shrinkage(both, body) > LONGER * _shrinkage(segment, body):
                segments[-1] = both
                continue
        segments.append(segment)
    return segments


def _shrinkage(segment: Segment, body: Trajectory) -> float:
    """Decrease of the radius in the longest fall of a segment, px."""
    index, (first, last) = _fall(segment, body)
    return float(body.position[index[first], 0] - body.position[index[last], 0]) if index.size else 0.0


def _fall(segment: Segment, body: Trajectory) -> tuple[Index, tuple[int, int]]:
    """Valid samples of a segment, and the first and last index of the largest decrease; both 0 without one."""
    index = segment.start + np.flatnonzero(body.valid[segment.start : segment.stop])
    if index.size < 2:
        return index, (0, 0)
    t_s, radius, sigma = body.t_s[index], body.position[index, 0], body.sigma[index, 0]
    error = np.hypot(sigma[1:], sigma[:-1])
    shrinks = np.diff(radius) < -MIN_SIGMAS * np.where(np.isfinite(error), error, 0.0)
    shrinks &= np.diff(t_s) < MAX_GAP * np.median(np.diff(t_s))
    return index, max(runs(shrinks), key=lambda run: radius[run[0]] - radius[run[1]], default=(0, 0))


def _split(motion: Segment, body: Trajectory) -> list[Segment]:
    """Split a motion into the fall and the parts before and after it, e.g. a hand or a bounce that was not detected."""
    if motion.label != "motion":
        return [motion]
    index, (first, last) = _fall(motion, body)
    if index.size <= MIN_SAMPLES or first == last:
        return [motion]
    bounced = last < index.size - 1  # the exposure of the last sample may include the bounce
    start, stop = int(index[first]), int(index[last - bounced]) + 1
    if last - bounced - first < MIN_SAMPLES - 1:
        return [motion]
    fall = replace(motion, start=start, stop=stop, reason=f"the radius shrinks from sample to sample; {motion.reason}")
    before = [Segment("release", motion.start, start, "the radius does not shrink yet")] if start > motion.start else []
    after = [Segment("contact", stop, motion.stop, "it no longer shrinks")] if stop < motion.stop else []
    return [*before, fall, *after]


def refine(fit: FitResult, trajectory: Trajectory) -> Mapping[str, Estimate]:
    """Gravity from the given h0: the fitted h0 is proportional to the assumed gravity."""
    known, gravity = trajectory.geometry.get("h0"), fit.estimates["gravity"]
    if known is None or not fit.usable or gravity.measurement_type not in ("assumed", "derived"):
        return {}
    fitted = fit.estimates["h0"]
    value = gravity.value * known.value / fitted.value
    relative = math.hypot(known.stderr / known.value, fitted.stderr / fitted.value)
    return {"gravity": Estimate(value, value * relative, "m/s^2", "derived", f"the fall, from h0 = {known.value:g} m")}


PHENOMENON = Phenomenon(
    name="falling-ball",
    summary="a ball falls away from a camera above it; its apparent radius until the first bounce",
    tracker="disc",
    model="apparent-radius",
    observe=observe,
    motion="flight",
    refine=refine,
    settings=("h0",),
    measures="radius",
    classes=(
        BenchmarkClass("Falling_ball", ("small", "mid", "big"), 10, {"gravity": "g", "h0": "h0"}, dataset="iris"),
        BenchmarkClass(
            "free_fall", ("mousepad", "table", "tennis"), 5, {"gravity": "g", "h0": "h0"}, dataset="delfys75"
        ),
    ),
)
