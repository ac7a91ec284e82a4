"""Faults of a camera or a clock in the frames of real clips, which are encoded again without loss and tracked again.

OpenCV bends the frames; a row of a rolling shutter is read between two frames, by interpolation in time. Points that
the commands of a recording mark in the picture move with it. Nothing of the library's camera effects takes part.
"""

from __future__ import annotations

import itertools
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid import IrisError, Trajectory, VideoError, open_video, read_trajectory
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import FitDocument
from validation import films
from validation.implanted_scores import Hidden

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Timed = tuple[float, Image]  # a moment, s, and the picture (h, w, 3) BGR that is shown after it
Points = Callable[[Array], Array]  # where the points (n, 2) px of a perfect picture are seen

FOCAL_PER_WIDTH = 0.75  # a phone's main camera
CLOCK = Fraction(1, 90_000)  # s, of which the times in the file are multiples
LOST_AT = 0.4  # share of the clip
WAVES = 4  # half cosines of a camera's wander in the clip
CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)


@dataclass(frozen=True, eq=False, slots=True)
class Fault(Hidden):
    """A fault of a camera or a clock: ``size`` is that of a strong one, in the unit of :func:`frames_with`."""

    size: float


def _fault(name: str, size: float, right: str, kinds: str) -> Fault:
    """A fault whose size the library defines in another way."""
    return Fault(name, frozenset(right.split()), frozenset(kinds.split()), "", size)


FAULTS: tuple[Fault, ...] = (
    _fault("camera-tilt", 0.25, "camera-tilt", "reading-of-position"),
    _fault("radial-distortion", 0.3, "radial-distortion", "reading-of-position"),
    _fault("rolling-shutter", 1.0, "rolling-shutter", "reading-of-velocity"),
    _fault("camera-wander", 4.0, "camera-drift", "zero-wander"),
    _fault("dropped-frame", 3.0, "dropped-frame", "clock"),
    _fault("wrong-rate", 0.03, "time-scale", "clock"),
)
NONE = _fault("", 0.0, "", "")


# Geometry -----------------------------------------------------------------------------------------------------------


def camera_matrix(width: int, height: int) -> Array:
    """That of a camera whose axis meets the middle of the picture, px."""
    focal = FOCAL_PER_WIDTH * width
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


def tilted(turn_rad: float, width: int, height: int) -> Array:
    """The homography (3, 3) px from the picture of a plane seen squarely to one seen by a camera that is turned."""
    matrix = camera_matrix(width, height)
    turn = cv2.Rodrigues(np.array([0.0, turn_rad, 0.0]))[0]
    return np.asarray(matrix @ np.column_stack([turn[:, 0], turn[:, 1], [0.0, 0.0, 1.0]]) @ np.linalg.inv(matrix))


def lens_source(distortion: float, width: int, height: int) -> Array:
    """Where in the perfect picture (h, w, 2) px each pixel of a lens looks that has this first radial coefficient."""
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 1, 2)
    matrix, lens = camera_matrix(width, height), np.array([distortion, 0.0, 0.0, 0.0])
    source = cv2.undistortPoints(pixels, matrix, lens, P=matrix, criteria=CRITERIA)
    return np.asarray(source.reshape(height, width, 2))


def tilt_source(turn_rad: float, width: int, height: int) -> Array:
    """Where in the picture seen squarely (h, w, 2) px each pixel of a turned camera looks."""
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    pixels = np.stack([columns, rows], axis=-1).reshape(1, -1, 2)
    source = cv2.perspectiveTransform(pixels, np.linalg.inv(tilted(turn_rad, width, height)))
    return np.asarray(source.reshape(height, width, 2))


def seen_through(fault: Fault, size: float, width: int, height: int) -> Points:
    """Where a fault of the picture shows points; others leave them."""
    if fault.name == "camera-tilt":
        return lambda points: cv2.perspectiveTransform(points[None], tilted(size, width, height))[0]
    if fault.name == "radial-distortion":
        return lambda points: _distorted(points, size, width, height)
    return lambda points: points


def _distorted(points: Array, distortion: float, width: int, height: int) -> Array:
    matrix = camera_matrix(width, height)
    focal, middle = matrix[0, 0], matrix[:2, 2]
    away = (points - middle) / focal
    return np.asarray(middle + focal * away * (1 + distortion * np.sum(away**2, axis=1, keepdims=True)))


def camera_path(size_px: float, share: Array) -> Array:
    """A slow wander (n, 2) px, whose largest excursion along each axis is ``size_px``, at shares (n,) of the clip."""
    weights = np.random.default_rng(3).standard_normal((WAVES, 2))
    waves = np.cos(np.pi * (np.arange(WAVES) + 1)[:, None, None] * np.linspace(0, 1, 1001)[:, None])
    largest = np.abs((weights[:, None] * waves).sum(axis=0)).max(axis=0)
    here = np.cos(np.pi * (np.arange(WAVES) + 1) * np.asarray(share)[:, None]) @ weights
    return np.asarray(size_px * here / largest)


# Frames -------------------------------------------------------------------------------------------------------------


def frames_with(fault: Fault, size: float, frames: Iterable[Timed], count: int) -> Iterator[Timed]:
    """The frames of a clip of ``count`` frames with a fault; the same frames where there is none.

    ``size`` is a turn in rad, the first radial coefficient of a radius in focal lengths, frame intervals from the first
    row to the last, px, frames, or the relative error of the rate.
    """
    if fault.name in ("camera-tilt", "radial-distortion"):
        yield from _bent(fault, size, frames)
    elif fault.name == "rolling-shutter":
        yield from _rolled(size, frames)
    elif fault.name == "camera-wander":
        yield from _moved(size, frames, count)
    elif fault.name == "dropped-frame":
        yield from _dropped(round(max(size, 1.0)), frames, round(LOST_AT * count))
    else:
        yield from ((t_s / (1.0 + size), image) for t_s, image in frames)


def _bent(fault: Fault, size: float, frames: Iterable[Timed]) -> Iterator[Timed]:
    maps: tuple[NDArray[np.float32], NDArray[np.float32]] | None = None
    for t_s, image in frames:
        height, width = image.shape[:2]
        if maps is None:
            maps = _maps((tilt_source if fault.name == "camera-tilt" else lens_source)(size, width, height))
        yield t_s, cv2.remap(image, *maps, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)


def _maps(source: Array) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    return source[..., 0].astype(np.float32), source[..., 1].astype(np.float32)


def _rolled(intervals: float, frames: Iterable[Timed]) -> Iterator[Timed]:
    """Each row at its own time: the middle one at that of the frame, between its neighbours by interpolation."""
    ends = itertools.chain([None], frames, [None])
    for before, here, after in _neighbours(ends):
        image = here[1].astype(np.float32)
        late = intervals * (np.linspace(0, 1, len(image)) - 0.5)[:, None, None]
        other = np.where(late < 0, (before or here)[1], (after or here)[1])
        mixed = image + np.abs(late) * (other - image)
        yield here[0], np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def _neighbours(ends: Iterable[Timed | None]) -> Iterator[tuple[Timed | None, Timed, Timed | None]]:
    """Each item with the one before and the one after; the ends are None."""
    several = iter(ends)
    before, here = next(several), next(several)
    for after in several:
        assert here is not None
        yield before, here, after
        before, here = here, after


def _moved(size_px: float, frames: Iterable[Timed], count: int) -> Iterator[Timed]:
    path = camera_path(size_px, np.arange(count) / max(count - 1, 1))
    for (t_s, image), (x, y) in zip(frames, path, strict=False):
        shift = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
        yield (
            t_s,
            cv2.warpAffine(image, shift, image.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE),
        )


