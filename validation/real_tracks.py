"""Every real clip tracked with no option but the number of bodies, against marks made by eye.

``python -m validation.real_tracks [--split open] [--sheets FOLDER]`` needs the recordings in ``../shared/data``. Each
clip runs in a separate process and ``--seconds`` of processor time. With ``--sheets`` it writes a contact sheet of each
clip with the tracks and the marks drawn in. With ``--clicks 2`` a person who looks at the overlay is simulated: as long
as bodies are not followed, the person shows them in a marked frame in which they are wrong (``--mark``, a click a body,
in the middle one of those frames), and they are tracked again. Marks that were clicked on do not count in the score.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import signal
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from iris_sysid.errors import IrisError
from iris_sysid.pipeline.one_clip import track
from iris_sysid.report.overlay import draw_body
from iris_sysid.types import Frame, FrameSource, Track, TrackMark, TrackOptions
from iris_sysid.video.reader import open_video
from validation import pages
from validation.real_marks import MarkedClip, Score, marked_clips, missed, score

COLUMNS, ROWS, WIDTH = 5, 5, 400  # images of a contact sheet, and their width in px
COLOURS = ((60, 220, 60), (60, 60, 240), (240, 160, 40))
MARK_COLOUR = (255, 0, 255)
HEADER = """| clip | split | bodies | on the body | missing | elsewhere | out of view | result | verdict | s | fps |
|---|---|---:|---:|---:|---:|---:|---|---|---:|---:|"""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of a clip: ``verdict`` is good, doubtful or refused, ``reason`` says why it is not good.

    ``score`` is None where there is no track; ``seconds`` of processor time and ``frames`` are those of tracking;
    ``clicks`` were made before, ``more`` are what a person would show who sees it.
    """

    clip: MarkedClip
    verdict: str
    reason: str = ""
    score: Score | None = None
    frames: int = 0
    seconds: float = 0.0
    clicks: tuple[TrackMark, ...] = ()
    more: tuple[TrackMark, ...] = ()

    @property
    def followed(self) -> bool:
        """Whether the track is on the body."""
        return self.score is not None and self.score.followed

    @property
    def wrong(self) -> bool:
        """Whether the track is of something else and nothing says so."""
        return self.verdict == "good" and self.score is not None and self.score.wrong


def outcome(clip: MarkedClip, sheets: Path | None = None, made: tuple[TrackMark, ...] = ()) -> Outcome:
    """Track one clip in this process, with some clicks; a clip that is refused is an outcome as well."""
    began, marks = time.process_time(), clip.marks()
    known = {(mark.frame, mark.body) for mark in made}
    counted = np.array([(row.frame, str(row.body)) not in known for row in marks.itertuples()])
    try:
        video = open_video(clip.path)
        tracks = track(video, options=TrackOptions(bodies=clip.bodies, marks=made))
    except IrisError as error:
        nothing = shown(counted & missed((), marks, 0), marks)
        return Outcome(clip, "refused", str(error), seconds=time.process_time() - began, clicks=made, more=nothing)
    seconds = time.process_time() - began
    if sheets is not None:
        sheets.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(sheets / f"{clip.name}.jpg"), sheet(video, tracks, marks))
    doubts = dict.fromkeys(doubt.text for body in tracks if body.quality for doubt in body.quality.doubts)
    return Outcome(
        clip,
        "doubtful" if doubts else "good",
        "; ".join(doubts),
        score(tracks, marks[counted], video.width),
        len(tracks[0].t_s),
        seconds,
        made,
        shown(counted & missed(tracks, marks, video.width), marks),
    )


