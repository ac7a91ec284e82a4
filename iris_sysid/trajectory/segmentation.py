"""Find what happens when: held, let go, in motion, hit, at rest. The fit uses the motion.

Everything is decided against the noise of the track itself (:func:`iris_sysid.trajectory.local_polynomials.noise`),
so the same constants serve a webcam and a 4K clip. They are quantiles, not settings.
"""

from __future__ import annotations

from itertools import pairwise
from typing import get_args

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.trajectory import local_polynomials as local
from iris_sysid.trajectory.flights import falls, flight_length, flights, is_parabola
from iris_sysid.trajectory.rest_and_impacts import (
    MIN_SAMPLES,
    SIGNIFICANT,
    BodyMotion,
    Impact,
    Stretch,
    between,
    body_of,
    rests,
    split_at_impacts,
)
from iris_sysid.trajectory.straight_line import straight_part
from iris_sysid.types import Array, Mask, MotionKind, Segment, SegmentLabel, Trajectory, frozen_mask, runs

TO_THE_END = "to the last sample"
EDGE = 6  # samples at either end that have too few neighbours for a jump, and are compared with an extrapolation


def segment(world: Trajectory, *, hand: Mask | None = None, kind: MotionKind = "any") -> Trajectory:
    """Label the samples hand, release, motion, contact or rest, and say why in ``Segment.reason``.

    Rest is a speed that cannot be told from zero for a while. Contact is a jump of the velocity that parabolas fitted
    to either side agree on; it is placed where these fit best, so that the mere start of an acceleration is not one.
    Motion is one stretch between those:

    - ``oscillation`` and ``any``: the longest.
    - ``flight``: the first that falls and is at least half as long as the longest that is a parabola, which a bounce
      ends. Time counts with the root of the acceleration, so that a long roll is not a flight. A stretch is parted
      where its course breaks.
    - ``slide``: along a straight line, monotone, from where it is slowest to where it leaves the line; the first that
      falls and is at least half as long as the longest, which the foot of the board ends.
    - ``whole``: the longest between hands and rests, with its impacts.

    What comes before it is ``release`` and what follows ``contact``. A single sample that disagrees with neighbours
    which agree with one another is marked not valid, and the reason of the motion says so. Where frames were lost the
    same motion goes on, ahead by their way: it is not a release, and the reason says so.

    Parameters
    ----------
    world
        Trajectory of x and z, in m or px; gaps are not valid.
    hand
        (n,) true where something that reaches in from the edge of the image touches the body.
    kind
        What motion to look for.

    Returns
    -------
    Trajectory
        With ``segments`` in time order. Samples before the body is first found, and after it is last found, have none.

    Raises
    ------
    DataError
        When no sample is valid, the body is in a hand or at rest throughout, or ``hand`` has the wrong length.
    """
    if kind not in get_args(MotionKind):
        raise DataError(f"kind = {kind!r}: there are {', '.join(get_args(MotionKind))}")
    if not world.valid.any():
        raise DataError(f"none of the {world.n} samples is valid: the body was not found in any frame")
    held = _held(frozen_mask(np.zeros(world.n) if hand is None else hand, world.n, "hand"))
    body = body_of(world, world.valid & ~held)
    outliers = _outliers(body, held)
    body = body.only(~outliers)
    free = _between_hands(world, held)
    resting = [rest for part in free for rest in rests(body, part)]
    moving = [gap for part in free for gap in between(part, resting)]
    stretches, impacts = (moving, []) if kind == "whole" else split_at_impacts(body, moving)
    if kind == "flight":
        stretches = [flight for stretch in stretches for flight in flights(body, stretch)]
    motion = _choose(body, stretches, kind)
    if motion is None:
        raise DataError(_nothing_moves(world, held, resting))
    segments = _labelled(world, held, resting, impacts, motion, body)
    valid = world.valid.copy()
    valid[_left_out(world, body) & ~held] = False
    return world.with_(segments=tuple(segments), valid=valid)


# --------------------------------------------------------------------------- hand and noise


def _held(hand: Mask) -> Mask:
    """The hand without gaps of one sample, and without a single sample by itself: a cord or a shadow at the edge."""
    held = hand.copy()
    held[1:-1] |= hand[:-2] & hand[2:]
    alone = held.copy()
    alone[1:] &= ~held[:-1]
    alone[:-1] &= ~held[1:]
    alone[[0, -1]] = False
    return held & ~alone


def _outliers(body: BodyMotion, held: Mask) -> Mask:
    outliers = np.zeros(body.index.size, dtype=np.bool_)
    for start, stop in runs(~held):
        inside = (body.index >= start) & (body.index < stop)
        outliers[inside] = local.outliers(body.t_s[inside], body.position[inside], body.scale, SIGNIFICANT)
    return outliers


def _between_hands(world: Trajectory, held: Mask) -> list[Stretch]:
    """Stretches free of a hand, from the first to the last sample in which the body is found."""
    parts = []
    for start, stop in runs(~held):
        seen = np.flatnonzero(world.valid[start:stop])
        if seen.size:
            begin = f"the hand lets go at {world.t_s[start]:.3g} s" if start else "from first sight"
            end = f"a hand touches it at {world.t_s[stop]:.3g} s" if stop < world.n else ""
            parts.append(Stretch(start + int(seen[0]), start + int(seen[-1]) + 1, begin, end))
    return parts


# --------------------------------------------------------------------------- motion


def _choose(body: BodyMotion, stretches: list[Stretch], kind: MotionKind) -> Stretch | None:
    goes_down = kind in ("flight", "slide")
    candidates = [stretch for stretch in stretches if body.part(stretch.start, stretch.stop).index.size]
    if kind == "slide":
        candidates = [_straight(body, stretch) for stretch in candidates]
    if goes_down:
        candidates = [stretch for stretch in candidates if falls(body.part(stretch.start, stretch.stop))] or candidates
    if not candidates:
        return None
    if kind == "flight":
        parabolas = [stretch for stretch in candidates if is_parabola(body.part(stretch.start, stretch.stop))]
        candidates = parabolas or candidates
    sizes = np.array([_size(body.part(stretch.start, stretch.stop), kind) for stretch in candidates])
    first = int(np.argmax(sizes >= (0.5 if goes_down else 1.0) * sizes.max()))
    return _without_outlying_ends(body, candidates[first])


def _size(inside: BodyMotion, kind: MotionKind) -> float:
    return flight_length(inside) if kind == "flight" else float(inside.index.size)


def _straight(body: BodyMotion, stretch: Stretch) -> Stretch:
    inside = body.part(stretch.start, stretch.stop)
    if inside.index.size < MIN_SAMPLES or inside.position.shape[1] < 2:
        return stretch
    part = straight_part(inside.t_s, inside.position, inside.scale)
    start, stop = int(inside.index[part.start]), int(inside.index[part.stop - 1]) + 1
    begin = stretch.begin if start == inside.index[0] else f"{part.begin} at {inside.stamp_s[part.start]:.3g} s"
    end = stretch.end if stop == inside.index[-1] + 1 else f"{part.end} at {inside.stamp_s[part.stop - 1]:.3g} s"
    return Stretch(start, stop, begin, end)


def _without_outlying_ends(body: BodyMotion, stretch: Stretch) -> Stretch:
    """Cut the last (and first) few samples from where they leave the course of those before (after) them."""
    inside = body.part(stretch.start, stretch.stop)
    if inside.index.size < 2 * EDGE + MIN_SAMPLES:
        return stretch
    ahead = local.surprises(inside.t_s, inside.position, inside.scale, EDGE)[-EDGE:]
    back = local.surprises(-inside.t_s[::-1], inside.position[::-1], inside.scale, EDGE)[-EDGE:]
    cut_end = int(EDGE - np.argmax(ahead > SIGNIFICANT)) if np.any(ahead > SIGNIFICANT) else 0
    cut_start = int(EDGE - np.argmax(back > SIGNIFICANT)) if np.any(back > SIGNIFICANT) else 0
    kept = inside.index[cut_start : inside.index.size - cut_end]
    begin, end = stretch.begin, stretch.end
    if cut_start:
        begin = f"from {inside.stamp_s[cut_start]:.3g} s, where it comes onto its course"
    if cut_end:
        end = f"it leaves its course at {inside.stamp_s[-cut_end]:.3g} s"
    return Stretch(int(kept[0]), int(kept[-1]) + 1, begin, end)


