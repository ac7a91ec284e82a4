"""The video with the track drawn over it."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.io.files import atomic_path
from iris_sysid.types import FrameSource, Progress, Track, mapped, with_progress

# BGR of the bodies' colours on the pages (Okabe and Ito 2008), without the blue and the vermilion of the models there
BODY_COLOURS = ((115, 158, 0), (167, 121, 204), (0, 159, 230), (233, 180, 86))
TAIL_S = 0.5
FONT = cv2.FONT_HERSHEY_SIMPLEX
TIME_BASE = Fraction(1, 90_000)  # the clock of MPEG transport streams represents every common frame time closely enough


def write_overlay(
    video: FrameSource,
    tracks: Sequence[Track],
    path: Path,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write the clip with a ring around each body and the last half second of its path, at the clip's own times.

    Parameters
    ----------
    video
        The clip that the tracks came from.
    tracks
        One a body, in px.
    path
        An ``.mp4`` file.
    overwrite
        Replace a file of that name.
    progress
        Called with (frames done, frames expected).

    Raises
    ------
    OutputError
        When the file exists, or cannot be written.
    """
    width, height = video.width - video.width % 2, video.height - video.height % 2  # yuv420p needs even sides
    with atomic_path(path, overwrite=overwrite) as unfinished, av.open(str(unfinished), "w", format="mp4") as container:
        # one thread and no look-ahead give the same bytes each time: the choices of the look-ahead vary
        stream = container.add_stream("libx264", options={"crf": "20", "preset": "superfast", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = TIME_BASE
        stream.codec_context.thread_count = 1
        for frame in with_progress(video.frames(), progress, video.n_expected):
            image = np.ascontiguousarray(frame.bgr()[:height, :width])
            for k, body in enumerate(tracks):
                draw_body(image, body, frame.t_s, BODY_COLOURS[k % len(BODY_COLOURS)])
            write_doubts(image, tracks)
            encoded = av.VideoFrame.from_ndarray(image, format="bgr24")
            encoded.pts, encoded.time_base = round(frame.t_s / TIME_BASE), TIME_BASE
            container.mux(stream.encode(encoded))
        container.mux(stream.encode())


def write_doubts(image: NDArray[np.uint8], tracks: Sequence[Track]) -> None:
    """Write into an image (h, w, 3), in place, which tracks are doubtful, and why."""
    size = max(0.4, image.shape[0] / 900)
    doubtful = [body for body in tracks if body.quality is not None and body.quality.doubtful]
    for line, body in enumerate(doubtful, start=1):
        assert body.quality is not None
        kinds = ", ".join(dict.fromkeys(doubt.kind for doubt in body.quality.doubts))
        place = (round(10 * size), round(32 * size * line))
        cv2.putText(image, f"body {body.body} doubtful: {kinds}", place, FONT, size, (0, 0, 230), 2, cv2.LINE_AA)


def draw_body(image: NDArray[np.uint8], body: Track, t_s: float, colour: tuple[int, int, int]) -> None:
    """Draw the ring and tail of one body at a time ``t_s`` into an image, in place, to 1/16 px.

    Parameters
    ----------
    image
        (h, w, 3) uint8 BGR, changed in place.
    body
        Its track; where the camera moves, it is drawn where the image of that time shows it.
    t_s
        The time of the image, s.
    colour
        BGR.
    """
    now = int(np.searchsorted(body.t_s, t_s + 1e-9)) - 1
    xy_px = body.xy_px
    if body.camera_motion is not None:
        xy_px = mapped(body.camera_motion[max(now, 0)], xy_px)  # where this frame shows the places of the path
    tail = xy_px[(body.t_s > t_s - TAIL_S) & (body.t_s <= t_s + 1e-9) & body.valid]
    thick = max(1, round(image.shape[0] / 400))
    if len(tail) > 1:
        cv2.polylines(image, [np.round(tail * 16).astype(np.int32)], False, colour, thick, cv2.LINE_AA, shift=4)
    if now >= 0 and body.valid[now] and abs(body.t_s[now] - t_s) < 1e-6:
        radius = 8.0 if body.radius_px is None or np.isnan(body.radius_px[now]) else 1.3 * body.radius_px[now] + 2
        centre = tuple(int(value) for value in np.round(xy_px[now] * 16))
        cv2.circle(image, centre, round(radius * 16), colour, thick, cv2.LINE_AA, shift=4)
