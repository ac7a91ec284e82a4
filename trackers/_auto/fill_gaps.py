"""Gaps of a track filled by the body's appearance: its outline is lost where it touches its shadow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, Frame, FrameSource, Track, TrackMark
from trackers._auto.appearance import NOWHERE, Peaks, search_image
from trackers._auto.best_path import MARKED, best_path
from trackers._auto.evidence import lost_rows, missed_marks, passes, usual_radius
from trackers._auto.follow_appearance import APART, REACH_RADII, REACH_SHARE, ROUGH
from trackers._auto.known_body import KnownBody
from trackers._auto.scene import Place, SampledScene
from trackers._frames.ahead import ahead
from trackers._frames.working_image import WorkingView
from trackers._tracklets.frame_to_frame import MAX_GAP, SPEED_CHANGE

MIN_SEEN = 3  # rows that say where the body goes, and samples that say what it looks like


def with_gaps_filled(video: FrameSource, scene: SampledScene, track: Track, others: Sequence[Track] = ()) -> Track:
    """A track with its gaps filled where the body is clearly visible on a path from end to end of the gap.

    Likewise beyond the ends of the track, as long as it is visible in every frame. Its outline gave no position in
    these frames: such a position is known to a third of the radius.

    Parameters
    ----------
    video
        The clip; it is read once.
    scene
        The samples in which the appearance of the body is learned, and the region of interest.
    track
        Of the body, with its radii. Frames in which it is held are not gaps.
    others
        Of other bodies: where one of them is, this one is not.
    """
    shown = scene.places(track)
    if len(shown) < MIN_SEEN or track.radius_px is None or not lost_rows(track).any():
        return track
    view = scene.view
    known = KnownBody.learned(scene, shown, usual_radius(track) / view.step, others)
    places = _places(video, view, track, known, others)
    reach = max(REACH_RADII * known.appearance.radius, REACH_SHARE * float(np.hypot(*view.search_size)))
    found = {row: places[row].xy[k] for row, k in enumerate(best_path(places, reach)) if k is not None}
    found = _going_on(found, np.flatnonzero(track.valid))
    return _with_positions(track, {row: view.in_frame(*xy) for row, xy in found.items() if not track.valid[row]})


def with_marks(track: Track, marks: Sequence[TrackMark]) -> Track:
    """A track with those of its marks that lie in its gaps, where its motion leads to them, or it passes another."""
    row_of = {int(number): row for row, number in enumerate(track.frame)}
    lost = {row_of[mark.frame]: (mark.x_px, mark.y_px) for mark in marks if not track.valid[row_of[mark.frame]]}
    if len(missed_marks(track, marks)) == len(marks):
        expected = _expected(track, usual_radius(track))
        lost = {
            row: at
            for row, at in lost.items()
            if any(np.hypot(*np.subtract(at, place)) < reach for place, reach in expected.get(row, ()))
        }
    return _with_positions(track, lost) if lost else track


def _places(
    video: FrameSource, view: WorkingView, track: Track, known: KnownBody, others: Sequence[Track]
) -> list[Peaks]:
    """Where the body may be in each frame, px of the search image: on the track, or where it is clearly visible."""
    row_of = {int(track.frame[row]): int(row) for row in np.flatnonzero(lost_rows(track))}
    places = [NOWHERE] * len(track.frame)
    for row in np.flatnonzero(track.valid):
        places[row] = Peaks(np.array([view.in_search(*track.xy_px[row])]), np.array([MARKED]))
    reach, end = APART * known.appearance.radius * view.step, track.frame[track.valid][-1]

    def free_in(frame: Frame) -> tuple[int, Peaks]:
        found = known.clearly_in(search_image(view, frame))
        taken = [any(passes(other, frame.index, view.in_frame(*xy), reach) for other in others) for xy in found.xy]
        return frame.index, found.where(~np.array(taken, np.bool_))

    last = max(row_of)
    frames = takewhile(lambda frame: frame.index <= last, video.frames())
    for number, free in ahead(free_in, (frame for frame in frames if frame.index in row_of)):
        places[row_of[number]] = free
        if number > end and not len(free.score):
            break
    return places


def _expected(track: Track, radius: float) -> dict[int, tuple[tuple[Place, float], ...]]:
    """Where, and within which reaches, all px, a body is by its motion, by the row of the track.

    In its gaps along the path from end to end, for ``MAX_GAP`` frames beyond the ends with the velocity there. The
    reach is ``radius`` first, as the scene looks less like the body in a small window, then what a change of the speed
    does from the nearer end where that is more.
    """
    seen = np.flatnonzero(track.valid)
    if len(seen) < MIN_SEEN:
        return {}
    xy = track.xy_px[seen]
    rows = np.arange(max(0, seen[0] - MAX_GAP), min(len(track.valid), seen[-1] + MAX_GAP + 1))
    path = np.column_stack([np.interp(rows, seen, one) for one in xy.T])
    speeds = np.diff(xy, axis=0) / np.diff(seen)[:, np.newaxis]
    path[rows < seen[0]] += np.outer(rows[rows < seen[0]] - seen[0], speeds[0])
    path[rows > seen[-1]] += np.outer(rows[rows > seen[-1]] - seen[-1], speeds[-1])
    after = np.clip(np.searchsorted(seen, rows), 1, len(seen) - 1)
    frames = np.minimum(abs(rows - seen[after - 1]), abs(rows - seen[after]))
    far = SPEED_CHANGE * np.hypot(*speeds[after - 1].T) * frames
    ways = zip(rows.tolist(), path.tolist(), far.tolist(), strict=True)
    return {row: tuple(((x, y), reach) for reach in (radius, most) if reach >= radius) for row, (x, y), most in ways}


def _going_on(found: Mapping[int, Array], seen: NDArray[np.int64]) -> dict[int, Array]:
    """The places by row without those beyond the ends of the rows ``seen`` (n,) that follow on one without a place."""
    first, last = int(seen[0]), int(seen[-1])
    while first - 1 in found:
        first -= 1
    while last + 1 in found:
        last += 1
    return {row: place for row, place in found.items() if first <= row <= last}


def _with_positions(track: Track, places: Mapping[int, Place]) -> Track:
    """A track with its body at rough places (x, y), px, by the row that was a gap, as large as before and after."""
    rows = list(places)
    radius = np.full(len(rows), usual_radius(track))
    if track.radius_px is not None and (known := np.flatnonzero(track.radius_px > 0)).size:
        radius = np.interp(rows, known, track.radius_px[known])
    seen = np.flatnonzero(track.valid)
    beside = np.array([np.interp(rows, seen, of_axis) for of_axis in track.sigma_px[seen].T]).max(axis=0)
    error = np.maximum(np.maximum(ROUGH * radius, 0.5), beside)
    xy_px, sigma_px, valid = track.xy_px.copy(), track.sigma_px.copy(), track.valid.copy()
    xy_px[rows] = np.array(list(places.values())).reshape(-1, 2)
    sigma_px[rows] = error[:, np.newaxis]
    valid[rows] = True
    rough = {"radius_px": radius, "sigma_radius_px": error, "area_px": np.pi * radius**2}
    measured: dict[str, Any] = {name: _with_rows(getattr(track, name), rows, given) for name, given in rough.items()}
    return replace(track, xy_px=xy_px, sigma_px=sigma_px, valid=valid, **measured)


def _with_rows(values: Array | None, rows: Sequence[int], given: Array) -> Array | None:
    """A copy of ``values`` with those given (k,) in some rows (k,); None where there are none."""
    if values is None:
        return None
    copy = values.copy()
    copy[rows] = given
    return copy
