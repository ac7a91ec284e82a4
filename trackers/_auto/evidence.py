"""Evidence for and against a track that needs no truth, from sampled frames and from the track itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.types import Array, Doubt, Frame, Track, TrackMark, TrackQuality
from trackers._auto.survey import WEIGHTS, colour_distance, looks_like_shadow
from trackers._frames.arrays import Bytes, Flags
from trackers._frames.working_image import View

HEART, RING = 0.7, (1.4, 2.2)  # radii: inside of a body, and its surroundings
SMALLEST_HEART = 1.5  # px
LIKE_THE_BODY = 0.45  # of the way from the surroundings' colour to the body's: nearer to the surroundings is not it
# grey levels, luma counting a third: so far from the body's colour is another thing, however far it is from the
# surroundings' colour as well; light along the path changes a colour by less. Chosen on marked clips; two tracks
# swapped halfway (a synthetic pair, 1280x720, seed 8101) are told apart by 10 to 90 alike
ANOTHER = 30.0
TELLING = 6.0  # grey levels: less contrast tells nothing
FEWEST_PATCHES = 4
MOST_HELD = 0.9  # share of the frames with the body: more is no free motion
LEAST_TRAVEL = 0.25  # radii
FAINT = 6.0  # grey levels of luma: less, and no telling colour, is as well a chance pattern
LEAST_SAME = 0.85  # share of the samples that show the same body
MOST_SHADOW = 0.5  # share of the samples that look like a shadow
LEAP_RADII, LEAP_SPEEDS = 4.0, 5.0  # a step longer than both is a leap: radii, and times the usual step thereabouts
NEIGHBOURS = 6  # steps before and after
FEWEST_LEAPS, LEAP_SHARE = 3, 0.02
UNSTEADY = 0.12  # median change of the logarithm of the radius from frame to frame
# px, median change of the radius: what lies behind a small body changes its outline by half a pixel (a ball of 3.5 px
# before a room)
UNSTEADY_PX = 0.75
LEAST_COVERAGE = 0.85  # share of the frames in which the body is found or held: below it, it is searched for
# what helps where marks do not: a body that covers much of its own way is seen in no frame as a whole before it
BY_TEMPLATE = "if it does not turn: --tracker template --roi x,y,width,height, its box in the first frame of the clip"
MARK_RADII, MARK_PX = 1.0, 4.0  # how far a track may pass from a mark: radii, and px at least


@dataclass(frozen=True, eq=False, slots=True)
class Patches:
    """Colours (k, 3) (luma, red, blue) inside of a tracked body and just outside, in the samples (k,) that show it."""

    sample: Array
    inside: Array
    around: Array

    @property
    def body(self) -> Array:
        """The body's colour (3,): that of the patch which is most like the others. No patch has that of a mixture."""
        apart = np.linalg.norm((self.inside[:, np.newaxis] - self.inside) * WEIGHTS, axis=2)
        return np.asarray(self.inside[int(np.argmin(apart.sum(axis=1)))])

    def likeness(self) -> Array:
        """How far each patch (k,) is on the way from its surroundings' colour, 0, to the body's, 1; NaN if not telling.

        0 also where it is far from both. Luma counts a third: light changes it along the path.
        """
        expected = (self.body - self.around) * WEIGHTS
        found = (self.inside - self.around) * WEIGHTS
        size = np.linalg.norm(expected, axis=1)
        share = (expected * found).sum(axis=1) / np.maximum(size, 1e-9) ** 2
        another = np.linalg.norm(found - expected, axis=1) > np.maximum(size, ANOTHER)
        return np.where(another, 0.0, np.where(size > TELLING, share, np.nan))

    def shadow_share(self) -> float:
        """Share of the patches that look like their surroundings in less light."""
        pairs = zip(self.inside, self.around, strict=True)
        return float(np.mean([looks_like_shadow(colour, around) for colour, around in pairs]))

    def contrast(self) -> float:
        """Median difference in colour from the surroundings, grey levels."""
        return float(np.median([colour_distance(*pair) for pair in zip(self.inside, self.around, strict=True)]))