def _dropped(lost: int, frames: Iterable[Timed], first: int) -> Iterator[Timed]:
    """The frames without ``lost`` of them from number ``first`` on, and the gap closed."""
    gone_s, begun = 0.0, 0.0
    for number, (t_s, image) in enumerate(frames):
        if number == first:
            begun = t_s
        if number == first + lost:
            gone_s = t_s - begun
        if not first <= number < first + lost:
            yield t_s - gone_s, image


# Files --------------------------------------------------------------------------------------------------------------


def encode(path: Path, frames: Iterable[Timed]) -> Path:
    """Write frames as H.264 of RGB without loss, at their own times.

    Parameters
    ----------
    path
        The .mp4 file.
    frames
        In order.
    """
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264rgb", rate=30, options={"crf": "0", "preset": "ultrafast"})
        stream.pix_fmt, stream.time_base, stream.codec_context.time_base = "bgr24", CLOCK, CLOCK
        stream.codec_context.thread_count = 1
        for number, (t_s, image) in enumerate(frames):
            if number == 0:
                stream.height, stream.width = image.shape[:2]
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="bgr24")
            frame.pts, frame.time_base = round(t_s / CLOCK), CLOCK
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def render(source: Path, target: Path, fault: Fault, size: float) -> tuple[int, int]:
    """Write the clip ``source`` with a fault to ``target``; width and height in px.

    Parameters
    ----------
    source, target
        The files.
    fault, size
        As for :func:`frames_with`.
    """
    clip = open_video(source)
    count = clip.n_expected or sum(1 for _ in clip.frames())
    frames = ((frame.t_s, np.asarray(frame.bgr())) for frame in clip.frames())
    encode(target, frames_with(fault, size, frames, count))
    return clip.width, clip.height


def stated_again(words: str, fault: Fault, size: float, shape: tuple[int, int]) -> str:
    """The options of a command for the new clip: marks move with the picture, a stated rate is wrong as well."""
    seen = seen_through(fault, size, *shape)

    def moved(match: re.Match[str]) -> str:
        x, y = seen(np.array([[float(match["x"]), float(match["y"])]]))[0]
        return f"{match['name']}={x:.2f},{y:.2f}"

    words = re.sub(r"(?P<name>\b(?:launch|pivot))=(?P<x>[\d.]+),(?P<y>[\d.]+)", moved, words)
    if fault.name != "wrong-rate":
        return words
    return re.sub(r"--fps ([\d.]+)", lambda match: f"--fps {float(match[1]) * (1 + size):.6g}", words)


def tracked(name: str, fault: Fault, size: float, seconds: float) -> tuple[Trajectory, list[str]]:
    """The trajectory of a recording of :mod:`validation.films` with a fault, and the kinds of doubt of its run.

    Raises
    ------
    VideoError
        When the commands give no trajectory, or take longer than ``seconds``.
    """
    word, source, *options = shlex.split(films.named(name).command)
    with tempfile.TemporaryDirectory() as temporary:
        clip, folder = Path(temporary) / "clip.mp4", Path(temporary) / "run"
        shape = render(Path(source), clip, fault, size)
        words = shlex.split(stated_again(shlex.join(options), fault, size, shape))
        wrong = _command([word, str(clip), *words, "-o", str(folder), "--force"], seconds)
        if not (folder / "trajectory.csv").exists():
            raise VideoError(wrong)
        return read_trajectory(folder / "trajectory.csv"), _doubts(folder / "fit.json")


def _command(words: list[str], seconds: float) -> str:
    """Run one command of the program; its last line of error."""
    try:
        done = subprocess.run([sys.executable, "-m", "iris_sysid", *words], capture_output=True, timeout=seconds)
    except subprocess.TimeoutExpired:
        return f"no track in {seconds:g} s"
    return (done.stderr.decode(errors="replace").strip().splitlines() or ["no trajectory"])[-1]


def _doubts(path: Path) -> list[str]:
    """Kinds of doubt of a run, such as ``clock`` and ``scale``; none where it has no fit."""
    try:
        verdict = read_document(path, FitDocument).verdict
    except (IrisError, OSError):
        return []
    return [reason.kind for reason in verdict.reasons] if verdict is not None else []
