"""All candidates of the tracker auto as one picture: frames with the tracks, and the evidence beside them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.files import write_atomic
from iris_sysid.report.overlay import BODY_COLOURS, draw_body
from iris_sysid.types import Frame, FrameSource, TrackCandidate

FRAMES, WIDTH, TEXT_WIDTH, LINE = 6, 300, 420, 17  # frames a candidate; px
FONT, SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.42
INK, GOOD, BAD = (40, 40, 40), (60, 130, 30), (30, 30, 190)  # BGR
MAX_LETTERS = 58  # letters a line

Picture = NDArray[np.uint8]


def write_candidates(
    video: FrameSource, candidates: Sequence[TrackCandidate], path: str | Path, *, overwrite: bool = False
) -> Path:
    """Draw one row for each candidate: the evidence for and against it, then frames of the clip with its tracks.

    Parameters
    ----------
    video
        The clip.
    candidates
        What the tracker tried, in order.
    path
        A ``.png`` file.
    overwrite
        Replace a file of that name.

    Raises
    ------
    OutputError
        When the file exists, or cannot be written.
    """
    frames = video.sample(FRAMES)
    rows = [_row(candidate, frames) for candidate in candidates]
    _, encoded = cv2.imencode(".png", np.vstack(rows))
    return write_atomic(Path(path), encoded.tobytes(), overwrite=overwrite)


def _row(candidate: TrackCandidate, frames: Sequence[Frame]) -> Picture:
    """One candidate: its evidence, and frames (h, w, 3) side by side."""
    pictures = [_picture(candidate, frame) for frame in frames]
    height = max(pictures[0].shape[0], LINE * (len(_lines(candidate)) + 2))
    text = _text(candidate, height)
    blank = [np.full((height - pictures[0].shape[0], WIDTH, 3), 255, np.uint8)] * len(pictures)
    columns = [np.vstack([picture, below]) for picture, below in zip(pictures, blank, strict=True)]
    row = np.hstack([text, *columns])
    row[-1] = 200
    return np.asarray(row, dtype=np.uint8)


def _picture(candidate: TrackCandidate, frame: Frame) -> Picture:
    """One frame with the tracks, at the width of the sheet."""
    image = np.ascontiguousarray(frame.bgr())
    for k, track in enumerate(candidate.tracks):
        draw_body(image, track, frame.t_s, BODY_COLOURS[k % len(BODY_COLOURS)])
    size = (WIDTH, max(1, round(WIDTH * image.shape[0] / image.shape[1])))
    image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    cv2.putText(image, str(frame.index), (5, 14), FONT, SIZE, (255, 0, 255), 1, cv2.LINE_AA)
    return image


def _text(candidate: TrackCandidate, height: int) -> Picture:
    """The name of a candidate and its evidence, on white."""
    canvas = np.full((height, TEXT_WIDTH, 3), 255, np.uint8)
    taken = "  (taken)" if candidate.chosen else ""
    cv2.putText(canvas, candidate.name + taken, (6, LINE), FONT, 1.3 * SIZE, INK, 1, cv2.LINE_AA)
    for k, (line, colour) in enumerate(_lines(candidate), start=2):
        cv2.putText(canvas, line, (6, LINE * k), FONT, SIZE, colour, 1, cv2.LINE_AA)
    return canvas


def _lines(candidate: TrackCandidate) -> list[tuple[str, tuple[int, int, int]]]:
    """The lines of text of a candidate, each with its colour."""
    if not candidate.tracks:
        return [(line, BAD) for line in _wrapped(f"no track: {candidate.refusal}")]
    lines: list[tuple[str, tuple[int, int, int]]] = []
    for track in candidate.tracks:
        doubtful = track.quality is not None and track.quality.doubtful
        word, colour = ("doubtful", BAD) if doubtful else ("good", GOOD)
        lines.append((f"body {track.body}: {word}, {track.n_valid} of {track.valid.size} frames", colour))
        if track.quality is not None:
            stated = ", ".join(f"{name} {value:.3g}" for name, value in track.quality.evidence.items())
            lines += [(line, INK) for line in _wrapped(stated)]
            lines += [(line, BAD) for doubt in track.quality.doubts for line in _wrapped(f"- {doubt.finding}")]
    return lines


def _wrapped(text: str) -> list[str]:
    """The text in lines that fit."""
    lines = [""]
    for word in text.split():
        if len(lines[-1]) + len(word) > MAX_LETTERS:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines
