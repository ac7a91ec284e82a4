"""Gaps of a track filled by the body's looks: where it touches its shadow the outline no longer tells where it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from iris_sysid.types import Array, Frame, FrameSource, Mask, Track
from trackers._auto.appearance import Appearance, Peaks, learn, score_at, search_image
from trackers._auto.best_path import MARKED, best_path
from trackers._auto.evidence import passes
from trackers._auto.follow_appearance import APART, REACH_RADII, REACH_SHARE, ROUGH
from trackers._frames.arrays import Bytes, Image
from trackers._frames.working_image import View

SCENERY = 0.5  # share of the samples with the body elsewhere: a place that looks like it there too is scenery
PLAIN = 0.75  # of the usual score of the body: as plain as that is no chance likeness

Place = tuple[float, float]


@dataclass(frozen=True, eq=False, slots=True)
class KnownLooks:
    """What a tracked body looks like, the score from which on a place is plainly it, and where it is in the samples.

    ``maps`` are the scores (h, w) of the search images, ``places`` where the body is in them, by the sample's number.
    """

    looks: Appearance
    plain: float
    maps: Mapping[int, Image]
    places: Mapping[int, Place]

    def plainly_in(self, image: Bytes) -> Peaks:
        """The places of a search image (h, w, 3) that are plainly the body and no scenery, the best first."""
        peaks = self.looks.peaks(image, self.plain)
        at = [(float(x), float(y)) for x, y in peaks.xy]
        kept = [not is_scenery(self.maps, self.places, place, self.looks.radius, self.plain) for place in at]
        return peaks.where(np.array(kept, np.bool_))


def known_looks(view: View, frames: Sequence[Frame], places: Mapping[int, Place], reach: float) -> KnownLooks:
    """The looks of a body of radius ``reach`` px, from its places (x, y) in some samples, px of the search image."""
    images = {k: search_image(view, frames[k]) for k in places}
    looks = learn(list(images.values()), list(places.values()), max(1.5, reach / view.step))
    maps = {k: looks.score_map(image) for k, image in images.items()}
    plain = PLAIN * float(np.median([score_at(maps[k], place) for k, place in places.items()]))
    return KnownLooks(looks, plain, maps, places)


def sampled_places(track: Track, view: View, frames: Sequence[Frame]) -> dict[int, Place]:
    """Where (x, y), px of the search image, a track is in the samples, by their number; gaps are left out."""
    row_of = {int(number): k for k, number in enumerate(track.frame)}
    rows = {k: row_of[frame.index] for k, frame in enumerate(frames) if frame.index in row_of}
    return {k: view.in_search(*track.xy_px[row]) for k, row in rows.items() if track.valid[row]}


def with_gaps_filled(
    video: FrameSource, view: View, frames: Sequence[Frame], track: Track, others: Sequence[Track] = ()
) -> Track:
    """A track with its gaps filled where the body is plainly to be seen on a path from end to end of the gap.

    Its outline told too little there, or there would be no gap: such a position is known to a third of the radius.

    Parameters
    ----------
    video
        The clip; it is read once.
    view
        The region to look at.
    frames
        The samples in which the looks of the body are learned.
    track
        Of the body, with its radii. Frames in which it is held are no gaps.
    others
        Of other bodies: where one of them is, this one is not.
    """
    if track.radius_px is None:
        return track
    radius = float(np.nanmedian(track.radius_px[track.valid]))
    known = known_looks(view, frames, sampled_places(track, view, frames), radius)
    places = _places(video, view, track, known, others)
    chosen = best_path(places, max(REACH_RADII * known.looks.radius, REACH_SHARE * float(np.hypot(*view.search_size))))
    found = {row: places[row].xy[column] for row, column in enumerate(chosen) if column is not None}
    return _with_positions(
        track, {row: view.in_frame(*xy) for row, xy in found.items() if not track.valid[row]}, radius
    )


def _places(video: FrameSource, view: View, track: Track, known: KnownLooks, others: Sequence[Track]) -> list[Peaks]:
    """Where the body may be in each frame, px of the search image: on the track, or what looks like it."""
    seen = np.flatnonzero(track.valid)
    gap: Mask = ~track.valid if track.hand is None else ~track.valid & ~track.hand
    gap[: seen[0]] = gap[seen[-1] :] = False
    at = {int(number): row for row, number in enumerate(track.frame)}
    places = [Peaks(np.zeros((0, 2)), np.zeros(0))] * len(track.frame)
    for row in seen:
        places[row] = Peaks(np.array([view.in_search(*track.xy_px[row])]), np.array([MARKED]))
    for frame in video.frames():
        here = at.get(frame.index)
        if here is not None and gap[here]:
            found = known.plainly_in(search_image(view, frame))
            reach = APART * known.looks.radius * view.step
            free = [
                not any(passes(other, frame.index, view.in_frame(*xy), reach) for other in others) for xy in found.xy
            ]
            places[here] = found.where(np.array(free, np.bool_))
    return places


def _with_positions(track: Track, places: Mapping[int, Place], radius: float) -> Track:
    """A track with a body of that radius at rough places (x, y), all in px, by the row that was a gap."""
    rows = list(places)
    error = max(ROUGH * radius, 0.5)
    xy_px, sigma_px, valid = track.xy_px.copy(), track.sigma_px.copy(), track.valid.copy()
    xy_px[rows] = np.array(list(places.values())).reshape(-1, 2)
    sigma_px[rows] = error
    valid[rows] = True
    rough = {"radius_px": radius, "sigma_radius_px": error, "area_px": np.pi * radius**2}
    measured: dict[str, Any] = {name: _with_rows(getattr(track, name), rows, given) for name, given in rough.items()}
    return replace(track, xy_px=xy_px, sigma_px=sigma_px, valid=valid, **measured)


def _with_rows(values: Array | None, rows: Sequence[int], given: float) -> Array | None:
    """A copy of ``values`` with one value in some rows; None where there are none."""
    if values is None:
        return None
    copy = values.copy()
    copy[rows] = given
    return copy


def is_scenery(
    maps: Mapping[int, Image], places: Mapping[int, Place], place: Place, reach: float, plain: float
) -> bool:
    """Whether a place looks like the body also in most of the samples in which the body is elsewhere.

    Parameters
    ----------
    maps
        Scores (h, w) of samples that show the body, by their number.
    places
        Where it is in them, px of the search image.
    place
        The place in question, likewise.
    reach
        Radius of the body, px.
    plain
        Score from which on a place looks like the body.
    """
    away = [k for k, body in places.items() if np.hypot(body[0] - place[0], body[1] - place[1]) > 3 * reach]
    return bool(away) and bool(np.mean([score_at(maps[k], place) > plain for k in away]) > SCENERY)
