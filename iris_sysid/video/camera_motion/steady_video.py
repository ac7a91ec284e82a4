"""The frames of a moving camera as one that stands still would show them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.types import Array, CameraMotion, Frame, FrameSource, Mask, mapped

Bytes = NDArray[np.uint8]
Plane = Callable[[Frame], Bytes]

WIDEST = 2.0  # times the frame, at most: what a long pan shows beyond is left out
SEEN_IN = 0.25  # of the sampled frames: what fewer of them show is outside in all frames
MIN_SEEN = 3  # of them
FILLS = 4  # variants of what is put outside, each with the noise of another frame
MAX_SAMPLES = 15  # frames from which that is made
LIKE_MEDIAN = 12  # grey levels: what differs by more from the median of the frames is a body that passes
OUTSIDE = 128  # grey level of what no frame shows
BAND = 64  # rows of the median that are worked out at once
NOT_SEEN = np.int16(32767)


@dataclass(frozen=True, slots=True)
class SteadyCanvas:
    """The image in which the clip is shown: ``left`` and ``top`` px of its corner in the reference, its size, px."""

    left: int
    top: int
    width: int
    height: int

    @classmethod
    def of(cls, motion: CameraMotion, width: int, height: int) -> SteadyCanvas:
        """The smallest that holds all frames of that size, not more than twice as wide and high as one of them."""
        corners = np.array([[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]])
        back = np.array([cv2.invertAffineTransform(one) for one in motion.to_frame])
        ends = np.array([mapped(one, corners) for one in back])
        left, right = _range(ends[..., 0], width)
        top, bottom = _range(ends[..., 1], height)
        return cls(left, top, right - left, bottom - top)

    def map_to(self, to_frame: Array) -> Array:
        """The map (2, 3) from px of the canvas to px of a frame, given that from the reference."""
        moved = to_frame.copy()
        moved[:, 2] += to_frame[:, :2] @ (self.left, self.top)
        return moved


def _range(ends: Array, side: int) -> tuple[int, int]:
    """Least and largest coordinate, even, at most ``WIDEST`` times a frame's side apart; the first frame is within."""
    low, high = int(np.floor(ends.min())), int(np.ceil(ends.max()))
    low, high = low - low % 2, high + high % 2
    spare = int((WIDEST - 1) * side) // 2 * 2
    low = max(low, -spare)
    return low, min(high, low + side + spare)


@dataclass(frozen=True, eq=False, slots=True)
class _Fill:
    """What is shown where a frame shows nothing: some variants of the background, and where it counts in all frames."""

    variants: Sequence[Bytes]
    outside: Bytes


@dataclass(eq=False)
class OnCanvas(ABC):
    """A FrameSource whose frames are moved onto a canvas whose px do not move with the camera."""

    video: FrameSource
    motion: CameraMotion
    canvas: SteadyCanvas

    @property
    def width(self) -> int:
        """Width of the canvas, px."""
        return self.canvas.width

    @property
    def height(self) -> int:
        """Height of the canvas, px."""
        return self.canvas.height

    @property
    def n_expected(self) -> int:
        """Number of frames that the container promises."""
        return self.video.n_expected

    def frames(self) -> Iterator[Frame]:
        """Every frame, as the still camera would show it."""
        return (self._steady(frame) for frame in self.video.frames())

    def sample(self, count: int) -> list[Frame]:
        """About ``count`` frames spread evenly over the clip."""
        return [self._steady(frame) for frame in self.video.sample(count)]

    @abstractmethod
    def _steady(self, frame: Frame) -> Frame:
        """A frame on the canvas."""


