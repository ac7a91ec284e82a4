"""Evidence against a track that needs no truth, each a share from 0 (none) to 1, from sampled frames and the track."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from iris_sysid.types import Array, Frame, Mask, Track, TrackMark
from trackers._auto.known_body import KnownBody
from trackers._auto.scene import Place, SampledScene
from trackers._auto.survey import WEIGHTS, ObjectClass, any_near, blob_at, colour_distance
from trackers._frames.arrays import Bytes, Flags
from trackers._frames.working_image import WorkingView

CORE, RING = 0.7, (1.4, 2.2)  # radii: inside of a body, and its surroundings
MIN_CORE = 1.5  # px
LIKE_THE_BODY = 0.45  # of the way from the surroundings' colour to the body's: a nearer patch is not the body
# grey levels, luma counting a third: a patch farther from the body's colour is of another object, however far it is
# from the surroundings' colour as well; light along the path changes a colour by less. Chosen on marked clips; values
# of 10 to 90 find that two tracks are swapped halfway (a synthetic pair, 1280x720, seed 8101)
ANOTHER = 30.0
MIN_INFORMATIVE_CONTRAST = 6.0  # grey levels: a patch with less contrast is left out
MIN_PATCHES = 4
LONG_GAP = 5  # frames without any body, over which paths no longer identify the bodies
TOGETHER = 1.5  # radii: nearer than this two tracks are of one body
ON_TRACK = 0.3  # share of the sightings of a kind that lie on the track: with fewer, the track follows another object
MIN_SIGHTINGS = 0.3  # share of the samples, for a kind that might be the body
MAX_REST = 0.5  # share of the samples: a body that rests for longer must be followed there too
MARK_RADII, MARK_PX = 1.0, 4.0  # how far a track may pass from a mark: radii, and px at least


def evidence_against(track: Track, scene: SampledScene, others: Sequence[Track] = ()) -> dict[str, float]:
    """Evidence against a track, by name, each from 0 to 1; ``coverage`` beside it, which is not evidence.

    Parameters
    ----------
    track
        One body, with its radii.
    scene
        What the sampled frames of its clip show.
    others
        The tracks of the other bodies.
    """
    patches, places = patches_of(track, scene.view, scene.frames), scene.places(track)
    likeness = patches.likeness()
    telling = likeness[np.isfinite(likeness)]
    shown = len(patches.sample) >= MIN_PATCHES
    still, scenery = _where_nothing_moves(track, scene, places)
    ragged, edge = _blobs_at(track, scene, places)
    return {
        "coverage": float(np.mean(track.valid | held_rows(track))),
        "other colours": float(np.mean(telling <= LIKE_THE_BODY)) if telling.size >= MIN_PATCHES else 0.0,
        "faint": MIN_INFORMATIVE_CONTRAST / (MIN_INFORMATIVE_CONTRAST + patches.contrast()) if shown else 0.0,
        "kinks": kinks(track),
        "barely moves": 1 / (1 + travel(track)),
        "held": held_share(track),
        "at the edge": edge,
        "ragged": ragged,
        "nothing moves": still,
        "scenery": scenery,
        "missed": missed(track, scene, others),
        "rival": rival(scene, track, others)[0],
        "disc not followed": 0.0 if others else disc_not_followed(track, scene),
        "two on one": two_on_one(track, others),
        "lost together": lost_together([track, *others]),
    }


@dataclass(frozen=True, eq=False, slots=True)
class Patches:
    """Colours (k, 3) (luma, red, blue) inside of a tracked body and just outside, in the samples (k,) that show it."""

    sample: Array
    inside: Array
    around: Array

    @property
    def body(self) -> Array:
        """The body's colour (3,), grey levels: that of the patch most like the others: none has a mixture."""
        apart = np.linalg.norm((self.inside[:, np.newaxis] - self.inside) * WEIGHTS, axis=2)
        return np.asarray(self.inside[int(np.argmin(apart.sum(axis=1)))])

    def likeness(self) -> Array:
        """How far each patch (k,) is on the way from its surroundings' colour, 0, to the body's, 1; NaN if not telling.

        0 also where it is far from both. Luma counts a third: light changes it along the path.
        """
        if not len(self.sample):
            return np.zeros(0)
        expected = (self.body - self.around) * WEIGHTS
        found = (self.inside - self.around) * WEIGHTS
        size = np.linalg.norm(expected, axis=1)
        share = (expected * found).sum(axis=1) / np.maximum(size, 1e-9) ** 2
        another = np.linalg.norm(found - expected, axis=1) > np.maximum(size, ANOTHER)
        return np.where(another, 0.0, np.where(size > MIN_INFORMATIVE_CONTRAST, share, np.nan))

    def contrast(self) -> float:
        """Median difference in colour from the surroundings, grey levels."""
        return float(np.median([colour_distance(*pair) for pair in zip(self.inside, self.around, strict=True)]))


