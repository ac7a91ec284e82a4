"""A start at which nothing changes yet, before a course that sets off without a jerk: found by the course itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iris_sysid.types import Array, Segment, Trajectory

FEWEST = 5  # samples of the still part
LATEST = 0.7  # of the motion: the still part must end by then
CLEARLY = 0.8  # of the squared residual at most is left when the still part is told apart


def without_still_start(body: Trajectory) -> Trajectory:
    """The trajectory with what is still constant at the start of its motion labelled as rest.

    A constant up to a sample and a parabola from there on are fitted to the motion, for every sample; the best of
    them is taken where it leaves much less than a parabola through all.
    """
    segments = [_parted(segment, body) if segment.label == "motion" else [segment] for segment in body.segments]
    return body.with_(segments=tuple(part for parts in segments for part in parts))


def _parted(motion: Segment, body: Trajectory) -> list[Segment]:
    index = motion.start + np.flatnonzero(body.valid[motion.start : motion.stop])
    if index.size < 4 * FEWEST:
        return [motion]
    t_s, values = body.t_s[index], body.position[index, 0]
    starts = np.arange(FEWEST, int(LATEST * index.size))
    left = np.array([_constant(values[:k]) + _parabola(t_s[k:], values[k:]) for k in starts])
    best = int(np.argmin(left))
    if left[best] > CLEARLY * _parabola(t_s, values):
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
