"""Tracks with a person's corrections: points placed and removed, bodies split, exchanged and dropped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.review.edits import Confirm, Delete, Drop, Edit, Place, SplitTrack, Swap
from iris_sysid.types import TRACK_MASKS, TRACK_MEASURES, Array, Doubt, Mask, Track, TrackMark, TrackQuality, mapped
from iris_sysid.video.empty_track import empty_track

# columns of a track with a value for every frame, and their value in a frame without the body
PER_FRAME: dict[str, Any] = {
    **dict.fromkeys(("xy_px", "sigma_px", *TRACK_MEASURES), np.nan),
    **dict.fromkeys(("valid", *TRACK_MASKS), False),
}
MAX_BODIES = 64
IGNORED_PX = 6.0  # a click on something else than a body means what is at least as near
LEAP_STEPS = 5.0  # median steps of a track, and IGNORED_PX: a detection farther away is another object

Tracks = tuple[Track, ...]
Whole = NDArray[np.integer[Any]]  # rows, or numbers of frames


def corrected(tracks: Tracks, edit: Edit) -> Tracks:
    """The tracks after an edit; as they are where it is not about tracks. DataError where it names no body or frame."""
    match edit:
        case Place():
            return _placed(tracks, edit)
        case Delete():
            return _changed(tracks, edit.body, lambda track: _deleted(track, edit.first, edit.last))
        case SplitTrack():
            return _split(tracks, edit)
        case Swap():
            return _swapped(tracks, edit)
        case Drop():
            _index(tracks, edit.body)
            return tuple(track for track in tracks if track.body != edit.body)
        case Confirm():
            return _changed(tracks, edit.body, lambda track: _confirmed(track, edit))
    return tracks


def with_edits_of(new: Sequence[Track], old: Tracks) -> Tracks:
    """Tracks that a tracker made anew, with the points placed and removed by hand in the old tracks of the same bodies.

    Frames that the new tracks do not have are left out. A body that is in the old tracks alone is kept where a person
    placed it.
    """
    by_hand = {track.body: track for track in old if track.edited is not None and track.edited.any()}
    names = {track.body for track in new}
    kept = [
        _overlaid(empty_track(new[0].t_s, new[0].frame, body), track)
        for body, track in by_hand.items()
        if new and body not in names
    ]
    return (*(_overlaid(track, by_hand[track.body]) if track.body in by_hand else track for track in new), *kept)


def without_ignored(tracks: Tracks, marks: Sequence[TrackMark]) -> Tracks:
    """The tracks without what is at some marks, as far as it is followed without a gap or a leap before and after.

    Points that a person placed stay. Nothing changes where no track is at a mark.
    """
    for mark in marks:
        tracks = tuple(_without_ignored(track, mark) for track in tracks)
    return tracks


def passes(track: Track, mark: TrackMark) -> bool:
    """Whether a ``track`` is at a mark, within the radius of its body there."""
    row = int(np.searchsorted(track.frame, mark.frame))
    if row == track.frame.size or track.frame[row] != mark.frame or not track.valid[row]:
        return False
    radius = np.nan if track.radius_px is None else track.radius_px[row]
    reach = max(IGNORED_PX, float(radius) if np.isfinite(radius) else 0.0)
    return bool(np.hypot(*(in_frame_px(track)[row] - (mark.x_px, mark.y_px))) <= reach)


def _without_ignored(track: Track, mark: TrackMark) -> Track:
    if not passes(track, mark):
        return track
    row = int(np.searchsorted(track.frame, mark.frame))
    steps = np.hypot(*np.diff(track.xy_px, axis=0).T)
    usual = float(np.nanmedian(steps)) if np.isfinite(steps).any() else 0.0
    ends = np.flatnonzero(~(steps <= LEAP_STEPS * usual + IGNORED_PX))  # a gap is NaN, and ends it too
    first = ends[ends < row].max(initial=-1) + 1
    last = ends[ends >= row].min(initial=track.frame.size - 1)
    rows = np.arange(first, last + 1)
    rows = rows[~(edited_mask(track) & track.valid)[rows]]
    return _with_rows(track, rows, {**PER_FRAME, "edited": False})


def edited_mask(track: Track) -> Mask:
    """Where a person placed or removed the position of a track; shape (n,)."""
    return np.zeros(track.t_s.size, dtype=np.bool_) if track.edited is None else track.edited


def row_of(track: Track, frame: int) -> int:
    """The row of a frame of that number; DataError where the track does not have it."""
    row = int(np.searchsorted(track.frame, frame))
    if row == track.frame.size or track.frame[row] != frame:
        first, last = track.frame[0], track.frame[-1]
        raise DataError(f"frame {frame} is not among the frames that were tracked, {first} to {last}")
    return row


def _index(tracks: Tracks, body: str) -> int:
    names = [track.body for track in tracks]
    if body not in names:
        raise DataError(f"there is no body {body!r}; there are {', '.join(names) or 'none yet'}")
    return names.index(body)


def _changed(tracks: Tracks, body: str, change: Any) -> Tracks:
    at = _index(tracks, body)
    return (*tracks[:at], change(tracks[at]), *tracks[at + 1 :])


def _placed(tracks: Tracks, edit: Place) -> Tracks:
    if edit.body not in [track.body for track in tracks]:
        if not tracks:
            raise DataError("no frame was tracked yet; track the clip first")
        _check_room(tracks)
        tracks = (*tracks, empty_track(tracks[0].t_s, tracks[0].frame, edit.body))
    return _changed(tracks, edit.body, lambda track: _with_point(track, edit))


def _with_point(track: Track, edit: Place) -> Track:
    row = row_of(track, edit.frame)
    at = np.array([[edit.x, edit.y]])
    if track.camera_motion is not None:
        at = np.linalg.solve(track.camera_motion[row][:, :2], at[0] - track.camera_motion[row][:, 2])[None]
    rows = _gap_at(track, row) if edit.at_rest else np.array([row])
    return _with_rows(
        track, rows, {"xy_px": at, "sigma_px": edit.sigma_px, "valid": True, "edited": True, "hand": False}
    )


def _gap_at(track: Track, row: int) -> Whole:
    """The rows around one in which the body was neither found nor taken out by hand; that one is always among them."""
    known = track.valid | edited_mask(track)
    before, after = np.flatnonzero(known[:row]), np.flatnonzero(known[row + 1 :])
    if known[row]:
        return np.array([row])
    first = before[-1] + 1 if before.size else 0
    return np.arange(first, row + 1 + after[0] if after.size else known.size)


def _deleted(track: Track, first: int, last: int) -> Track:
    rows = np.flatnonzero((track.frame >= first) & (track.frame <= last))
    if not rows.size:
        raise DataError(f"frames {first} to {last} are not among those that were tracked")
    return _with_rows(track, rows, {**PER_FRAME, "hand": None, "edited": True})


def _with_rows(track: Track, rows: Whole, values: dict[str, Any]) -> Track:
    """The track with values in some rows; None leaves a column as it is, and only ``edited`` is added to a track."""
    changes: dict[str, Any] = {}
    for name, value in values.items():
        present = edited_mask(track) if name == "edited" else getattr(track, name)
        if present is not None and value is not None:
            changes[name] = np.array(present)
            changes[name][rows] = value
    return replace(track, **changes)


def _split(tracks: Tracks, edit: SplitTrack) -> Tracks:
    at = _index(tracks, edit.body)
    if edit.name in [track.body for track in tracks]:
        raise DataError(f"there is a body {edit.name!r} already; give another name")
    _check_room(tracks)
    track, row = tracks[at], row_of(tracks[at], edit.frame)
    rows = np.arange(track.frame.size)
    before = _with_rows(track, rows[row:], PER_FRAME)
    after = replace(_with_rows(track, rows[:row], PER_FRAME), body=edit.name)
    return (*tracks[:at], before, after, *tracks[at + 1 :])


def _swapped(tracks: Tracks, edit: Swap) -> Tracks:
    first, second = _index(tracks, edit.body), _index(tracks, edit.other)
    if first == second:
        raise DataError(f"body {edit.body!r} cannot be exchanged with itself; name two bodies")
    one, other = tracks[first], tracks[second]
    if not np.array_equal(one.frame, other.frame):
        raise DataError(f"bodies {edit.body!r} and {edit.other!r} were not tracked in the same frames")
    row = row_of(one, edit.frame)
    changed = list(tracks)
    changed[first], changed[second] = _with_end_of(one, other, row), _with_end_of(other, one, row)
    return tuple(changed)


def _with_end_of(track: Track, other: Track, row: int) -> Track:
    """The track up to a row, and another after it."""
    changes: dict[str, Any] = {}
    for name, absent in PER_FRAME.items():
        own, others = getattr(track, name), getattr(other, name)
        if own is None and others is None:
            continue
        parts = [np.full(len(track.t_s), absent) if part is None else part for part in (own, others)]
        changes[name] = np.concatenate([parts[0][:row], parts[1][row:]])
    return replace(track, **changes)


def _confirmed(track: Track, edit: Confirm) -> Track:
    """The track without the doubts about all of it that a person has looked into, once that is in all of its frames."""
    if track.quality is None or edit.first > track.frame[0] or edit.last < track.frame[-1]:
        return track
    left = tuple(doubt for doubt in track.quality.doubts if doubt.kind not in edit.doubts)
    return replace(track, quality=replace(track.quality, doubts=left))


def _overlaid(track: Track, by_hand: Track) -> Track:
    """The track with the rows that were edited in another track of the same body."""
    edited = by_hand.frame[edited_mask(by_hand)]
    frames = edited[np.isin(edited, track.frame)]
    rows, source = np.searchsorted(track.frame, frames), np.searchsorted(by_hand.frame, frames)
    values = {name: getattr(by_hand, name)[source] for name in ("xy_px", "sigma_px", "valid")}
    if not track.n_valid and track.quality is None:
        track = replace(track, quality=by_hand.quality)
    return _with_rows(track, rows, {**values, "edited": True})


def _check_room(tracks: Tracks) -> None:
    if len(tracks) >= MAX_BODIES:
        raise DataError(f"there are {len(tracks)} bodies already, and at most {MAX_BODIES}; drop one first")


def in_frame_px(track: Track) -> Array:
    """Positions (n, 2), px of each frame; where the camera moves these are not those of the track."""
    if track.camera_motion is None:
        return track.xy_px
    return np.array([mapped(*pair) for pair in zip(track.camera_motion, track.xy_px, strict=True)])


def doubts_of(track: Track) -> tuple[Doubt, ...]:
    """Evidence against a track."""
    return (track.quality or TrackQuality()).doubts
