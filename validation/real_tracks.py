"""Every real clip tracked with default options: frames tracked of those that show the bodies.

``python -m validation.real_tracks [--sheets FOLDER]`` needs the recordings in ``../shared/data``. With ``--sheets`` it
writes a contact sheet of each clip with the tracks drawn in, for inspection.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import IrisError
from iris_sysid.registry import TRACKERS
from iris_sysid.report.overlay import draw_body
from iris_sysid.types import Track, TrackOptions
from iris_sysid.video.reader import Video, open_video
from validation import pages

DATA = Path("..") / "shared" / "data"
COLUMNS, ROWS, WIDTH = 4, 6, 480  # images of a contact sheet, and their width in px
COLOURS = ((60, 220, 60), (60, 60, 240), (240, 160, 40))


@dataclass(frozen=True)
class Clip:
    """A clip, its bodies, and the frames (inclusive) between which each is wholly in view and not held."""

    path: str
    bodies: int
    usable: tuple[tuple[int, int], ...]


CLIPS = [
    Clip("iris_footage/pendulum.gif", 1, ((3, 39),)),
    Clip("iris_footage/Sliding_cone.gif", 1, ((14, 42),)),
    Clip("iris_footage/Two_Moving_Pendulums.gif", 2, ((11, 54), (11, 54))),
    Clip("juangomez_pendulum/pendulum.mp4", 1, ((0, 304),)),
    Clip("phystrack/Projectile_Motion__30Deg_2_726mps.MP4", 1, ((287, 518),)),
    Clip("phystrack/Projectile_Motion__60Deg_2_699mps.MP4", 1, ((201, 578),)),
    Clip("phystrack/SlidingFriction_R1.MP4", 1, ((109, 394),)),
    Clip("phystrack/SlidingFriction_R3.MP4", 1, ((82, 275),)),
    Clip("phystrack/CaromPuck_HeadOn.MP4", 2, ((0, 751), (0, 276))),
    Clip("tracker_balltoss/BallToss.trz", 1, ((2, 12),)),
]


def row(clip: Clip, sheets: Path | None) -> str:
    """Track one clip and format its row of the table."""
    try:
        tracks = TRACKERS["median-background"].track(_opened(clip), TrackOptions(bodies=clip.bodies))
    except IrisError as error:
        return f"| {clip.path} | {clip.bodies} | | failed: {error} |"
    if sheets is not None:
        sheets.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(sheets / f"{clip.path.replace('/', '_')}.png"), sheet(clip, tracks))
    valid = []
    for track, (first, last) in zip(tracks, clip.usable, strict=True):
        usable = (track.frame >= first) & (track.frame <= last)
        valid.append(f"{int((track.valid & usable).sum())} of {int(usable.sum())}")
    return f"| {clip.path} | {clip.bodies} | {len(tracks[0].t_s)} | {'; '.join(valid)} |"


def _opened(clip: Clip) -> Video:
    return open_video(DATA / clip.path)


def sheet(clip: Clip, tracks: Sequence[Track]) -> NDArray[np.uint8]:
    """Contact sheet of frames from the whole clip, with the bodies and their recent paths."""
    times = tracks[0].t_s
    chosen = {int(k) for k in np.linspace(0, len(times) - 1, COLUMNS * ROWS)}
    pictures = []
    for index, frame in enumerate(_opened(clip).frames()):
        if index in chosen:
            image = np.ascontiguousarray(frame.bgr())
            for track, colour in zip(tracks, COLOURS, strict=False):
                draw_body(image, track, frame.t_s, colour)
            image = cv2.resize(image, (WIDTH, round(WIDTH * image.shape[0] / image.shape[1])))
            cv2.putText(image, str(frame.index), (6, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 0, 255), 2)
            pictures.append(image)
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % COLUMNS)
    rows = [np.hstack(pictures[k : k + COLUMNS]) for k in range(0, len(pictures), COLUMNS)]
    return np.vstack(rows)


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sheets", type=Path, help="folder for contact sheets")
    parser.add_argument("--only", default="", help="only clips whose name contains this")
    pages.add_option(parser)
    options = parser.parse_args()
    with pages.table("real-tracks", options.write_docs):
        print("| clip | bodies | frames | tracked of usable frames |\n|---|---|---|---|")
        for clip in CLIPS:
            if options.only in clip.path:
                print(row(clip, options.sheets), flush=True)


if __name__ == "__main__":
    main()
