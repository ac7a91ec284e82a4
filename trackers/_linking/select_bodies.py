"""Which paths are the bodies that are meant: not the shadow, not the hand, not the noise; and when a hand is there."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from iris_sysid.errors import TrackingError
from trackers._detection.detection import HAND_SHARE, Box, Glimpse, Intruder, Sighting
from trackers._linking.frame_to_frame import Path, link

FIRST_REACH = 0.25  # of the picture's diagonal: how far a body may go between its first two sightings
CAUTIOUS_REACH = 0.03  # of the diagonal: how far from its prediction it may be among anything that moves
BOLD_REACH = 0.25  # the same among what looks like it
FEWEST_SIGHTINGS = 3
LEAST_EXTENT = 3.0  # px, diagonal of the box that holds a path: less is not motion
TOGETHER = 0.3  # of the shorter path: two paths seen together as long are two bodies
SHADOW_TOGETHER = 0.6  # of the shadow's path
SHADOW_SHARPNESS = 0.7  # of the body's: a shadow's outline is softer
SHADOW_LIKENESS = 0.9  # correlation of a shadow's motion with its body's
SAME = {
    "radius": np.log(1.6),
    "contrast": np.log(3),
    "sharpness": np.log(4),
    "compactness": np.log(2),
}  # largest log ratios in one body
ONE_SIGN = 0.5  # of the contrast: a body is brighter, or darker, than the background as a whole
SPEED_MARGIN = 1.5  # times the fastest that the body was seen to go
END_MARGIN = 1.5  # times the reach: how far off the first or last sighting may be
LONE_END_MARGIN = 0.4  # the same after a gap: one sighting beyond it is soon a chance
BIGGER = 1.5  # times the body's area: what reaches in is not the body itself
BREAK = 3  # frames: shorter breaks in a hold are an arm that does not show
NEARBY = 2.25  # radii round the body in which a hand holds it


def extent(path: Path) -> float:
    """Diagonal of the box that holds a path, px."""
    return float(np.hypot(*np.ptp(path.xy, axis=0)))


def score(path: Path) -> float:
    """How much a path looks like the body that is meant: far-going, lasting, large, sharp, compact."""
    looks = path.typical("radius") * path.typical("sharpness") * path.typical("compactness")
    return extent(path) * len(path.sightings) * looks


def follow(glimpses: Sequence[Glimpse], count: int, diagonal: float) -> list[Path]:
    """The paths of the ``count`` bodies that are meant, the best first, in a picture of that diagonal (px).

    Linked twice: among all sightings, cautiously, to learn what the bodies look like; then boldly
    among the sightings that look like one of them. Raises TrackingError when nothing moves or fewer
    bodies than asked for do.
    """
    first = link(glimpses, FIRST_REACH * diagonal, CAUTIOUS_REACH * diagonal)
    seeds = _seeds(first, count)
    shadows = [path for path in first if any(is_shadow(path, seed) for seed in seeds if seed is not path)]
    paths = link(_only_alike(glimpses, seeds, shadows), FIRST_REACH * diagonal, BOLD_REACH * diagonal)
    bodies = _seeds(paths, count)
    return joined(bodies, [path for path in paths if not any(path is one for one in bodies)])


def _only_alike(glimpses: Sequence[Glimpse], bodies: Sequence[Path], shadows: Sequence[Path]) -> list[Glimpse]:
    """The frames with only those sightings that are of one of the bodies, or look like it and are no shadow."""
    of_bodies = {id(one) for body in bodies for one in body.sightings}
    of_shadows = {id(one) for shadow in shadows for one in shadow.sightings}
    looks = [_looks(body) for body in bodies]

    def meant(one: Sighting) -> bool:
        if id(one) in of_bodies or id(one) in of_shadows:
            return id(one) in of_bodies
        return any(_same(_looks(Path([one])), body) for body in looks)

    return [replace(glimpse, sightings=tuple(filter(meant, glimpse.sightings))) for glimpse in glimpses]


def _seeds(paths: Sequence[Path], count: int) -> list[Path]:
    """The best path of each body: those that move most, seen together, not the shadow of one another."""
    moving = [path for path in paths if len(path.sightings) >= FEWEST_SIGHTINGS and extent(path) >= LEAST_EXTENT]
    if not moving:
        raise TrackingError(
            "nothing moves in the clip beyond the noise of the picture; check that the camera stands still, "
            "that the body differs in brightness from what is behind it, and --roi and --colour if given"
        )
    chosen: list[Path] = []
    for path in sorted(moving, key=score, reverse=True):
        seen_with_all = all(_together(path, other) >= TOGETHER for other in chosen)
        if len(chosen) < count and seen_with_all and not any(is_shadow(path, other) for other in chosen):
            chosen.append(path)
    if len(chosen) < count:
        raise TrackingError(
            f"{count} bodies were asked for, but only {len(chosen)} move(s) at the same time; "
            f"ask for fewer, or limit the picture with --roi or --colour"
        )
    return chosen


def _together(one: Path, other: Path) -> float:
    """Share of the shorter path's frames in which both are seen."""
    return len(one.frames & other.frames) / min(len(one.frames), len(other.frames))


