"""The flights of a motion: stretches between impacts that follow parabolas and fall."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from iris_sysid.trajectory import local_polynomials as local
from iris_sysid.trajectory.rest_and_impacts import (
    MIN_SAMPLES,
    SIGNIFICANT,
    SLOW,
    BodyMotion,
    Stretch,
    smallest_jump,
)
from iris_sysid.types import Array

PARABOLA = 0.05  # of its extent: what a flight leaves of a parabola is less, two flights with a bounce between more
MAX_BREAKS = 200  # places of a break that are compared at a time: in a long stretch every k-th, then those around


def falls(inside: BodyMotion) -> bool:
    """Whether its last coordinate, z, accelerates downwards significantly."""
    if inside.index.size < MIN_SAMPLES:
        return False
    fitted, gain, _ = _parabola(inside)
    return bool(fitted[2, -1] < -SLOW * gain[2] * inside.scale[-1])


def flight_length(inside: BodyMotion) -> float:
    """Samples times the root of the downward acceleration, at least its error: what rolls on the floor has little."""
    if inside.index.size < MIN_SAMPLES:
        return 0.0
    fitted, gain, _ = _parabola(inside)
    return inside.index.size * float(np.sqrt(max(-fitted[2, -1], gain[2] * inside.scale[-1])))


def is_parabola(inside: BodyMotion) -> bool:
    """Whether its coordinates follow parabolas in time, to a small part of its extent."""
    if inside.index.size < MIN_SAMPLES:
        return False
    _, _, residual = _parabola(inside)
    return bool(np.sqrt((residual**2).sum(axis=-1).mean()) < PARABOLA * np.linalg.norm(np.ptp(inside.position, axis=0)))


def flights(body: BodyMotion, stretch: Stretch) -> list[Stretch]:
    """The stretch, or its parts if it breaks: at a touch too soft, too hidden or too near to another for a jump.

    It may break where two parabolas, one on either side, leave the least sum of squares. It does if it follows no
    parabola itself, if the velocities of the two differ there as at an impact, or if a hand leads it until then.
    """
    inside = body.part(stretch.start, stretch.stop)
    breaks = range(MIN_SAMPLES, inside.index.size - MIN_SAMPLES + 1)
    if not breaks:
        return [stretch]
    stride = 1 + len(breaks) // MAX_BREAKS
    near = _best_break(inside, breaks[::stride])
    k = _best_break(inside, breaks[max(near - MIN_SAMPLES - stride + 1, 0) : near - MIN_SAMPLES + stride])
    one_course = is_parabola(inside) or _is_noise(inside)
    if one_course and not _is_struck(inside, k) and not _is_led(inside, k):
        return [stretch]
    sample, reason = int(inside.index[k]), f"its course breaks at {inside.stamp_s[k - 1 : k + 1].mean():.3g} s"
    before, after = replace(stretch, stop=sample, end=reason), replace(stretch, start=sample, begin=reason)
    return [*flights(body, before), *flights(body, after)]


def _best_break(inside: BodyMotion, breaks: range) -> int:
    """The number of the sample at which the second parabola begins where two leave the least sum of squares."""
    numbers = np.arange(inside.index.size)
    left = [_left_by_parabola(inside.only(numbers < k)) + _left_by_parabola(inside.only(numbers >= k)) for k in breaks]
    return breaks[int(np.argmin(left))]


def _left_by_parabola(inside: BodyMotion) -> float:
    """Sum of squares that parabolas in time leave of the positions."""
    _, _, residual = _parabola(inside)
    return float((residual**2).sum())


def _is_struck(inside: BodyMotion, k: int) -> bool:
    """Whether the velocity jumps before sample ``k``, as the parabolas on either side have it, by as much as a blow."""
    middle_s = inside.t_s[k - 1 : k + 1].mean(keepdims=True)
    numbers = np.arange(inside.index.size)
    sides = [
        local.fit_windows(inside.t_s, inside.position, part[None], middle_s, 2) for part in (numbers[:k], numbers[k:])
    ]
    (before, gain_before, _), (after, gain_after, _) = sides
    scatter = np.hypot(*(np.sqrt(np.mean(residual**2)) for _, _, residual in sides))
    jump = float(np.hypot.reduce(after[0, 1] - before[0, 1]))
    error = float(np.hypot(gain_before[0, 1], gain_after[0, 1]) * scatter)
    return jump > max(smallest_jump(inside), SIGNIFICANT * error)


def _is_led(inside: BodyMotion, k: int) -> bool:
    """Whether it rises faster and faster before sample ``k``, as nothing does that gravity and drag slow."""
    before = inside.only(np.arange(inside.index.size) < k)
    fitted, gain, _ = _parabola(before)
    faster = fitted[2, -1] > SIGNIFICANT * gain[2] * inside.scale[-1]
    return bool(faster and before.position[-1, -1] > before.position[0, -1])


def _is_noise(inside: BodyMotion) -> bool:
    """Whether a parabola leaves no more than the noise of the track, as of a ball that falls away from the camera."""
    _, _, residual = _parabola(inside)
    return bool(np.all(np.sqrt(np.mean(residual**2, axis=0)) < SLOW * inside.scale))


def _parabola(inside: BodyMotion) -> tuple[Array, Array, Array]:
    """Coefficients (3, d) of the parabolas through all samples, their errors (3,) per unit noise, residuals (n, d)."""
    every = np.arange(inside.index.size)[None]
    fitted, gain, residual = local.fit_windows(inside.t_s, inside.position, every, inside.t_s[:1], 2)
    return fitted[0], gain[0], residual[0]
