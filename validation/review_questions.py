"""How many of the wrong frames a review asks about, on real clips with marks made by eye.

``python -m validation.review_questions`` prints a row a clip of the open split: the marked frames, those in which the
track misses the body or is elsewhere, those of these that a question holds, the share of all frames that questions
hold, and their number; then a table of what the first questions of each clip hold. A track that is doubted as a whole
is asked about in all of its frames, a stretch a question. ``--sealed`` scores the clips that the questions were not
made on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from iris_sysid.errors import IrisError
from iris_sysid.pipeline.one_clip import track
from iris_sysid.review.doubtful_frames import FrameQuestion, questions_of
from iris_sysid.types import Mask, Track, TrackOptions
from iris_sysid.video.reader import open_video
from validation.real_marks import MIN_PX, OF_WIDTH, MarkedClip, at_frames, marked_clips

FIRST = (1, 2, 3, 5, 10)  # questions of a clip


@dataclass(frozen=True, slots=True)
class Asked:
    """One clip: its marks, those that are wrong, and its questions.

    ``held`` and ``share``: the wrong marks, and the share of all frames, in the first questions, one value a number of
    questions, 0 first.
    """

    marks: int
    wrong: int
    held: tuple[int, ...]
    share: tuple[float, ...]

    @property
    def questions(self) -> int:
        """Number of questions."""
        return len(self.held) - 1

    def first(self, number: int) -> tuple[int, float]:
        """The wrong marks and the share of the frames in so many questions."""
        return self.held[min(number, self.questions)], self.share[min(number, self.questions)]


def measured(clip: MarkedClip) -> Asked:
    """Track one clip, and compare the questions with the marks."""
    video = open_video(clip.path)
    tracks = track(video, options=TrackOptions(bodies=clip.bodies))
    return asked_of(tracks, clip.marks(), (video.width, video.height))


def asked_of(tracks: Sequence[Track], marks: pd.DataFrame, size: tuple[int, int]) -> Asked:
    """What questions about some tracks in images of a size, px, are worth against the marks of their clip."""
    pairs = list(on_bodies(tracks, marks, size[0]))
    questions = questions_of(tracks, image_size=size)
    firsts = [questions[:number] for number in range(len(questions) + 1)]
    held = [
        sum(int(_held(rows["frame"].to_numpy()[wrong], body.body, some).sum()) for body, rows, wrong in pairs)
        for some in firsts
    ]
    share = [float(np.mean([_held(body.frame, body.body, some).mean() for body in tracks])) for some in firsts]
    return Asked(
        sum(len(rows) for _, rows, _ in pairs),
        int(sum(wrong.sum() for _, _, wrong in pairs)),
        tuple(held),
        tuple(share),
    )


def on_bodies(tracks: Sequence[Track], marks: pd.DataFrame, width: int) -> Iterator[tuple[Track, pd.DataFrame, Mask]]:
    """Each track with the marks of the body that it follows in an image of a width, px, and where it is wrong."""
    tables = [rows for _, rows in marks.groupby("body")]
    wrong = [[_wrong(body, rows, width) for body in tracks] for rows in tables]
    for table, body in zip(*linear_sum_assignment([[row.sum() for row in of_body] for of_body in wrong]), strict=True):
        yield tracks[body], tables[table], wrong[table][body]


def _wrong(body: Track, rows: pd.DataFrame, width: int) -> Mask:
    """Of each mark (n,), whether the track misses the free body, is elsewhere, or shows one that is out of view."""
    xy_px, _ = at_frames(body, rows["frame"].to_numpy())
    off_px = np.hypot(*(xy_px - rows[["x_px", "y_px"]].to_numpy()).T)
    met = off_px <= np.maximum(rows["radius_px"].to_numpy(), MIN_PX * width / OF_WIDTH)
    free, out = (rows["state"].to_numpy() == state for state in ("free", "out"))
    return np.asarray((free & ~met) | (out & np.isfinite(xy_px[:, 0])))


def _held(frames: NDArray[np.int64], body: str, questions: Sequence[FrameQuestion]) -> Mask:
    """Of each frame (n,), whether a question about that body holds it."""
    own = [(one.first, one.last) for one in questions if one.body == body]
    return np.array([any(first <= frame <= last for first, last in own) for frame in frames], dtype=bool)


def lines(only: str, split: str = "open", first: int | None = None) -> Iterator[str]:
    """A row a clip, then a table of the first questions of all."""
    rows = []
    for clip in marked_clips(split, only, first):
        try:
            rows.append(measured(clip))
        except IrisError as error:
            yield f"{clip.name:<28} refused: {error}"
            continue
        one = rows[-1]
        held, share = one.first(one.questions)
        yield (
            f"{clip.name:<28} {one.marks:>4} marks {one.wrong:>4} wrong {held:>4} asked {share:>6.1%} "
            f"{one.questions:>3} questions"
        )
    yield from summary(rows)


def summary(rows: Sequence[Asked]) -> Iterator[str]:
    """What the first questions of each clip hold."""
    wrong, right = sum(one.wrong for one in rows), [one for one in rows if not one.wrong]
    yield f"{len(rows)} clips, {wrong} of {sum(one.marks for one in rows)} marks wrong"
    yield "| questions a clip | wrong frames held | frames asked | of clips without a wrong mark |"
    yield "|---:|---:|---:|---:|"
    for number in (*FIRST, max(one.questions for one in rows)):
        held, share = zip(*(one.first(number) for one in rows), strict=True)
        spared = np.mean([one.first(number)[1] for one in right]) if right else np.nan
        yield f"| {number} | {sum(held)} ({sum(held) / max(wrong, 1):.0%}) | {np.mean(share):.0%} | {spared:.0%} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="clips whose name contains this")
    parser.add_argument("--first", type=int, help="so many clips, in the order of the SHA-256 of their names")
    parser.add_argument("--sealed", action="store_true", help="the clips that the questions were not made on")
    options = parser.parse_args()
    for line in lines(options.only, "sealed" if options.sealed else "open", options.first):
        print(line, flush=True)
