"""Where a motion is broken: at rest, and at impacts; decided against the noise of the track itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from iris_sysid.trajectory import local_polynomials as local
from iris_sysid.trajectory.dropped_frames import lost_time
from iris_sysid.types import Array, Mask, Trajectory, runs

# A normal deviate beyond 6 comes once in 5e8 samples. Errors of tracking have longer tails than the normal, so the
# usual 4 or 5 would cut long clips in pieces; an impact at 30 frames a second or more reaches 10 to 80.
SIGNIFICANT = 6.0
SLOW = 3.0  # a speed below 3 standard errors is indistinguishable from zero (99.7 %)
SLOWEST = 0.01  # of the fastest speed: creeping at that speed moves a clip's fit by less than its noise
BRIEFEST_REST_S = 0.2  # at a turning point a pendulum is slow too, but not for a fifth of a second
STILL = 1.5  # noises: a motion adds its own spread to that of the noise
TELLING = 0.1  # of the fastest speed: a swing is slower than that for 3 % of its period only
MIN_JUMP = 0.2  # of the fastest speed; what hits or is hit changes its velocity by more
LASTING = 0.5  # share of a jump that the wider windows must see; a slip of the track fades with their width
JUMP_WIDTHS = (4, 8)  # samples on each side: 4 is the fewest with a parabola and a residual, 8 sees half the jump
MIN_SAMPLES = 5  # samples that a stretch of motion needs: a parabola and two to spare


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples ``start`` to ``stop - 1``, and why it begins and ends there; ``end`` is empty at the last sample."""

    start: int
    stop: int
    begin: str = "from first sight"
    end: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class BodyMotion:
    """The samples that can be judged: found, and not in a hand.

    ``t_s`` are the video's times with those of frames that it lost given back, ``missing_s`` in all so far.
    """

    t_s: Array
    missing_s: Array
    position: Array
    scale: Array
    index: NDArray[np.int64]
    unit: str

    @property
    def stamp_s(self) -> Array:
        """Times as the video has them. Shape (n,), in s."""
        return self.t_s - self.missing_s

    def part(self, start: int, stop: int) -> BodyMotion:
        """The samples numbered ``start`` to ``stop - 1`` in the trajectory."""
        return self.only((self.index >= start) & (self.index < stop))

    def only(self, chosen: Mask) -> BodyMotion:
        """The samples that are chosen by a mask over its own. ``chosen`` is (n,)."""
        names = ("t_s", "missing_s", "position", "index")
        return replace(self, **{name: getattr(self, name)[chosen] for name in names})


def body_of(world: Trajectory, usable: Mask) -> BodyMotion:
    """The usable samples (n,) of a trajectory; their scale is the stated sigma or the scatter, whichever is larger."""
    position = world.position[:, :2]
    index = np.flatnonzero(usable)
    scatter = local.noise(world.t_s[index], position[index])
    stated = world.sigma[usable, :2]
    finite = [column[np.isfinite(column)] for column in stated.T]
    known = np.array([np.median(column) if column.size else 0.0 for column in finite])
    smallest = 1e-9 * (np.ptp(position[index], axis=0).max() if index.size else 1.0) + np.finfo(float).tiny
    scale = np.maximum(np.maximum(scatter, known), smallest)
    missing_s = lost_time(world.t_s[index], position[index], scale)
    return BodyMotion(world.t_s[index] + missing_s, missing_s, position[index], scale, index, world.quantities[0].unit)


# --------------------------------------------------------------------------- rest


def rests(body: BodyMotion, part: Stretch) -> list[Stretch]:
    """Where the speed is indistinguishable from zero for at least 0.2 s and five samples."""
    inside = body.part(part.start, part.stop)
    if inside.index.size < MIN_SAMPLES:
        return []
    if np.all(np.std(inside.position, axis=0) < STILL * inside.scale):
        return [replace(part, begin=f"it stays within {STILL:g} times the noise of the track")]
    width, speed, error = _speed(inside)
    limit = np.maximum(SLOW * error, SLOWEST * _fastest(speed))
    if np.median(limit) > TELLING * _fastest(speed):
        return []
    return [
        _rest(inside, start, stop, float(np.median(limit)))
        for start, stop in runs(speed < limit)
        if stop - start >= width
    ]


def _speed(inside: BodyMotion) -> tuple[int, Array, Array]:
    """Width of the windows, speed (n,) and its standard error (n,).

    The narrowest windows of at least 0.2 s that can tell a tenth of the fastest speed from rest.
    """
    size = inside.index.size
    width = min(max(MIN_SAMPLES, int(np.ceil(BRIEFEST_REST_S / np.median(np.diff(inside.t_s))))), size)
    while True:
        rate, gain = local.velocity(inside.t_s, inside.position, width)
        speed, error = np.hypot.reduce(rate, axis=1), gain * np.hypot.reduce(inside.scale)
        if SLOW * np.median(error) < TELLING * _fastest(speed) or 2 * width > size // 2:
            return width, speed, error
        width *= 2


