"""Frames of a clip, options of a tracker, and the track that it returns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import DataError, VideoError
from iris_sysid.types._arrays import Array, Mask, frozen_array, frozen_mask, increasing_times
from iris_sysid.types._display import Shown, text_of
from iris_sysid.types._error_autocorrelation import ErrorAutocorrelation
from iris_sysid.types._pickling import Portable
from iris_sysid.types._track_quality import TrackMark, TrackQuality
from iris_sysid.types._transfer import PixelCoding, Transfer

UNSTATED = PixelCoding()
MIN_FRAMES = 3


def _no_chroma() -> None:
    return None


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One decoded frame. ``luma`` is (h, w) uint8; ``bgr()`` converts to (h, w, 3) uint8 on demand.

    ``chroma()`` gives the two colour planes (cb, cr) as coded, uint8, each as large as luma or smaller; None where
    the image is not coded so. ``coding`` says what the file tells of how light became these levels; ``key`` is false
    where the frame was predicted from others, and may be late in what changes slowly.
    """

    index: int
    t_s: float
    luma: NDArray[np.uint8]
    bgr: Callable[[], NDArray[np.uint8]]
    chroma: Callable[[], tuple[NDArray[np.uint8], NDArray[np.uint8]] | None] = _no_chroma
    coding: PixelCoding = UNSTATED
    key: bool = True

    def __repr__(self) -> str:
        height, width = self.luma.shape
        return f"Frame {self.index} at {self.t_s:g} s, {width} x {height} px"


class FrameSource(Protocol):
    """The input of a tracker: frames in order, as many times as needed, with the container's exact times."""

    @property
    def width(self) -> int:
        """Width in pixels, as displayed (rotation applied)."""

    @property
    def height(self) -> int:
        """Height in pixels, as displayed."""

    @property
    def n_expected(self) -> int:
        """Number of frames that the container promises (0 when it does not say)."""

    def frames(self) -> Iterator[Frame]:
        """Decode every frame from the start, in display order."""

    def sample(self, count: int) -> list[Frame]:
        """About ``count`` frames spread evenly over the clip, as cheaply as the container allows."""


def check_count(frames: int, purpose: str) -> None:
    """VideoError where a clip has too few frames for any motion: no mark in it, and no review of it, can help."""
    if frames < MIN_FRAMES:
        raise VideoError(f"the clip has {frames} frame(s); {purpose} takes at least {MIN_FRAMES}")


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """Options that every tracker accepts.

    ``roi`` is (x, y, width, height) in px. ``colour`` is a name or ``#rrggbb``: only pixels of about
    that hue count. ``progress`` is called with (frames done, frames expected). ``mask`` gives an image for each
    frame in which 0 is background and every other value a body: it replaces the detector. ``marks`` say where a body
    is in some frames; ``explain`` is called with all candidates that a tracker tried. ``transfer`` is
    the camera's curve from light to grey levels; None takes the file's tag.
    """

    bodies: int = 1
    roi: tuple[int, int, int, int] | None = None
    colour: str | None = None
    progress: Callable[[int, int], None] | None = None
    mask: FrameSource | None = None
    marks: tuple[TrackMark, ...] = ()
    explain: Callable[[Sequence[TrackCandidate]], None] | None = None
    transfer: Transfer | None = None


TRACK_SIGMAS = ("sigma_radius_px", "sigma_angle_rad", "sigma_intensity")
TRACK_MEASURES = ("radius_px", "angle_rad", "intensity", "area_px", *TRACK_SIGMAS)  # NaN in a gap
TRACK_MASKS = ("hand", "edited")