def is_shadow(path: Path, body: Path) -> bool:
    """Whether a path is the shadow of a body: darker than the background, softer, and moving along with it."""
    if path.typical("brightening") >= 0 or path.typical("sharpness") > SHADOW_SHARPNESS * body.typical("sharpness"):
        return False
    common = path.frames & body.frames
    if len(common) < max(FEWEST_SIGHTINGS, SHADOW_TOGETHER * len(path.frames)):
        return False
    steps = [np.diff([(s.x, s.y) for s in one.sightings if s.frame in common], axis=0) for one in (path, body)]
    lengths = np.linalg.norm(steps[0]) * np.linalg.norm(steps[1])
    return bool(lengths > 0 and (steps[0] * steps[1]).sum() / lengths > SHADOW_LIKENESS)


def joined(bodies: list[Path], pieces: list[Path]) -> list[Path]:
    """The bodies, each with the pieces that can only be more of it, the best pieces first."""
    known = [_known(body) for body in bodies]
    for piece in sorted(pieces, key=lambda path: -len(path.sightings)):
        frames = piece.frames
        free = [k for k, one in enumerate(known) if not one.frames & frames and _may_be(piece, bodies[k], one)]
        if free:
            nearest = min(free, key=lambda k: _gap_px(piece, bodies[k]))
            together = [*bodies[nearest].sightings, *piece.sightings]
            bodies[nearest].sightings = sorted(together, key=lambda one: one.frame)
            known[nearest] = _known(bodies[nearest])
    for body in bodies:
        body.sightings = _trimmed(_trimmed(body.sightings)[::-1])[::-1]
    return bodies


def _trimmed(sightings: list[Sighting]) -> list[Sighting]:
    """The sightings without those at the end that lie off where the ones before them lead."""
    kept = list(sightings)
    while len(kept) > FEWEST_SIGHTINGS:
        before, end = Path(kept[-FEWEST_SIGHTINGS:-1]), kept[-1]
        miss = np.hypot(*(before.predicted(end.t_s) - (end.x, end.y)))
        adjacent = abs(end.frame - before.last.frame) == 1
        if miss <= (END_MARGIN if adjacent else LONE_END_MARGIN) * before.reach(end.t_s):
            break
        kept.pop()
    return kept


def _looks(path: Path) -> dict[str, float]:
    """What a path looks like: the logarithms of what ``SAME`` names, and how much brighter it is, -1 to 1."""
    looks = {name: float(np.log(path.typical(name))) for name in SAME}
    return looks | {"side": path.typical("brightening") / path.typical("contrast")}


def _same(looks: dict[str, float], other: dict[str, float]) -> bool:
    """Whether two things are alike in size, contrast, sharpness and shape, and not opposite in brightness."""
    sides = sorted([looks["side"], other["side"]])
    opposite = sides[0] < -ONE_SIGN and sides[1] > ONE_SIGN
    return not opposite and all(abs(looks[name] - other[name]) < limit for name, limit in SAME.items())


@dataclass(frozen=True, eq=False, slots=True)
class _Known:
    """Of a body's path: the frames in which it is seen, its looks, and the fastest that it goes, px/s."""

    frames: set[int]
    looks: dict[str, float]
    fastest: float


def _known(body: Path) -> _Known:
    steps = np.linalg.norm(np.diff(body.xy, axis=0), axis=1) / np.diff([one.t_s for one in body.sightings])
    return _Known(body.frames, _looks(body), float(np.max(steps)))


def _may_be(piece: Path, body: Path, known: _Known) -> bool:
    """Whether a piece looks like the body and could be reached by it."""
    if not _same(_looks(piece), known.looks):
        return False
    here, there = _ends(piece, body)
    allowed = SPEED_MARGIN * known.fastest * abs(here.t_s - there.t_s) + 2 * np.exp(known.looks["radius"])
    return bool(np.hypot(here.x - there.x, here.y - there.y) <= allowed)


def _ends(piece: Path, body: Path) -> tuple[Sighting, Sighting]:
    """The sighting of the piece and that of the body between which the gap lies."""
    before = bisect_left(body.sightings, piece.first.frame, key=lambda one: one.frame)
    after = bisect_right(body.sightings, piece.last.frame, key=lambda one: one.frame)
    gaps = [(piece.first, one) for one in body.sightings[max(0, before - 1) : before]]
    gaps += [(piece.last, one) for one in body.sightings[after : after + 1]]
    if not gaps:
        return piece.first, body.first
    return min(gaps, key=lambda pair: abs(pair[0].frame - pair[1].frame))


def _gap_px(piece: Path, body: Path) -> float:
    here, there = _ends(piece, body)
    return float(np.hypot(here.x - there.x, here.y - there.y))


def held_frames(path: Path, glimpses: Sequence[Glimpse]) -> set[int]:
    """Places in ``glimpses`` at which a hand is at the body, also where the body cannot be told from the hand.

    From each gap's ends the search goes on outwards as long as something that reaches in from the
    edge, larger than the body, is where the body or the hand was in the frame before.
    """
    seen = {one.frame: one for one in path.sightings}
    larger = (BIGGER * path.typical("area"), HAND_SHARE * path.typical("radius"))
    held = {k for k, glimpse in enumerate(glimpses) if glimpse.frame in seen and seen[glimpse.frame].hand}
    for order in (range(len(glimpses)), range(len(glimpses) - 1, -1, -1)):
        place: Box | None = None
        for k in order:
            sighting = seen.get(glimpses[k].frame)
            if sighting is not None:
                place = _round(sighting)
            elif place is not None:
                hand = _hand_at(place, glimpses[k].intruders, *larger)
                place = hand.box if hand else None
                held |= {k} if hand else set()
    return held | _between(held)


def _between(held: set[int]) -> set[int]:
    """The places in short breaks between held ones: a hand does not let go for a frame."""
    pairs = pairwise(sorted(held))
    return {k for one, next_one in pairs if next_one - one <= BREAK for k in range(one, next_one)}


def _round(sighting: Sighting) -> Box:
    """The box round a body in which a hand would be that holds it."""
    reach = NEARBY * sighting.radius
    return (sighting.x - reach, sighting.y - reach, sighting.x + reach, sighting.y + reach)


def _hand_at(place: Box, intruders: Sequence[Intruder], area: float, inscribed: float) -> Intruder | None:
    """The first thing that reaches in there and has more than that area, px, and inscribed radius, px."""
    for one in intruders:
        apart = one.box[0] > place[2] or one.box[2] < place[0] or one.box[1] > place[3] or one.box[3] < place[1]
        if not apart and one.area > area and one.inscribed > inscribed:
            return one
    return None
