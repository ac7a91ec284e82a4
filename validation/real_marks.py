"""Real clips marked by eye: the bodies in 12 frames of each, and what a track is worth against them.

The marks are in ``tests/real_marks``, one table a clip beside the list ``clips.csv``. They were read from enlarged
frames with a pixel grid, those of ``world`` and ``world2`` before any tracker was run on them; the others were known.
The clips of ``world2`` are in the order of the SHA-256 of their paths, and every second one is sealed: scored, not
looked at. Half of those of ``world`` were sealed before, and ``roll-cue-snooker`` until it was scored wrong: these are
open now. Two marks were corrected after tracks were seen: the ball of ``throw-classroom`` is held overhead in frames 5
and 15, and was taken to be out of view.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from iris_sysid.types import Array, Track, mapped

ROOT = Path(__file__).parent.parent
MARKS = ROOT / "tests" / "real_marks"
DATA = ROOT.parent / "shared" / "data"
MIN_PX, OF_WIDTH = 6.0, 640.0  # a body smaller than this in an image so wide is met within this, px
MIN_ON_BODY = 0.95  # share of the marks that lie on the body, for a clip to count as followed
MAX_ELSEWHERE = 0.05  # share of the marks that lie elsewhere, for a clip not to count as wrong


@dataclass(frozen=True, slots=True)
class MarkedClip:
    """A clip and its marks.

    ``split`` is open or sealed; ``expect`` is follow, refuse (no free body) or orientation (no position is asked).
    """

    name: str
    clip: str
    bodies: int
    split: str
    expect: str
    remark: str

    @property
    def path(self) -> Path:
        """The recording."""
        return DATA / self.clip

    def marks(self) -> pd.DataFrame:
        """Columns frame, body, x_px, y_px, radius_px and state: free, held, edge (cut by it), or out (of the image)."""
        return pd.read_csv(MARKS / f"{self.name}.csv")


def marked_clips(split: str = "", only: str = "", first: int | None = None) -> list[MarkedClip]:
    """The clips that have marks, of one split (or all), whose name contains a text.

    ``first``: only so many, in the order of the SHA-256 of their names, which is by chance.
    """
    rows = pd.read_csv(MARKS / "clips.csv", keep_default_na=False).to_dict("records")
    clips = [MarkedClip(**{str(name): value for name, value in row.items()}) for row in rows]
    asked = [clip for clip in clips if clip.expect != "orientation" and split in ("", clip.split) and only in clip.name]
    return asked if first is None else sorted(asked, key=lambda clip: sha256(clip.name.encode()).hexdigest())[:first]


@dataclass(frozen=True, slots=True)
class Score:
    """Numbers of marks: of free bodies (on it, missing, elsewhere), and of bodies out of view (tracked all the same).

    ``held`` are those in a hand, ``said_held`` the ones of these that the track says to be touched by one.
    """

    free: int
    on_body: int
    missing: int
    elsewhere: int
    absent: int
    tracked_absent: int
    held: int = 0
    said_held: int = 0

    @property
    def followed(self) -> bool:
        """Whether at least 95 % of the marks are met."""
        return self.free > 0 and self.on_body >= MIN_ON_BODY * self.free

    @property
    def wrong(self) -> bool:
        """Whether more than 5 % of the positions are not the body's; one that is never free must be said to be held."""
        if not self.free:
            return 2 * self.said_held < self.held
        return self.elsewhere + self.tracked_absent > MAX_ELSEWHERE * (self.free + self.absent)


def score(tracks: Sequence[Track], marks: pd.DataFrame, width: int) -> Score:
    """Compare tracks with marks; each body has the track that is on it in most frames of the clip.

    Parameters
    ----------
    tracks
        In px of the frames.
    marks
        Table of a clip.
    width
        Of the image, px.
    """
    chosen = list(compared(tracks, marks, width).values())
    return Score(**{name: sum(part[name] for part in chosen) for name in chosen[0]})


def compared(tracks: Sequence[Track], marks: pd.DataFrame, width: int) -> dict[int, Mapping[str, int]]:
    """The counts of :class:`Score` of each track against the marks of the body that it follows, by its number."""
    return {track: counts for track, _, counts in _pairs(tracks, marks, width)}


def missed(tracks: Sequence[Track], marks: pd.DataFrame, width: int) -> NDArray[np.bool_]:
    """The marks (n,) of free bodies that the tracks of these bodies do not meet; all where there are no tracks."""
    wrong = marks["state"] == "free"
    for track, rows, _ in _pairs(tracks, marks, width):
        wrong[rows.index] &= ~_met(at_frames(tracks[track], rows["frame"].to_numpy())[0], rows, width)
    return wrong.to_numpy()


def _pairs(
    tracks: Sequence[Track], marks: pd.DataFrame, width: int
) -> Iterator[tuple[int, pd.DataFrame, Mapping[str, int]]]:
    """The number of the track that is on a body in most frames, the marks of that body, and the counts of the two."""
    groups = [rows for _, rows in marks.groupby("body")]
    parts = [[_compare(track, rows, width) for track in tracks] for rows in groups]
    taken = linear_sum_assignment(np.array([[-part["on_body"] for part in row] for row in parts]))
    for body, track in zip(*taken, strict=True):
        yield int(track), groups[body], parts[body][track]


def _met(xy_px: Array, marks: pd.DataFrame, width: int) -> NDArray[np.bool_]:
    """Whether positions (n, 2) px are on the bodies at the marks (n,)."""
    off_px = np.hypot(*(xy_px - marks[["x_px", "y_px"]].to_numpy()).T)
    return np.asarray(off_px <= np.maximum(marks["radius_px"].to_numpy(), MIN_PX * width / OF_WIDTH))


def _compare(track: Track, marks: pd.DataFrame, width: int) -> Mapping[str, int]:
    """Counts of one track against the marks of one body."""
    xy_px, hand = at_frames(track, marks["frame"].to_numpy())
    tracked, met = np.isfinite(xy_px[:, 0]), _met(xy_px, marks, width)
    free, absent, held = (marks["state"].to_numpy() == state for state in ("free", "out", "held"))
    return {
        "free": int(free.sum()),
        "on_body": int((free & met).sum()),
        "missing": int((free & ~tracked).sum()),
        "elsewhere": int((free & tracked & ~met).sum()),
        "absent": int(absent.sum()),
        "tracked_absent": int((absent & tracked).sum()),
        "held": int(held.sum()),
        "said_held": int((held & (hand | ~tracked)).sum()),
    }


def at_frames(track: Track, frames: NDArray[np.int64]) -> tuple[Array, NDArray[np.bool_]]:
    """Positions (n, 2), px of the frames as filmed, of a track in frames (n,), NaN where it has none; if held."""
    rows = np.clip(np.searchsorted(track.frame, frames), 0, len(track.frame) - 1)
    there = (track.frame[rows] == frames) & track.valid[rows]
    hand = np.zeros(len(frames), dtype=bool) if track.hand is None else track.hand[rows]
    xy_px = track.xy_px[rows]
    if track.camera_motion is not None:
        xy_px = mapped(track.camera_motion[rows], xy_px)
    return np.where(there[:, None], xy_px, np.nan), hand & there