def patches_of(track: Track, view: View, frames: Sequence[Frame]) -> Patches:
    """The patches of a track in sampled frames."""
    row_of = {int(number): k for k, number in enumerate(track.frame)}
    held = np.zeros(track.valid.size, np.bool_) if track.hand is None else track.hand
    found: list[tuple[int, Array, Array]] = []
    for sample, frame in enumerate(frames):
        row = row_of.get(frame.index)
        if row is None or not track.valid[row] or held[row]:
            continue
        patch = _patch(view, frame, track.xy_px[row], _radius(track, row))
        if patch is not None:
            found.append((sample, *patch))
    return Patches(
        np.array([k for k, _, _ in found], dtype=np.int64),
        np.array([inside for _, inside, _ in found]).reshape(-1, 3),
        np.array([around for _, _, around in found]).reshape(-1, 3),
    )


def _radius(track: Track, row: int) -> float:
    radius = track.radius_px[row] if track.radius_px is not None else np.nan
    return float(radius) if np.isfinite(radius) else usual_radius(track)


def usual_radius(track: Track) -> float:
    """Median apparent radius, px; 8 where it is not known."""
    radius = np.nanmedian(track.radius_px[track.valid]) if track.radius_px is not None and track.n_valid else np.nan
    return float(radius) if np.isfinite(radius) else 8.0