def _nothing_moves(world: Trajectory, held: Mask, resting: list[Stretch]) -> str:
    if resting:
        return f"the body does not move: {resting[0].begin}; choose another part of the clip or another body"
    return (
        f"the body is in a hand in all of the {int((world.valid & held).sum())} samples in which it was found; "
        "is that something else at the edge of the image? mark the body: --mark 1=x,y@frame, or give --roi or --start"
    )


# --------------------------------------------------------------------------- labels


def _labelled(
    world: Trajectory,
    held: Mask,
    resting: list[Stretch],
    impacts: list[Impact],
    motion: Stretch,
    body: BodyMotion,
) -> list[Segment]:
    """Segments in time order: hand, rest and motion; before the motion the remainder is release, after it contact."""
    reached = "something that reaches in from the edge of the image touches it from {:.3g} to {:.3g} s"
    held_at = [(start, stop, reached.format(world.t_s[start], world.t_s[stop - 1])) for start, stop in runs(held)]
    segments = [Segment("hand", *one) for one in held_at]
    segments += [Segment("rest", rest.start, rest.stop, rest.begin) for rest in resting]
    segments.append(Segment("motion", motion.start, motion.stop, _motion_reason(world, motion, body)))
    segments.sort(key=lambda segment: segment.start)
    seen = np.flatnonzero(world.valid)
    first, last = int(seen[0]), int(seen[-1]) + 1
    starts = [min(first, segments[0].start), *[segment.stop for segment in segments]]
    stops = [*[segment.start for segment in segments], max(last, segments[-1].stop)]
    remainder: list[Segment] = []
    for start, stop in zip(starts, stops, strict=True):
        remainder += _remainder(start, min(stop, last), motion, impacts)
    return sorted(segments + remainder, key=lambda segment: segment.start)


def _left_out(world: Trajectory, body: BodyMotion) -> Mask:
    """Valid samples (n,) that are not among those of the body."""
    left_out = world.valid.copy()
    left_out[body.index] = False
    return left_out


def _motion_reason(world: Trajectory, motion: Stretch, body: BodyMotion) -> str:
    inside = body.part(motion.start, motion.stop)
    gone = np.flatnonzero(_left_out(world, body)[motion.start : motion.stop]) + motion.start
    lost = 1 + np.flatnonzero(np.diff(inside.missing_s))
    reason = f"{motion.begin}; {f'until {motion.end}' if motion.end else TO_THE_END}"
    if gone.size:
        reason += f"; {gone.size} left out that disagree with their neighbours, at {_times(world.t_s[gone])}"
    if lost.size:
        reason += f"; ahead by the way of a lost frame or more at {_times(inside.stamp_s[lost])}"
    return reason


def _times(t_s: Array) -> str:
    return ", ".join(f"{time:.3g}" for time in t_s[:5]) + (", ..." if t_s.size > 5 else "") + " s"


def _remainder(start: int, stop: int, motion: Stretch, impacts: list[Impact]) -> list[Segment]:
    """Cut the remainder at its impacts: before the motion it is release, unless an impact begins it."""
    if start >= stop:
        return []
    inside = {impact.sample: impact.reason for impact in impacts if start <= impact.sample < stop}
    edges = sorted({start, stop, *inside})
    label: SegmentLabel = "release" if stop <= motion.start else "contact"
    default = motion.begin if label == "release" else motion.end or TO_THE_END
    return [
        Segment("contact", a, b, inside[a]) if a in inside else Segment(label, a, b, default)
        for a, b in pairwise(edges)
    ]
