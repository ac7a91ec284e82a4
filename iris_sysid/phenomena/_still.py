"""Detect rest at the start of a motion that sets off smoothly, from the trajectory alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iris_sysid.types import Array, Segment, Trajectory

MIN_SAMPLES = 5  # samples at rest
LATEST = 0.7  # of the motion: rest must end by then
MAX_RATIO = 0.8  # times the squared residual of a single parabola: rest is accepted below it


def without_still_start(body: Trajectory) -> Trajectory:
    """The trajectory with constant samples at the start of its motion labelled as rest.

    Fits a constant up to a sample and a parabola after it, for every sample of the motion; the best of these fits
    is taken where its residual is much smaller than that of one parabola through all samples.
    """
    segments = [_split(segment, body) if segment.label == "motion" else [segment] for segment in body.segments]
    return body.with_(segments=tuple(part for parts in segments for part in parts))


def _split(motion: Segment, body: Trajectory) -> list[Segment]:
    index = motion.start + np.flatnonzero(body.valid[motion.start : motion.stop])
    if index.size < 4 * MIN_SAMPLES:
        return [motion]
    t_s, values = body.t_s[index], body.position[index, 0]
    starts = np.arange(MIN_SAMPLES, int(LATEST * index.size))
    residual = np.array([_constant(values[:k]) + _parabola(t_s[k:], values[k:]) for k in starts])
    best = int(np.argmin(residual))
    if residual[best] > MAX_RATIO * _parabola(t_s, values):
        return [motion]
    start = int(index[starts[best]])
    still = Segment("rest", motion.start, start, f"constant until {body.t_s[start]:.3g} s")
    return [still, replace(motion, start=start, reason=f"it sets off at {body.t_s[start]:.3g} s; {motion.reason}")]


def _constant(values: Array) -> float:
    return float(((values - values.mean()) ** 2).sum())


def _parabola(t_s: Array, values: Array) -> float:
    u = (t_s - t_s[0]) / (t_s[-1] - t_s[0])
    terms = np.vander(u, 3)
    return float(((values - terms @ np.linalg.lstsq(terms, values, rcond=None)[0]) ** 2).sum())