def _patch(view: View, frame: Frame, place: Array, radius: float) -> tuple[Array, Array] | None:
    """Colour inside of a body and around it, from pixels that stand for at most a quarter of the radius."""
    step = max(1, int(radius / 12))
    x, y = ((c - corner + 0.5) / step - 0.5 for c, corner in zip(place, (view.left, view.top), strict=True))
    size, reach = radius / step, RING[1] * radius / step + 1
    left, top = max(0, int(x - reach)), max(0, int(y - reach))
    right, bottom = min(view.width // step, int(x + reach) + 2), min(view.height // step, int(y + reach) + 2)
    if right - left < 3 or bottom - top < 3:
        return None
    image: Bytes = view.with_chroma().part(frame, (left, top, right, bottom), step)
    rows, columns = np.ogrid[top:bottom, left:right]
    distance = (columns - x) ** 2 + (rows - y) ** 2
    heart: Flags = np.asarray(distance <= max(HEART * size, SMALLEST_HEART) ** 2)
    ring: Flags = np.asarray((distance >= (RING[0] * size + 1) ** 2) & (distance <= (RING[1] * size + 1) ** 2))
    if np.count_nonzero(heart) < 3 or np.count_nonzero(ring) < 6:
        return None
    return np.median(image[heart], axis=0), np.median(image[ring], axis=0)


def leaps(track: Track) -> Array:
    """Rows (k,) that a track reaches by a leap: a step far longer than the body, and than its steps thereabouts."""
    rows = np.flatnonzero(track.valid)
    if rows.size < 4:
        return np.zeros(0, np.int64)
    gaps = np.diff(rows)
    speeds = np.linalg.norm(np.diff(track.xy_px[rows], axis=0), axis=1) / gaps
    radius = _radius(track, int(rows[0]))
    found = []
    for k in np.flatnonzero(speeds * gaps > LEAP_RADII * radius):
        near = np.concatenate([speeds[max(0, k - NEIGHBOURS) : k], speeds[k + 1 : k + NEIGHBOURS + 1]])
        if near.size and speeds[k] > LEAP_SPEEDS * max(float(np.median(near)), 1e-9):
            found.append(int(rows[k + 1]))
    return np.array(found, dtype=np.int64)


def unsteadiness(track: Track) -> float:
    """Median change of the logarithm of the apparent radius between frames in which the body is free; 0 if unknown."""
    if track.radius_px is None:
        return 0.0
    held = np.zeros(track.valid.size, np.bool_) if track.hand is None else track.hand
    radius = np.where(track.valid & ~held & (track.radius_px > 0), track.radius_px, np.nan)
    change = np.abs(np.diff(np.log(radius)))
    return float(np.nanmedian(change)) if np.isfinite(change).any() else 0.0


def travel(track: Track) -> float:
    """Extent of a track, in radii of the body; a body that goes away from the camera changes its radius instead."""
    if not track.n_valid:
        return 0.0
    place = track.xy_px[track.valid]
    nearer = 0.0 if track.radius_px is None else float(np.ptp(track.radius_px[track.valid]))
    extent = max(float(np.hypot(*np.ptp(place, axis=0))), nearer if np.isfinite(nearer) else 0.0)
    return extent / _radius(track, int(np.flatnonzero(track.valid)[0]))


def held_share(track: Track) -> float:
    """Share of the frames with the body in which a hand, or what else reaches in from the edge, touches it."""
    return float(np.mean(track.hand[track.valid])) if track.hand is not None and track.n_valid else 0.0


def coverage(track: Track) -> float:
    """Share of the frames in which the body is found or held."""
    held = np.zeros(track.valid.size, np.bool_) if track.hand is None else track.hand
    return float(np.mean(track.valid | held))


def missed_marks(track: Track, marks: Sequence[TrackMark]) -> list[TrackMark]:
    """The marks of this body that its track does not pass."""
    row_of = {int(number): k for k, number in enumerate(track.frame)}
    missed = []
    for mark in marks:
        row = row_of.get(mark.frame)
        if mark.body != track.body or row is None:
            continue
        apart = float(np.hypot(*(track.xy_px[row] - (mark.x_px, mark.y_px)))) if track.valid[row] else np.inf
        if apart > max(MARK_PX, MARK_RADII * _radius(track, row)):
            missed.append(mark)
    return missed


def passes(track: Track, number: int, place: tuple[float, float], reach: float) -> bool:
    """Whether a track is within ``reach`` px of a place (x, y), px, in the frame of that number."""
    k = int(np.searchsorted(track.frame, number))
    if k >= track.frame.size or track.frame[k] != number or not track.valid[k]:
        return False
    return bool(np.hypot(*(track.xy_px[k] - place)) < reach)


def measured(track: Track, view: View, frames: Sequence[Frame]) -> dict[str, float]:
    """What speaks for and against a track, by name."""
    patches = patches_of(track, view, frames)
    evidence = {
        "coverage": coverage(track),
        "leaps": float(leaps(track).size),
        "unsteadiness": unsteadiness(track),
        "patches": float(len(patches.sample)),
        "travel": travel(track),
        "held": held_share(track),
    }
    if len(patches.sample) < FEWEST_PATCHES:
        return evidence
    likeness = patches.likeness()
    telling = np.isfinite(likeness)
    evidence["contrast"] = patches.contrast()
    evidence["shadow"] = patches.shadow_share()
    evidence["luma contrast"] = float(np.median(np.abs(patches.inside - patches.around)[:, 0]))
    if telling.sum() >= FEWEST_PATCHES:
        evidence["same body"] = float(np.mean(likeness[telling] > LIKE_THE_BODY))
    return evidence


def judged(track: Track, evidence: dict[str, float], marks: Sequence[TrackMark] = ()) -> TrackQuality:
    """The quality of a track by its own evidence."""
    doubts: list[Doubt] = []
    help_by_marks = (
        BY_TEMPLATE
        if marks
        else f"check the overlay, and mark the body where it is lost: --mark {track.body}=x,y@frame"
    )
    if evidence.get("same body", 1.0) < LEAST_SAME:
        share = 1 - evidence["same body"]
        doubts.append(
            Doubt("another-body", f"the track shows something else in {share:.0%} of the sampled frames", help_by_marks)
        )
    if evidence["leaps"] >= max(FEWEST_LEAPS, LEAP_SHARE * track.n_valid):
        doubts.append(Doubt("jumps", f"the track leaps {evidence['leaps']:.0f} times", help_by_marks))
    if evidence["unsteadiness"] > max(UNSTEADY, UNSTEADY_PX / usual_radius(track)):
        change = evidence["unsteadiness"]
        doubts.append(
            Doubt("unsteady-size", f"the tracked thing changes its size by {change:.0%} a frame", help_by_marks)
        )
    if evidence["held"] > MOST_HELD:
        doubts.append(held_doubt(track, evidence["held"]))
    if evidence["travel"] < LEAST_TRAVEL:
        doubts.append(Doubt("ambiguous", "the tracked thing hardly moves", help_by_marks))
    if "same body" not in evidence and evidence.get("luma contrast", 99.0) < FAINT:
        doubts.append(Doubt("faint", "the tracked thing hardly differs from its surroundings", help_by_marks))
    missed = missed_marks(track, marks)
    if missed:
        doubts.append(
            Doubt("off-marks", f"the track misses the mark in frame {missed[0].frame}", "add marks nearby, or --roi")
        )
    return TrackQuality(tuple(doubts), evidence)


def held_doubt(track: Track, share: float) -> Doubt:
    """Doubt of a track whose body is held in that share of its frames."""
    finding = f"a hand, or what else reaches in from the edge, touches it in {share:.0%} of its frames"
    return Doubt("held", finding, f"mark the free body: --mark {track.body}=x,y@frame, or cut it off: --start")


def with_quality(track: Track, view: View, frames: Sequence[Frame]) -> Track:
    """The track with how far it can be trusted, by its own evidence in sampled frames."""
    return replace(track, quality=judged(track, measured(track, view, frames)))
