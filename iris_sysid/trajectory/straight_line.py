"""The part of a motion that runs along a straight line, in one sense, without being set down or falling off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from iris_sysid.trajectory import local_polynomials as local
from iris_sysid.types import Array, Mask

OFF_LINE = 5.0  # scatters about the line: a good sample is that far off once in two million
BACKWARDS = 3.0  # standard errors by which a step may go back (0.1 % of the steps of a body at rest do)


@dataclass(frozen=True, slots=True)
class StraightPart:
    """Samples ``start`` to ``stop - 1``, and why it begins and ends there."""

    start: int
    stop: int
    begin: str
    end: str


def straight_part(t_s: Array, position: Array, scale: Array) -> StraightPart:
    """The longest stretch on one straight line, monotone, from where it is slowest if it speeds up.

    Positions (n, 2) at times (n,) s scatter by ``scale`` (2,).
    """
    origin, direction = _robust_line(position, scale)
    across = (position - origin) @ np.array([-direction[1], direction[0]])
    tolerance = OFF_LINE * max(local.NORMAL_MAD * float(np.median(np.abs(across))), float(np.abs(scale).min()))
    along = (position - origin) @ direction
    along *= np.sign(along[-1] - along[0]) or 1.0
    on_line = np.abs(across) < tolerance
    backwards = np.diff(along) < -BACKWARDS * np.sqrt(2) * float(np.hypot(*(direction * scale)))
    start, stop = _longest_run(_bridged(on_line), backwards)
    slowest = start + _slowest(t_s[start:stop], along[start:stop])
    begin = "it is slowest, having been set down before," if slowest > start else "it comes onto the straight line"
    return StraightPart(slowest, stop, begin, "it leaves the straight line" if stop < len(t_s) else "the last sample")


def _robust_line(position: Array, scale: Array) -> tuple[Array, Array]:
    """A point on the line and its direction: median direction of chords, then total least squares of inliers.

    The median (Theil 1950, Sen 1968) tolerates a quarter of the points off the line.
    """
    half = len(position) // 2
    chord = position[half:] - position[: len(position) - half]
    doubled = np.angle((chord[:, 0] + 1j * chord[:, 1]) ** 2)
    middle = np.angle(np.exp(1j * doubled).mean())
    angle = (middle + np.median(np.angle(np.exp(1j * (doubled - middle))))) / 2
    direction = np.array([np.cos(angle), np.sin(angle)])
    origin = position[0]
    for _ in range(10):
        across = (position - origin) @ np.array([-direction[1], direction[0]])
        across -= np.median(across)
        tolerance = OFF_LINE * max(local.NORMAL_MAD * float(np.median(np.abs(across))), float(np.abs(scale).min()))
        near = position[np.abs(across) < tolerance]
        origin = near.mean(axis=0)
        direction = np.linalg.svd(near - origin, full_matrices=False)[2][0]
    return origin, direction


def _bridged(mask: Mask) -> Mask:
    """The mask with single false samples between true ones made true."""
    bridged = mask.copy()
    bridged[1:-1] |= mask[:-2] & mask[2:]
    return bridged


def _longest_run(on_line: Mask, backwards: Mask) -> tuple[int, int]:
    """(start, stop) of the longest run on the line without a step backwards."""
    best, start = (0, len(on_line)), None
    longest = 0
    for k, good in enumerate(on_line):
        if not good or (k > 0 and backwards[k - 1]):
            start = None
        if good:
            start = k if start is None else start
            if k + 1 - start > longest:
                longest, best = k + 1 - start, (start, k + 1)
    return best


def _slowest(t_s: Array, along: Array) -> int:
    """Number of the sample from which a body that speeds up overall no longer slows; 0 where it never did."""
    if t_s.size < 8:
        return 0
    speed, gain = local.velocity(t_s, along[:, None], 3)
    scatter = gain * float(local.noise(t_s, along[:, None])[0])
    rate = speed[:, 0]
    if rate[-1] < rate[0]:
        return 0
    first_half = rate[: t_s.size // 2]
    slowest = int(np.argmin(first_half))
    before = rate[:slowest] - rate[slowest] > 3 * np.hypot(scatter[:slowest], scatter[slowest])
    return slowest if np.any(before) else 0