def patches_of(track: Track, view: WorkingView, frames: Sequence[Frame]) -> Patches:
    """The patches of a track in sampled frames."""
    row_of = {int(number): k for k, number in enumerate(track.frame)}
    held = held_rows(track)
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


def _patch(view: WorkingView, frame: Frame, place: Array, radius: float) -> tuple[Array, Array] | None:
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
    heart: Flags = np.asarray(distance <= max(CORE * size, MIN_CORE) ** 2)
    ring: Flags = np.asarray((distance >= (RING[0] * size + 1) ** 2) & (distance <= (RING[1] * size + 1) ** 2))
    if np.count_nonzero(heart) < 3 or np.count_nonzero(ring) < 6:
        return None
    return np.median(image[heart], axis=0), np.median(image[ring], axis=0)


def held_rows(track: Track) -> Mask:
    """Where (n,) a hand, or another object that reaches in from the edge, touches the body."""
    return np.zeros(track.valid.size, np.bool_) if track.hand is None else track.hand


def lost_rows(track: Track) -> Mask:
    """Where (n,) the body is neither found nor held."""
    return ~track.valid & ~held_rows(track)


def _radius(track: Track, row: int) -> float:
    radius = track.radius_px[row] if track.radius_px is not None else np.nan
    return float(radius) if np.isfinite(radius) else usual_radius(track)


def usual_radius(track: Track) -> float:
    """Median apparent radius, px; 8 where it is not known."""
    radius = np.nanmedian(track.radius_px[track.valid]) if track.radius_px is not None and track.n_valid else np.nan
    return float(radius) if np.isfinite(radius) else 8.0


def kinks(track: Track) -> float:
    """Share of the frames in which the body is more than its radius off a straight way from the last to the next."""
    three = track.valid[:-2] & track.valid[1:-1] & track.valid[2:]
    bend = np.linalg.norm(np.diff(track.xy_px, n=2, axis=0), axis=1)[three] / 2
    return float(np.mean(bend > usual_radius(track))) if bend.size else 0.0


def travel(track: Track) -> float:
    """Extent of a track, in radii of the body; a body that goes away from the camera changes its radius instead."""
    if not track.n_valid:
        return 0.0
    place = track.xy_px[track.valid]
    nearer = 0.0 if track.radius_px is None else float(np.ptp(track.radius_px[track.valid]))
    extent = max(float(np.hypot(*np.ptp(place, axis=0))), nearer if np.isfinite(nearer) else 0.0)
    return extent / _radius(track, int(np.flatnonzero(track.valid)[0]))


def held_share(track: Track) -> float:
    """Share of the frames with the body in which a hand, or another object from the edge, touches it."""
    return float(np.mean(held_rows(track)[track.valid])) if track.n_valid else 0.0


def _blobs_at(track: Track, scene: SampledScene, places: Mapping[int, Place]) -> tuple[float, float]:
    """How ragged the moving blob at the track is, and in which share of the samples it is at the edge."""
    found = [blob_at(scene.foregrounds[k], at) for k, at in places.items()]
    blobs = [blob for blob in found if blob is not None]
    if len(blobs) < MIN_PATCHES:
        return 0.0, 0.0
    round_ = float(np.median([min(1.0, np.pi * blob.inscribed**2 / blob.area) for blob in blobs]))
    return 1 - round_, float(np.mean([blob.held or blob.at_edge for blob in blobs]))


def _where_nothing_moves(track: Track, scene: SampledScene, places: Mapping[int, Place]) -> tuple[float, float]:
    """Shares of the samples with the body in which nothing moves there, and in which it is off its usual place too.

    A body becomes background in one place only, where it is in most samples.
    """
    reach = usual_radius(track) / scene.view.step
    still = [at for k, at in places.items() if not any_near(scene.foregrounds[k], at, reach)]
    off = np.hypot(*(np.array(still) - np.median(still, axis=0)).T) if still else np.zeros(0)
    count = max(len(places), 1)
    return len(still) / count, float(np.count_nonzero(off > 2 * reach)) / count


def missed(track: Track, scene: SampledScene, others: Sequence[Track]) -> float:
    """Share of the samples that show the body in which it is clearly visible and the track has lost it."""
    seen = samples_missed(track, scene, others)
    return len(seen) / (len(scene.places(track)) + len(seen)) if seen else 0.0


def samples_missed(track: Track, scene: SampledScene, others: Sequence[Track]) -> list[int]:
    """The samples in which the body is clearly visible and the track has lost it."""
    is_lost, rows, places = lost_rows(track), scene.rows(track), scene.places(track)
    lost = [k for k, row in rows.items() if is_lost[row]]
    if len(places) < MIN_PATCHES or not lost or track.radius_px is None:
        return []
    reach = usual_radius(track)
    found = _clearly_seen(scene, places, reach, lost, others)
    return _without_rest(found, (min(places), max(places)), reach, MAX_REST * len(rows))


