"""Degrade clips: noise, fewer pixels, fewer frames, stronger compression."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Track
from iris_sysid.video.reader import Video, open_video

SIZE = (100, 56)  # px; width and height of the images that the latent pipeline is given
TICK = Fraction(1, 90_000)  # s; time resolution of the changed file, at most 6 microseconds off the original times


@dataclass(frozen=True, slots=True)
class Change:
    """One degradation of a clip.

    ``noise_grey``: standard deviation of the noise added to each channel. ``shrink``: divide each side by this;
    ``size``: resize to this width and height. ``every``: keep only each n-th frame. ``dropped``: fraction of frames
    left out at random, times kept. ``crf``: x264's constant rate factor (23 is usual, 51 the worst); None for lossless.
    """

    noise_grey: float = 0.0
    shrink: int = 1
    size: tuple[int, int] | None = None
    every: int = 1
    dropped: float = 0.0
    crf: int | None = None


CHANGES: Mapping[str, Change] = {
    "as it is": Change(),
    "noise 5 grey levels": Change(noise_grey=5.0),
    "noise 15 grey levels": Change(noise_grey=15.0),
    "sides / 2": Change(shrink=2),
    "sides / 4": Change(shrink=4),
    "100x56 px": Change(size=SIZE),
    "every 2nd frame": Change(every=2),
    "every 6th frame": Change(every=6),
    "10 % of frames dropped": Change(dropped=0.1),
    "30 % of frames dropped": Change(dropped=0.3),
    "crf 35": Change(crf=35),
    "crf 45": Change(crf=45),
}


@contextmanager
def changed(clip: str | Path, change: Change, seed: int = 0) -> Iterator[Video]:
    """The clip after a change, in a temporary file that is deleted when the block ends.

    Parameters
    ----------
    clip
        Video file.
    change
        The degradation.
    seed
        Of noise and dropped frames.
    """
    video = open_video(clip)
    with tempfile.TemporaryDirectory() as folder:
        if change == Change():
            yield video
        else:
            path = Path(folder) / "clip.mp4"
            _write(video, path, change, np.random.default_rng(seed))
            yield open_video(path)


def _write(video: Video, path: Path, change: Change, rng: np.random.Generator) -> None:
    width, height = change.size or (video.width // change.shrink // 2 * 2, video.height // change.shrink // 2 * 2)
    with av.open(str(path), "w", format="mp4") as container:
        quality = {"qp": "0"} if change.crf is None else {"crf": str(change.crf)}
        stream = container.add_stream("libx264", options={"preset": "superfast", "bf": "0", **quality})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.codec_context.time_base = TICK
        stream.codec_context.thread_count = 1
        for frame in video.frames():
            dropped = rng.random() < change.dropped and frame.index > 0
            if frame.index % change.every or dropped:
                continue
            image = _degraded(frame.bgr(), (width, height), change.noise_grey, rng)
            encoded = av.VideoFrame.from_ndarray(image, format="bgr24")
            encoded.pts, encoded.time_base = round(Fraction(frame.t_s) / TICK), TICK
            container.mux(stream.encode(encoded))
        container.mux(stream.encode())


def _degraded(
    bgr: NDArray[np.uint8], size: tuple[int, int], noise_grey: float, rng: np.random.Generator
) -> NDArray[np.uint8]:
    if (bgr.shape[1], bgr.shape[0]) != size:
        bgr = np.asarray(cv2.resize(bgr, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    if noise_grey > 0:
        noise = noise_grey * rng.standard_normal(bgr.shape, dtype=np.float32)
        bgr = np.clip(np.rint(bgr + noise), 0, 255).astype(np.uint8)
    return np.ascontiguousarray(bgr)


def as_in(video: Video, tracks: list[Track], size: tuple[int, int]) -> list[Track]:
    """Tracks of a resized clip in the pixels of the original clip, whose width and height are ``size``."""
    scale = np.array([size[0] / video.width, size[1] / video.height])
    mean = float(np.sqrt(scale[0] * scale[1]))
    return [
        replace(
            track,
            xy_px=(track.xy_px + 0.5) * scale - 0.5,  # pixel centres: the corner of the image is at -0.5
            sigma_px=track.sigma_px * scale,
            radius_px=None if track.radius_px is None else track.radius_px * mean,
            sigma_radius_px=None if track.sigma_radius_px is None else track.sigma_radius_px * mean,
            area_px=None if track.area_px is None else track.area_px * mean**2,
        )
        for track in tracks
    ]