def shown(wrong: NDArray[np.bool_], marks: pd.DataFrame) -> tuple[TrackMark, ...]:
    """What a person shows who sees that the marks (n,) ``wrong`` are missed: all free bodies in the middle frame."""
    frames = np.unique(marks.loc[wrong, "frame"])
    if not len(frames):
        return ()
    here = marks[(marks["frame"] == frames[len(frames) // 2]) & (marks["state"] == "free")]
    return tuple(TrackMark(str(row.body), row.x_px, row.y_px, row.frame) for row in here.itertuples())


def outcomes(clip: MarkedClip, sheets: Path | None, clicks: int, seconds: int) -> list[Outcome]:
    """What becomes of a clip by itself, then after each frame in which a person shows its bodies."""
    found = [within(clip, sheets, (), seconds)]
    while clip.expect == "follow" and not found[-1].followed:
        made = (*found[-1].clicks, *found[-1].more)
        if not found[-1].more or len(made) > clicks:
            break
        found.append(within(clip, sheets, made, seconds))
    return found


def within(clip: MarkedClip, sheets: Path | None, made: tuple[TrackMark, ...], seconds: int) -> Outcome:
    """The outcome of a clip from a separate process, which may take so many seconds of processor time."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = multiprocessing.get_context("spawn").Process(target=_send, args=(clip, sheets, made, seconds, sender))
    process.start()
    sender.close()
    try:
        result: Outcome = receiver.recv()
    except EOFError:
        process.join()
        late = process.exitcode == -signal.SIGXCPU
        result = Outcome(
            clip, "refused", f"not done in {seconds} s" if late else "the program stopped", seconds=seconds
        )
    process.join()
    return result


def _send(clip: MarkedClip, sheets: Path | None, made: tuple[TrackMark, ...], seconds: int, pipe: Connection) -> None:
    warnings.simplefilter("ignore")
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    pipe.send(outcome(clip, sheets, made))


def sheet(video: FrameSource, tracks: Sequence[Track], marks: pd.DataFrame) -> NDArray[np.uint8]:
    """Contact sheet of the marked frames and of others evenly spread: bodies, their recent paths, and the marks."""
    chosen = set(marks["frame"])
    spread = np.linspace(0, len(tracks[0].frame) - 1, max(COLUMNS * ROWS - len(chosen), 0)).astype(int)
    chosen.update(tracks[0].frame[spread])
    frames = (frame for frame in video.frames() if frame.index in chosen)
    pictures = [_picture(frame, tracks, marks[marks["frame"] == frame.index]) for frame in frames]
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % COLUMNS)
    rows = [np.hstack(pictures[k : k + COLUMNS]) for k in range(0, len(pictures), COLUMNS)]
    return np.vstack(rows)


def _picture(frame: Frame, tracks: Sequence[Track], marks: pd.DataFrame) -> NDArray[np.uint8]:
    image = np.ascontiguousarray(frame.bgr())
    for body, colour in zip(tracks, COLOURS, strict=False):
        draw_body(image, body, frame.t_s, colour)
    for x, y, radius in np.round(marks.loc[marks["state"] != "out", ["x_px", "y_px", "radius_px"]].to_numpy()):
        cv2.circle(image, (int(x), int(y)), int(radius), MARK_COLOUR, max(1, round(image.shape[1] / WIDTH)))
    height = round(WIDTH * image.shape[0] / image.shape[1])
    small: NDArray[np.uint8] = np.asarray(cv2.resize(image, (WIDTH, height)), dtype=np.uint8)
    cv2.putText(small, str(frame.index), (6, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.8, MARK_COLOUR, 2)
    return small


def row(result: Outcome) -> str:
    """One row of the table."""
    clip, counts, clicks = result.clip, result.score, len(result.clicks)
    shares = ["", "", "", ""]
    if counts is not None and counts.free:
        parts = (counts.on_body, counts.missing, counts.elsewhere)
        shares = [*(f"{100 * part / counts.free:.0f} %" for part in parts), ""]
    if counts is not None and counts.absent:
        shares[3] = f"{counts.tracked_absent} of {counts.absent}"
    rate = f"{result.frames / result.seconds:.0f}" if result.frames else ""
    verdict = result.verdict + (f": {result.reason.replace('|', '/')}" if result.reason else "")
    what = f"{'' if result.followed else 'not '}followed" + (f", {clicks} click{'s' * (clicks > 1)}" if clicks else "")
    if clip.expect == "refuse":
        what = "no free body"
    cells = (clip.name, clip.split, str(clip.bodies), *shares, what, verdict, f"{result.seconds:.1f}", rate)
    return f"| {' | '.join(cells)} |"


def totals(first: Sequence[Outcome], last: Sequence[Outcome], clicks: int) -> Iterator[str]:
    """The sums that count: clips followed, wrong tracks that nothing warns of, and clips refused or doubtful.

    Parameters
    ----------
    first, last
        What became of some clips by themselves, and after the clicks.
    clicks
        How many a person might make.
    """
    free = [result for result in first if result.clip.expect == "follow"]
    doubted = [result for result in free if result.verdict != "good"]
    wrong = ", ".join(result.clip.name for result in first if result.wrong)
    yield (
        f"followed {_followed(free)} of {len(free)}; wrong without a warning: {wrong or 'none'}; "
        f"refused or doubtful {len(doubted)}, of these followed {_followed(doubted)}"
    )
    yield from (
        f"{result.clip.name}, without a free body: {'wrong' if result.wrong else 'right'}"
        for result in first
        if result.clip.expect == "refuse"
    )
    if clicks:
        yield f"followed with at most {clicks} clicks {_followed(last)}"


def _followed(results: Sequence[Outcome]) -> int:
    return sum(result.followed for result in results)


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--split", choices=("open", "sealed"), default="", help="only clips of this split")
    parser.add_argument("--seconds", type=int, default=300, help="processor time that a clip may take")
    parser.add_argument("--sheets", type=Path, help="folder for contact sheets")
    parser.add_argument("--clicks", type=int, default=0, help="that a simulated person may make on a clip")
    parser.add_argument("--workers", type=int, default=1, help="clips at a time")
    parser.add_argument("--only", default="", help="only clips whose name contains this")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("real-tracks", options.write_docs):
        print(HEADER)
        first, last = [], []
        each = partial(outcomes, sheets=options.sheets, clicks=options.clicks, seconds=options.seconds)
        with ThreadPoolExecutor(options.workers) as pool:
            for found in pool.map(each, marked_clips(options.split, options.only)):
                print("\n".join(map(row, found)), flush=True)
                first.append(found[0])
                last.append(found[-1])
        print()
        for split in dict.fromkeys(result.clip.split for result in first):
            found = [each for each in zip(first, last, strict=True) if each[0].clip.split == split]
            print(f"{split}: {'; '.join(totals(*zip(*found, strict=True), options.clicks))}.\n")


if __name__ == "__main__":
    main()
