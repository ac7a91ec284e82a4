"""Gaps of a track filled by the body's appearance: its outline is lost where it touches its shadow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from iris_sysid.types import Array, FrameSource, Mask, Track
from trackers._auto.appearance import Peaks, search_image
from trackers._auto.best_path import MARKED, best_path
from trackers._auto.evidence import passes
from trackers._auto.follow_appearance import APART, REACH_RADII, REACH_SHARE, ROUGH
from trackers._auto.known_looks import KnownLooks, known_looks
from trackers._auto.scene import Place, SampledScene
from trackers._frames.working_image import View


def with_gaps_filled(video: FrameSource, scene: SampledScene, track: Track, others: Sequence[Track] = ()) -> Track:
    """A track with its gaps filled where the body is clearly visible on a path from end to end of the gap.

    Its outline gave no position there: such a position is known to a third of the radius.

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
    if track.radius_px is None:
        return track
    radius = float(np.nanmedian(track.radius_px[track.valid]))
    view = scene.view
    known = known_looks(scene.images, scene.places(track), radius / view.step)
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