@dataclass(frozen=True, eq=False, slots=True)
class Track(Shown, Portable):
    """One body, in pixels, over the frames of a clip.

    ``t_s`` (n,) s; ``xy_px`` and ``sigma_px`` (n, 2) px, standard error of each coordinate;
    ``valid`` (n,). Optional (n,): ``radius_px`` apparent radius, ``angle_rad`` orientation
    (anticlockwise as seen), ``intensity``, ``area_px`` pixels in the blob, ``hand``
    (true where something that reaches in from the edge of the image touches the body), ``edited`` (true where a
    person placed or removed the position), and the standard errors ``sigma_radius_px``, ``sigma_angle_rad``,
    ``sigma_intensity`` of what they are named after.
    ``frame`` (n,) is the number of each frame in the file. A gap is NaN and not valid.
    ``error_autocorrelation`` is that of the position errors, None where the tracker does not measure it.
    ``origin`` records the source of the track; nothing is computed from it. ``quality`` says how far the track can be
    trusted, None where nothing judged it. ``transfer`` is the curve that was undone to make ``intensity`` light, 1 at
    white; None where it is in grey levels. ``intensity_patterns`` holds, by source, what errors of the intensities have
    in common: (r, n), r independent patterns, each the change of every intensity for one standard error.
    ``camera_motion`` (n, 2, 3) takes px of the track, which are those of the clip's first frame, to px of each frame
    where the camera moves (None: it stands still): ``A x + b`` with the rows of ``[A | b]``.
    """

    t_s: Array
    xy_px: Array
    sigma_px: Array
    valid: Mask
    frame: NDArray[np.int64]
    body: str = "1"
    radius_px: Array | None = None
    angle_rad: Array | None = None
    intensity: Array | None = None
    area_px: Array | None = None
    hand: Mask | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)
    sigma_radius_px: Array | None = None
    sigma_angle_rad: Array | None = None
    sigma_intensity: Array | None = None
    error_autocorrelation: ErrorAutocorrelation | None = None
    quality: TrackQuality | None = None
    transfer: Transfer | None = None
    intensity_patterns: Mapping[str, Array] = field(default_factory=dict)
    camera_motion: Array | None = None
    edited: Mask | None = None

    def __post_init__(self) -> None:
        times = increasing_times(self.t_s)
        n = times.size
        valid = frozen_mask(self.valid, n, "valid")
        for name, value in (
            ("t_s", times),
            ("xy_px", frozen_array(self.xy_px, (n, 2), "xy_px")),
            ("sigma_px", frozen_array(self.sigma_px, (n, 2), "sigma_px")),
            ("valid", valid),
            ("origin", MappingProxyType(dict(self.origin))),
        ):
            object.__setattr__(self, name, value)
        frame = np.array(self.frame, dtype=np.int64)
        if frame.shape != (n,):
            raise DataError(f"frame must have shape ({n},), not {frame.shape}")
        frame.flags.writeable = False
        object.__setattr__(self, "frame", frame)
        for name in TRACK_MEASURES:
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_array(getattr(self, name), (n,), name))
        patterns = {
            source: frozen_array(rows, (None, n), f"intensity_patterns[{source!r}]")
            for source, rows in self.intensity_patterns.items()
        }
        object.__setattr__(self, "intensity_patterns", MappingProxyType(patterns))
        if self.camera_motion is not None:
            object.__setattr__(self, "camera_motion", frozen_array(self.camera_motion, (n, 2, 3), "camera_motion"))
        for name in TRACK_MASKS:
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_mask(getattr(self, name), n, name))
        if not np.all(np.isfinite(self.xy_px[valid])):
            raise DataError("a valid sample has a position that is not finite; mark it as a gap")

    @property
    def n_valid(self) -> int:
        """Number of frames in which the body was found."""
        return int(self.valid.sum())

    def __repr__(self) -> str:
        doubts = self.quality.doubts if self.quality is not None else ()
        return text_of(
            f"Track of body {self.body!r}: found in {self.n_valid} of {self.t_s.size} frames, "
            f"{self.t_s[0]:g} to {self.t_s[-1]:g} s",
            f"doubtful: {', '.join(doubt.kind for doubt in doubts)}" if doubts else "",
        )


@dataclass(frozen=True, eq=False, slots=True)
class TrackCandidate:
    """One way to follow the bodies of a clip, and its tracks; without tracks, ``refusal`` says why."""

    name: str
    tracks: tuple[Track, ...] = ()
    refusal: str = ""
    chosen: bool = False

    @property
    def doubtful(self) -> bool:
        """Whether there is no track, or there is evidence against one of them."""
        return not self.tracks or any(track.quality is None or track.quality.doubtful for track in self.tracks)