def _rest(inside: BodyMotion, start: int, stop: int, limit: float) -> Stretch:
    first, last = _while_in_place(inside, start, stop)
    begin, end = inside.stamp_s[first], inside.stamp_s[last]
    text = f"speed below {limit:.2g} {inside.unit}/s from {begin:.3g} to {end:.3g} s"
    return Stretch(int(inside.index[first]), int(inside.index[last]) + 1, text)


def _fastest(speed: Array) -> float:
    return float(np.percentile(speed, 95))  # a single outlier must not set the scale


def _while_in_place(body: BodyMotion, start: int, stop: int) -> tuple[int, int]:
    """First and last sample of a rest: as far as neighbours stay within the noise of where it rests."""
    position = np.median(body.position[start:stop], axis=0)
    near = np.all(np.abs(body.position - position) < SLOW * body.scale, axis=1)
    first, last = start, stop - 1
    while first > 0 and near[first - 1]:
        first -= 1
    while last + 1 < near.size and near[last + 1]:
        last += 1
    return first, last


def between(part: Stretch, resting: list[Stretch]) -> list[Stretch]:
    """The parts of a stretch between the rests in it."""
    parts, start, begin = [], part.start, part.begin
    for rest in (interval for interval in resting if part.start <= interval.start < part.stop):
        if rest.start > start:
            parts.append(Stretch(start, rest.start, begin, "it rests"))
        start, begin = rest.stop, "it starts from rest"
    return [*parts, Stretch(start, part.stop, begin, part.end)] if start < part.stop else parts


# --------------------------------------------------------------------------- contact


@dataclass(frozen=True, slots=True)
class Impact:
    """The first sample after an impact, and what was seen."""

    sample: int
    reason: str


def split_at_impacts(body: BodyMotion, moving: list[Stretch]) -> tuple[list[Stretch], list[Impact]]:
    """Cut stretches of the body's motion at every impact; returns the parts, and the impacts in time order."""
    stretches, impacts = [], []
    for part in moving:
        inside = _impacts(body, part)
        impacts += inside
        edges = [part.start, *[impact.sample for impact in inside], part.stop]
        texts = [part.begin, *[impact.reason for impact in inside], part.end]
        for (start, stop), (begin, end) in zip(pairwise(edges), pairwise(texts), strict=True):
            stretches.append(Stretch(start, stop, begin if start == part.start else f"after the {begin}", end))
    return stretches, impacts


def _impacts(body: BodyMotion, part: Stretch) -> list[Impact]:
    """Every jump of the velocity, in time order."""
    inside = body.part(part.start, part.stop)
    if inside.index.size < MIN_SAMPLES:
        return []
    smallest = smallest_jump(inside)
    sizes: dict[int, float] = {}
    seen = [local.jumps(inside.t_s, inside.position, inside.scale, width) for width in JUMP_WIDTHS]
    widest = seen[-1][0]
    for width, (jump, score, misfit) in zip(JUMP_WIDTHS, seen, strict=True):
        size = np.hypot.reduce(jump, axis=1)
        for step in _peaks(score, misfit, width):
            far = all(abs(step - other) >= width for other in sizes)
            if far and size[step] > smallest and _lasts(jump[step], widest[step]):
                sizes[step] = float(size[step])
    return [
        Impact(
            int(inside.index[step + 1]),
            f"velocity jumps by {size:.3g} {body.unit}/s at {inside.stamp_s[step : step + 2].mean():.3g} s",
        )
        for step, size in sorted(sizes.items())
    ]


def smallest_jump(inside: BodyMotion) -> float:
    """The jump of the velocity, m/s or px/s, below which a body was not struck."""
    rate, _ = local.velocity(inside.t_s, inside.position, MIN_SAMPLES)
    return MIN_JUMP * _fastest(np.hypot.reduce(rate, axis=1))


def _lasts(jump: Array, wider: Array) -> bool:
    """Whether wider windows, where there are any, see the same jump."""
    return not np.all(np.isfinite(wider)) or float(jump @ wider) >= LASTING * float(jump @ jump)


def _peaks(score: Array, misfit: Array, width: int) -> list[int]:
    """Steps at which the velocity jumps: highest first, each moved to where both sides fit best within half a width.

    Where only the acceleration starts, there is no jump, though its neighbours seem to have one.
    """
    open_score = np.nan_to_num(score)
    peaks = []
    while open_score.size and open_score.max() > SIGNIFICANT:
        top = int(np.argmax(open_score))
        low, high = max(top - width // 2, 0), top + width // 2 + 1
        best = low + int(np.nanargmin(misfit[low:high]))
        if score[best] > SIGNIFICANT:
            peaks.append(best)
        open_score[max(top - width, 0) : top + width + 1] = 0.0
    return peaks
