"""How many of the wrong frames a review asks about, on real clips with marks made by eye.

``python -m validation.review_questions`` prints a row a clip of the open split: the marked frames, those in which the
track misses the body or is elsewhere, those of these that a question holds, the share of all frames that questions
hold, and their number. A track that is doubted as a whole is asked about in all of its frames, a stretch a question.
``--sealed`` scores the clips that the questions were not made on.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from iris_sysid.errors import IrisError
from iris_sysid.pipeline import track
from iris_sysid.review.doubtful_frames import FrameQuestion, questions_of
from iris_sysid.types import Track, TrackOptions
from iris_sysid.video.reader import open_video
from validation.real_marks import MIN_PX, OF_WIDTH, MarkedClip, at_frames, marked_clips


@dataclass(frozen=True, slots=True)
class Asked:
    """Counts of one clip: marks, wrong ones, those in a question, those in one that names frames of its own.

    ``whole`` says that a track is doubted as a whole; ``share`` of the frames that questions hold; their number.
    """

    marks: int
    wrong: int
    asked: int
    named: int
    whole: bool
    share: float
    questions: int


def measured(clip: MarkedClip) -> Asked:
    """Track one clip, and compare the questions with the marks."""
    video, marks = open_video(clip.path), clip.marks()
    tracks = track(video, options=TrackOptions(bodies=clip.bodies))
    questions = questions_of(tracks, image_size=(video.width, video.height))
    named = [question for question in questions if not question.doubts]
    whole = any(body.quality is not None and body.quality.doubtful for body in tracks)
    tables = [rows for _, rows in marks.groupby("body")]
    wrong = [[_wrong(body, rows, video.width) for body in tracks] for rows in tables]
    taken = linear_sum_assignment([[row.sum() for row in of_body] for of_body in wrong])
    pairs = [(tables[k], wrong[k][j], tracks[j].body) for k, j in zip(*taken, strict=True)]
    held, of_named = (
        sum(int(_held(rows["frame"].to_numpy()[bad], name, some).sum()) for rows, bad, name in pairs)
        for some in (questions, named)
    )
    covered = [_held(body.frame, body.body, questions).mean() for body in tracks]
    return Asked(
        sum(len(rows) for rows, _, _ in pairs),
        int(sum(bad.sum() for _, bad, _ in pairs)),
        held,
        of_named,
        whole,
        float(np.mean(covered)),
        len(questions),
    )


def _wrong(body: Track, rows, width: int):
    """Of each mark (n,), whether the track misses the free body, is elsewhere, or shows one that is out of view."""
    xy_px, _ = at_frames(body, rows["frame"].to_numpy())
    off_px = np.hypot(*(xy_px - rows[["x_px", "y_px"]].to_numpy()).T)
    met = off_px <= np.maximum(rows["radius_px"].to_numpy(), MIN_PX * width / OF_WIDTH)
    free, out = (rows["state"].to_numpy() == state for state in ("free", "out"))
    return (free & ~met) | (out & np.isfinite(xy_px[:, 0]))


def _held(frames, body: str, questions: Sequence[FrameQuestion]):
    """Of each frame (n,), whether a question about that body holds it."""
    own = [(one.first, one.last) for one in questions if one.body == body]
    return np.array([any(first <= frame <= last for first, last in own) for frame in frames], dtype=bool)


def lines(only: str, split: str = "open") -> Iterator[str]:
    """A row a clip, then the sums."""
    rows = []
    for clip in marked_clips(split, only):
        try:
            rows.append(measured(clip))
        except IrisError as error:
            yield f"{clip.name:<28} refused: {error}"
            continue
        one = rows[-1]
        whole = "  doubted as a whole" if one.whole else ""
        yield (
            f"{clip.name:<28} {one.marks:>4} marks {one.wrong:>4} wrong {one.asked:>4} asked {one.share:>6.1%} "
            f"{one.questions:>3} questions{whole}"
        )
    wrong, asked, named = (sum(getattr(one, name) for one in rows) for name in ("wrong", "asked", "named"))
    share, questions = np.mean([one.share for one in rows]), np.mean([one.questions for one in rows])
    right = [one for one in rows if not one.wrong]
    spared = np.mean([one.share for one in right]) if right else np.nan
    yield (
        f"of {wrong} wrong marks {asked} lie in a question, {named} of them in one that names frames of its own; "
        f"questions hold {share:.0%} of the frames, {spared:.0%} where no mark is wrong, {questions:.1f} a clip"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="clips whose name contains this")
    parser.add_argument("--sealed", action="store_true", help="the clips that the questions were not made on")
    options = parser.parse_args()
    for line in lines(options.only, "sealed" if options.sealed else "open"):
        print(line, flush=True)
