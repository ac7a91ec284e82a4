"""Doubts of tracks that the tracks of others, or what moves elsewhere in the samples, tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from iris_sysid.types import Doubt, Frame, Track
from trackers._auto.evidence import usual_radius
from trackers._auto.fill_gaps import sampled_places
from trackers._auto.survey import any_near
from trackers._detection.foreground import Blob
from trackers._frames.working_image import View

LONG_GAP = 5  # frames without any body
TOGETHER = 1.5  # radii: two tracks that are often nearer to each other are of one body, at least in part
# of their common frames; balls on cords of ten radii that pass each other are so near in a tenth of them, of five
# radii in a fifth
OFTEN = 0.3
# shares of the samples in which a track is where nothing moves: two radii and more from where it mostly is then (a body
# becomes background in one place only, where it is in most samples), and at all (a body moves now and then)
SCENERY, MOST_STILL = 0.1, 0.9


def by_looks_alone(track: Track) -> Doubt:
    """Doubt of a track by looks where nothing is followed before the background."""
    finding = "no such body is followed before the still background; its looks alone tell it"
    return Doubt("ambiguous", finding, f"check the overlay, and mark it: --mark {track.body}=x,y@frame")


def lost_together(tracks: Sequence[Track]) -> list[Doubt]:
    """Doubt where several bodies are lost for some frames at once, as at a cut: paths do not tell which is which then.

    Parameters
    ----------
    tracks
        All tracks of a clip, by paths alone.
    """
    if len(tracks) < 2:
        return []
    seen = np.any([track.valid | (False if track.hand is None else track.hand) for track in tracks], axis=0)
    rows = np.flatnonzero(seen)
    gaps = np.diff(rows) - 1
    if not gaps.size or gaps.max() < LONG_GAP:
        return []
    before = tracks[0].frame[rows[int(np.argmax(gaps))]]
    finding = f"all bodies are lost together for {gaps.max()} frames after frame {before}: names may change there"
    return [Doubt("ambiguous", finding, "mark each body before and after: --mark 1=x,y@frame --mark 2=x,y@frame")]


def doubts_of_one_body(track: Track, others: Sequence[Track]) -> list[Doubt]:
    """Doubt where one of the others is often nearer to a ``track`` than two bodies can be.

    Parameters
    ----------
    track, others
        Tracks of one clip.
    """
    if track.radius_px is None or not track.n_valid:
        return []
    reach = TOGETHER * float(np.nanmedian(track.radius_px[track.valid]))
    for other in others:
        both = track.valid & other.valid
        apart = np.hypot(*(track.xy_px - other.xy_px)[both].T)
        if both.any() and np.quantile(apart, OFTEN) < reach:
            finding = f"bodies {track.body} and {other.body} are often tracked at one place"
            remedy = f"mark each: --mark {track.body}=x,y@frame, or ask for fewer --bodies"
            return [Doubt("another-body", finding, remedy)]
    return []


def off_motion(track: Track, view: View, frames: Sequence[Frame], foregrounds: Sequence[Sequence[Blob]]) -> list[Doubt]:
    """Doubt where a track is in several places in which nothing moves, or hardly ever where something does.

    Parameters
    ----------
    track
        One body.
    view
        The region looked at.
    frames, foregrounds
        The samples, and what differs from the still background in each of them.
    """
    places, reach = sampled_places(track, view, frames), usual_radius(track) / view.step
    still = [at for k, at in places.items() if not any_near(foregrounds[k], at, reach)]
    off = np.hypot(*(np.array(still) - np.median(still, axis=0)).T) if still else np.zeros(0)
    share = len(still) / max(len(places), 1)
    if share <= MOST_STILL and np.count_nonzero(off > 2 * reach) <= SCENERY * len(places):
        return []
    finding = f"in {share:.0%} of the sampled frames nothing moves where the track is"
    return [Doubt("another-body", finding, f"mark the body in more frames: --mark {track.body}=x,y@frame")]