def _clearly_seen(
    scene: SampledScene, places: Mapping[int, Place], reach: float, lost: Sequence[int], others: Sequence[Track]
) -> dict[int, Place]:
    """Where the objects at some places of the samples are visible in others: px of the frame, by sample number."""
    known = KnownBody.learned(scene, places, reach / scene.view.step, others)
    moving: dict[int, Place] = {}
    still: dict[int, Place] = {}
    for k in lost:
        for at in known.clearly_in(scene.images[k]).xy:
            place = scene.view.in_frame(*at)
            if not any(passes(other, scene.frames[k].index, place, reach) for other in others):
                moves = blob_at(scene.foregrounds[k], (at[0], at[1])) is not None
                (moving if moves else still).setdefault(k, place)
    # a body at rest is background in one place; what looks like it where nothing moves in several is scenery
    at_rest = still if still and _spread(list(still.values())) < 2 * reach else {}
    return {**at_rest, **moving}


def _without_rest(found: Mapping[int, Place], shown: tuple[int, int], reach: float, most: float) -> list[int]:
    """The samples in which a lost body was found, without those of a rest before its motion, or after it.

    At rest a body is background, and may be left out; unless that is so in more than ``most`` samples.
    """
    seen = sorted(found)
    for resting in ([k for k in seen if k < shown[0]], [k for k in seen if k > shown[1]]):
        if resting and len(resting) < most and _spread([found[k] for k in resting]) < reach:
            seen = [k for k in seen if k not in resting]
    return seen


def _spread(places: Sequence[Place]) -> float:
    """Largest distance, px, of places from their median."""
    off = np.array(places) - np.median(places, axis=0)
    return float(np.hypot(*off.T).max())


def rival(scene: SampledScene, track: Track, others: Sequence[Track]) -> tuple[float, ObjectClass | None]:
    """How much more than the track another object looks like a moving body (0 not at all, 1), and its class."""
    share = {id(kind): _share_on(scene, kind, [track]) for kind in scene.kinds}
    own = max((kind.salience for kind in scene.kinds if share[id(kind)] > ON_TRACK), default=0.0)
    rivals = [
        kind
        for kind in scene.kinds
        if _share_on(scene, kind, [track, *others]) < ON_TRACK
        and len(kind.samples) >= MIN_SIGHTINGS * len(scene.frames)
    ]
    best = max(rivals, key=lambda kind: kind.salience, default=None)
    if best is None or best.salience <= own:
        return 0.0, None
    return (best.salience - own) / (best.salience + own), best


def _share_on(scene: SampledScene, kind: ObjectClass, tracks: Sequence[Track]) -> float:
    """Share of the sightings of a kind that lie on one of the tracks."""
    on = 0
    for sighting in kind.seen:
        place = scene.view.in_frame(sighting.x, sighting.y)
        reach = max(sighting.radius, 3.0) * scene.view.step
        on += any(passes(track, scene.frames[sighting.sample].index, place, reach) for track in tracks)
    return on / len(kind.seen)


def disc_not_followed(track: Track, scene: SampledScene) -> float:
    """Share of the samples that show a disc which changes its size, and in which the track does not pass it."""
    passed = [passes(track, number, (disc.x, disc.y), disc.radius) for number, disc in scene.receding.items()]
    return passed.count(False) / len(scene.frames)


def two_on_one(track: Track, others: Sequence[Track]) -> float:
    """Largest share of common frames in which another track is nearer than two bodies can be."""
    shares = [0.0]
    for other in others:
        both = track.valid & other.valid
        apart = np.hypot(*(track.xy_px - other.xy_px)[both].T)
        shares.append(float(np.mean(apart < TOGETHER * usual_radius(track))) if both.any() else 0.0)
    return max(shares)


def lost_together(tracks: Sequence[Track]) -> float:
    """Longest gap that several tracks share, as at a cut, over ``LONG_GAP``, at most 1: names may change there."""
    if len(tracks) < 2:
        return 0.0
    rows = np.flatnonzero(np.any([track.valid | held_rows(track) for track in tracks], axis=0))
    return min(1.0, float(np.diff(rows).max() - 1) / LONG_GAP) if rows.size > 1 else 0.0


def missed_marks(track: Track, marks: Sequence[TrackMark]) -> list[TrackMark]:
    """The marks of this body that its track does not pass."""
    row_of = {int(number): k for k, number in enumerate(track.frame)}
    missing = []
    for mark in marks:
        row = row_of.get(mark.frame)
        if mark.body != track.body or row is None:
            continue
        apart = float(np.hypot(*(track.xy_px[row] - (mark.x_px, mark.y_px)))) if track.valid[row] else np.inf
        if apart > max(MARK_PX, MARK_RADII * _radius(track, row)):
            missing.append(mark)
    return missing


def passes(track: Track, number: int, place: Place, reach: float) -> bool:
    """Whether a track is within ``reach`` px of a place (x, y), px, in the frame of that number."""
    k = int(np.searchsorted(track.frame, number))
    if k >= track.frame.size or track.frame[k] != number or not track.valid[k]:
        return False
    return bool(np.hypot(*(track.xy_px[k] - place)) < reach)
