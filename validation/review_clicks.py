"""How far at most five clicks of a review bring the tracks of real clips, with a person simulated by marks made by eye.

``python -m validation.review_clicks`` prints a row a clip: the usable marks (body free and in view) on the body without
a click and after the clicks, and the clicks made. The person goes to a marked frame that is wrong, first to one that
the review asks about, shows the body there ("This is the body") and tracks again. A body that is not found but was
marked at one place in the frames around is placed there once, "it rests while not found"; two tracks that follow each
other's body are exchanged from the frame on in which they began to ("Swap", a click each). What does not help is undone
and counts all the same; then the thing that was followed is said to be no body. Frames in which something was clicked
are left out of the score. ``--split sealed`` is for clips that nobody has looked at.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from iris_sysid.errors import IrisError
from iris_sysid.review.corrected_tracks import corrected
from iris_sysid.review.doubtful_frames import questions_of
from iris_sysid.review.edits import Place, Swap
from iris_sysid.review.request import ReviewRequest
from iris_sysid.review.session import followed, marked_all
from iris_sysid.types import Track, TrackMark, TrackOptions
from iris_sysid.video.reader import open_video
from validation.real_marks import MIN_ON_BODY, MIN_PX, OF_WIDTH, MarkedClip, at_frames, marked_clips

CLICKS = 5


@dataclass(frozen=True, slots=True)
class Shown:
    """What a person sees after tracking: the marked table with ``x``, ``y`` of the track, ``wrong`` and ``asked``.

    ``placed`` are points of bodies at rest, which stay when the tracker is run again; ``size`` is that of the images,
    px.
    """

    request: ReviewRequest
    tracks: tuple[Track, ...]
    table: pd.DataFrame
    placed: tuple[Place, ...] = ()
    size: tuple[int, int] = (0, 0)

    @property
    def n_wrong(self) -> int:
        """Marks at which a track is wrong."""
        return int(self.table["wrong"].sum())


@dataclass(frozen=True, slots=True)
class Outcome:
    """Share of the usable marks on the body before and after the clicks; of the frames not clicked."""

    usable: int
    before: float
    after: float
    clicks: int


def reviewed(clip: MarkedClip) -> Outcome:
    """Track a clip, and correct it with at most ``CLICKS`` clicks."""
    marks = clip.marks()
    shown = first = _tracked(clip, marks, ReviewRequest(tracking=TrackOptions(bodies=clip.bodies)))
    clicked: set[int] = set()
    clicks, turn = 0, 0
    while shown.n_wrong and clicks < CLICKS:
        row = _looked_at(shown.table, clicked)
        if row is None:
            break
        resting = _rests(shown, row) if turn % 2 == 0 else None
        if resting is None:
            request, cost, frames = _clicked(shown, row, marks, show=turn % 2 == 0)
            placed = shown.placed
        else:
            request, cost, frames, placed = shown.request, 1, {resting.frame}, (*shown.placed, resting)
        if clicks + cost > CLICKS:
            break
        clicks += cost
        clicked |= frames
        new, swaps = _exchanged(_tracked(clip, marks, request, placed), marks, CLICKS - clicks)
        clicks += swaps
        better = new.n_wrong < shown.n_wrong
        shown, turn = (new, 0) if better else (shown, turn + 1)
    rest = ~shown.table["frame"].isin(clicked)
    before, after = (_share(table[rest.to_numpy()]) for table in (first.table, shown.table))
    return Outcome(int((shown.table["state"] == "free").sum()), before, after, clicks)


def _tracked(clip: MarkedClip, marks: pd.DataFrame, request: ReviewRequest, placed: tuple[Place, ...] = ()) -> Shown:
    video = open_video(clip.path)
    try:
        tracks = tuple(followed(video, request, request.track_options))
        for place in placed:
            tracks = corrected(tracks, place)
    except IrisError:
        tracks = ()
    return _seen(tracks, marks, Shown(request, tracks, marks, placed, (video.width, video.height)))


def _seen(tracks: tuple[Track, ...], marks: pd.DataFrame, before: Shown) -> Shown:
    """Tracks as a person sees them; ``before`` has the request."""
    questions = [one for one in questions_of(tracks, image_size=before.size) if not one.doubts]
    parts = []
    left = list(tracks)
    for name, rows in marks.groupby("body"):
        compared = [_compared(track, rows, before.size[0]) for track in left]
        compared = compared or [_compared(None, rows, before.size[0])]
        best = min(range(len(compared)), key=lambda k: compared[k]["wrong"].sum())
        table = compared[best]
        body = left.pop(best).body if left else ""
        held = [(one.first, one.last) for one in questions if one.body == body]
        table["asked"] = [any(low <= frame <= high for low, high in held) for frame in table["frame"]]
        parts.append(table.assign(body=str(name), track=body))
    return replace(before, tracks=tracks, table=pd.concat(parts, ignore_index=True))


def _exchanged(shown: Shown, marks: pd.DataFrame, most: int) -> tuple[Shown, int]:
    """The tracks after at most so many exchanges of two of them, each of which helps; and how many these are."""
    for count in range(most):
        tried = [_seen(corrected(shown.tracks, swap), marks, shown) for swap in _swaps(shown)]
        best = min(tried, key=lambda one: one.n_wrong, default=shown)
        if best.n_wrong >= shown.n_wrong:
            return shown, count
        shown = best
    return shown, most


def _swaps(shown: Shown) -> Iterator[Swap]:
    """Exchanges that would put right what is seen in a wrong frame: another track is on the body."""
    frames = {track.body: track.frame for track in shown.tracks}
    for _, own in shown.table[shown.table["state"] == "free"].groupby("body"):
        wrong = own["wrong"].to_numpy()
        for k in np.flatnonzero(wrong):
            first = k - int(np.argmin(wrong[: k + 1][::-1])) if not wrong[: k + 1].all() else -1
            last = k + int(np.argmin(wrong[k:])) - 1 if not wrong[k:].all() else len(wrong) - 1
            begin = own["frame"].iloc[first if first >= 0 else last] + 1  # after the last right mark, or the last wrong
            for other in shown.tracks:
                at = _compared(other, own.iloc[int(k) : int(k) + 1], shown.size[0])
                named = str(own["track"].iloc[k])
                alike = named not in ("", other.body) and np.array_equal(frames[named], other.frame)
                if alike and at["met"].iloc[0]:
                    yield Swap(body=named, other=other.body, frame=int(begin))


def _compared(track: Track | None, rows: pd.DataFrame, width: int) -> pd.DataFrame:
    xy = np.full((len(rows), 2), np.nan) if track is None else at_frames(track, rows["frame"].to_numpy())[0]
    off = np.hypot(*(xy - rows[["x_px", "y_px"]].to_numpy()).T)
    met = off <= np.maximum(rows["radius_px"].to_numpy(), MIN_PX * width / OF_WIDTH)
    free, out = (rows["state"].to_numpy() == state for state in ("free", "out"))
    return rows.assign(x=xy[:, 0], y=xy[:, 1], met=met, wrong=(free & ~met) | (out & np.isfinite(xy[:, 0])))


def _looked_at(table: pd.DataFrame, clicked: set[int]) -> pd.Series | None:
    """The wrong mark that a person looks at next: one that is asked about, else the middle one of the others."""
    wrong = table[table["wrong"] & (table["state"] == "free") & ~table["frame"].isin(clicked)]
    if wrong.empty:
        wrong = table[table["wrong"] & np.isfinite(table["x"]) & ~table["frame"].isin(clicked)]
    if wrong.empty:
        return None
    asked = wrong[wrong["asked"]]
    rows = wrong if asked.empty else asked
    return rows.iloc[len(rows) // 2]


def _rests(shown: Shown, row: pd.Series) -> Place | None:
    """The point of a body at rest: not found here, and marked at the same place in a frame beside, not found there."""
    if row["state"] != "free" or np.isfinite(row["x"]) or not row["track"]:
        return None
    own = shown.table[(shown.table["body"] == row["body"]) & (shown.table["state"] == "free")].reset_index(drop=True)
    at = int(np.flatnonzero(own["frame"] == row["frame"])[0])
    beside = own.iloc[[k for k in (at - 1, at + 1) if 0 <= k < len(own)]]
    off = np.hypot(beside["x_px"] - row["x_px"], beside["y_px"] - row["y_px"])
    if not ((off < row["radius_px"] / 2) & ~np.isfinite(beside["x"])).any():
        return None
    frame = int(row["frame"])
    return Place(body=str(row["track"]), frame=frame, x=float(row["x_px"]), y=float(row["y_px"]), at_rest=True)


def _clicked(shown: Shown, row: pd.Series, marks: pd.DataFrame, show: bool) -> tuple[ReviewRequest, int, set[int]]:
    """The request after a click, how many clicks it took, and the frames clicked."""
    request = shown.request
    if (not show or row["state"] != "free") and np.isfinite(row["x"]):
        ignored = (*request.ignored, TrackMark("", float(row["x"]), float(row["y"]), int(row["frame"])))
        return replace(request, ignored=ignored), 1, {int(row["frame"])}
    named = str(row["track"] or row["body"])
    new = [TrackMark(named, float(row["x_px"]), float(row["y_px"]), int(row["frame"]))]
    tracking = marked_all(replace(request.tracking, marks=(*request.tracking.marks, *new)), shown.tracks)
    there = {mark.body for mark in tracking.marks}
    free = marks[marks["state"] == "free"].astype({"body": str})
    for body, rows in free.groupby("body") if len(there) < request.tracking.bodies else ():
        if body not in there:  # without a track to take a mark from
            nearest = rows.iloc[int(np.argmin(np.abs(rows["frame"].to_numpy() - row["frame"])))]
            new.append(TrackMark(str(body), float(nearest["x_px"]), float(nearest["y_px"]), int(nearest["frame"])))
    tracking = replace(tracking, marks=tuple(dict.fromkeys([*tracking.marks, *new])))
    return replace(request, tracking=tracking), len(new), {mark.frame for mark in new}


def _share(table: pd.DataFrame) -> float:
    free = table[table["state"] == "free"]
    return float(free["met"].mean()) if len(free) else 1.0


def lines(split: str, only: str, first: int | None = None) -> Iterator[str]:
    """A row a clip, then the sums."""
    rows = []
    for clip in marked_clips(split, only, first):
        if clip.expect != "follow":
            continue
        one = reviewed(clip)
        rows.append(one)
        yield f"{clip.name:<24} {one.usable:>3} usable {one.before:>6.0%} {one.after:>6.0%} {one.clicks} clicks"
    before, after = (sum(getattr(row, when) >= MIN_ON_BODY for row in rows) for when in ("before", "after"))
    yield f"of {len(rows)} clips {before} met {MIN_ON_BODY:.0%} of the usable marks without a click, {after} with"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", default="open", choices=("open", "sealed"))
    parser.add_argument("--only", default="", help="clips whose name contains this")
    parser.add_argument("--first", type=int, help="so many clips, in the order of the SHA-256 of their names")
    arguments = parser.parse_args()
    for line in lines(arguments.split, arguments.only, arguments.first):
        print(line, flush=True)