@dataclass(eq=False)
class SteadyVideo(OnCanvas):
    """A clip with the motion of its camera taken out: a FrameSource in px of :class:`SteadyCanvas`.

    Frames are resampled (bicubic). Where a frame does not reach, the background that other frames show there is put,
    with their noise; where few frames reach, all show the same. So nothing moves there.
    """

    samples: Sequence[Frame]
    _fills: dict[str, _Fill] = field(default_factory=dict)

    def _steady(self, frame: Frame) -> Frame:
        luma = self._shown("luma", lambda plain: plain.luma, frame, frame.luma)
        luma.flags.writeable = False
        # the colours are resampled once, however many windows of them are looked at
        return replace(frame, luma=luma, bgr=partial(self._bgr, frame), chroma=cache(partial(self._chroma, frame)))

    def _bgr(self, frame: Frame) -> Bytes:
        return self._shown("bgr", _bgr, frame, frame.bgr())

    def _chroma(self, frame: Frame) -> tuple[Bytes, Bytes] | None:
        planes = frame.chroma()
        if planes is None:
            return None
        blue, red = (self._shown(f"chroma {k}", partial(_chroma, k), frame, plane) for k, plane in enumerate(planes))
        return blue, red

    def _shown(self, name: str, plane_of: Plane, frame: Frame, plane: Bytes) -> Bytes:
        """One plane of a frame on the canvas, as it is coded: colour may have half as many pixels a side."""
        fill = self._fill(name, plane_of)
        shown = fill.variants[frame.index % len(fill.variants)].copy()
        cv2.warpAffine(
            plane,
            self._map(frame, plane),
            (shown.shape[1], shown.shape[0]),
            shown,
            flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_TRANSPARENT,
        )
        return np.asarray(cv2.copyTo(fill.variants[0], fill.outside, shown))

    def _map(self, frame: Frame, plane: Bytes) -> Array:
        """The map (2, 3) from px of the canvas to px of a frame, both at the size of a plane."""
        moved = self.canvas.map_to(self.motion.of(np.array([frame.index]))[0])
        across, down = (-(-full // part) for full, part in zip(frame.luma.shape[::-1], plane.shape[1::-1], strict=True))
        if (across, down) == (1, 1):
            return moved
        finer = np.array([[across, 0, (across - 1) / 2], [0, down, (down - 1) / 2], [0, 0, 1.0]])
        return np.asarray((np.linalg.inv(finer) @ np.vstack([moved, [0, 0, 1]]) @ finer)[:2])

    def _fill(self, name: str, plane_of: Plane) -> _Fill:
        if name not in self._fills:
            planes = [plane_of(frame) for frame in self.samples]
            across, down = (
                -(-full // part) for full, part in zip(self.samples[0].luma.shape, planes[0].shape, strict=False)
            )
            size = (self.canvas.width // down, self.canvas.height // across)
            maps = [self._map(frame, plane) for frame, plane in zip(self.samples, planes, strict=True)]
            self._fills[name] = _fill_of([_warped(plane, m, size) for plane, m in zip(planes, maps, strict=True)])
        return self._fills[name]


def _bgr(frame: Frame) -> Bytes:
    return frame.bgr()


def _chroma(number: int, frame: Frame) -> Bytes:
    planes = frame.chroma()
    assert planes is not None
    return planes[number]


def _warped(plane: Bytes, moved: Array, size: tuple[int, int]) -> tuple[Bytes, Mask]:
    """A plane on the canvas of that size, and where it shows something."""
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    full = np.full(plane.shape[:2], 255, dtype=np.uint8)
    return cv2.warpAffine(plane, moved, size, flags=flags), cv2.warpAffine(full, moved, size, flags=flags) == 255


def _fill_of(warped: Sequence[tuple[Bytes, Mask]]) -> _Fill:
    """What is shown outside of a frame, from sampled frames on the canvas."""
    images, seen = [image for image, _ in warped], [mask for _, mask in warped]
    median = _median(images, seen)
    count = np.sum(seen, axis=0, dtype=np.int64)
    outside = np.asarray(count < max(MIN_SEEN, SEEN_IN * len(images)), dtype=np.uint8)
    variants = []
    for k in np.linspace(0, len(images) - 1, FILLS).astype(int):
        near = cv2.absdiff(images[k], median) < LIKE_MEDIAN
        near = near.all(axis=2) if near.ndim == 3 else near
        variant = median.copy()
        variant[near & seen[k]] = images[k][near & seen[k]]
        variant[count == 0] = OUTSIDE
        variants.append(variant)
    return _Fill(variants, outside)


def _median(images: Sequence[Bytes], seen: Sequence[Mask]) -> Bytes:
    """Median of the images that show a pixel, band by band."""
    median = np.empty_like(images[0])
    for top in range(0, median.shape[0], BAND):
        band = slice(top, top + BAND)
        shown = np.stack([mask[band] for mask in seen])
        stack = np.stack([image[band] for image in images]).astype(np.int16)
        stack[~shown] = NOT_SEEN
        stack.sort(axis=0)
        middle = np.maximum(shown.sum(axis=0) - 1, 0) // 2
        index = middle if stack.ndim == 3 else np.broadcast_to(middle[..., None], stack.shape[1:])
        median[band] = np.minimum(np.take_along_axis(stack, index[None], axis=0)[0], 255)
    return median
