"""Where frames are missing from a video whose times run on: a body is ahead by their way, on the same course."""

from __future__ import annotations

import numpy as np

from iris_sysid.trajectory import local_polynomials as local
from iris_sysid.types import Array

AROUND = 6  # samples on each side that must lie on one parabola when the frames are given back
MIN_BESIDE = 2  # samples on a side: a single one could be anywhere
MAX_LOST_FRAMES = 3  # frames lost at one moment; in a longer time the body may have done anything
NEAR = 0.25  # of the lost frames, by which the way ahead may differ from theirs: the speed changes meanwhile
CLEAR = 6.0  # noises that the parabola must leave without the frames: as for an impact
BETTER = 10.0  # times less that it must leave with them; on 240 clips without a lost frame it is 2 times at most


def lost_time(t_s: Array, values: Array, scale: Array) -> Array:
    """Time (n,) in s that all frames missing before each sample would have taken.

    Samples are at ``t_s`` (n,), their ``values`` (n, d) scatter by ``scale`` (d,). The body is ahead by the way of
    whole frames, and with these given back one parabola fits what is before and what is after: the same motion goes on.
    At an impact or a release the velocity changes, so that none does.
    """
    missing_s, scaled = np.zeros(t_s.size), values / scale
    for step, lost_s in _ahead(t_s, scaled):
        around = slice(max(step + 1 - AROUND, 0), step + 1 + AROUND)
        near_s, near = t_s[around], scaled[around]
        after = np.arange(t_s.size)[around] > step
        if min(after.sum(), (~after).sum()) < MIN_BESIDE or after.size < AROUND + MIN_BESIDE:
            continue
        without, given_back = _residual_rms(near_s, near), _residual_rms(near_s + lost_s * after, near)
        if without > CLEAR and without > BETTER * given_back:
            missing_s[step + 1 :] += lost_s
    return missing_s


def _ahead(t_s: Array, values: Array) -> list[tuple[int, float]]:
    """Steps that are longer than their neighbours by the distance of whole frames, and the lost time of each in s."""
    if t_s.size < AROUND + MIN_BESIDE:
        return []
    apart_s = np.diff(t_s)
    frame_s = float(np.median(apart_s))
    rate = np.diff(values, axis=0) / apart_s[:, None]
    beside = (rate[:-2] + rate[2:]) / 2  # an even acceleration has this velocity in between
    way = np.sum(beside**2, axis=1) * frame_s
    ahead = np.sum((rate[1:-1] - beside) * beside, axis=1) * apart_s[1:-1]
    frames = np.divide(ahead, way, out=np.zeros_like(ahead), where=way > 0)
    lost = np.rint(frames)
    whole = (lost >= 1) & (lost <= MAX_LOST_FRAMES) & (np.abs(frames - lost) < NEAR * lost)
    return [(int(k) + 1, float(lost[k]) * frame_s) for k in np.flatnonzero(whole)]


def _residual_rms(t_s: Array, values: Array) -> float:
    """Root mean square residual of one parabola, with its degrees of freedom allowed for."""
    every = np.arange(t_s.size)[None]
    residual = local.fit_windows(t_s, values, every, t_s[:1], 2)[2]
    return float(np.sqrt(np.sum(residual**2) / (values.shape[1] * (t_s.size - 3))))
