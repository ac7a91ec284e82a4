"""The benchmark's tensors (N, n_f, C, H, W) as images again: each frame of the clip once, with its time."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from tokenize import TokenError

import av
import cv2
import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from iris_sysid.errors import VideoError
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import TensorDocument
from iris_sysid.types import Frame
from iris_sysid.video.container import DamageError, check_size
from iris_sysid.video.pixel_formats import UPRIGHT, Bytes, Orientation

AXES = "(windows, frames, channels, height, width)"
CHANNELS = (1, 3)
NUMBERS = ("f2", "f4", "f8", "u1")  # little- or big-endian; anything else is no image
MAX_WINDOWS, MAX_FRAMES = 2_000_000, 100_000  # 9 h at 60 fps; no clip is longer
LONGEST_STEP = 240  # frames between two images of a window that are looked for where nothing says how many
GREY = 255.0
ROUNDING = 1e-3  # in the range from 0 to 1: half-precision numbers, and a resize that overshoots by rounding


@dataclass(eq=False)
class TensorSource:
    """A tensor file that was opened and checked; ``places`` (n, 2) gives the window and the index of a frame."""

    label: str
    tensor: NDArray[np.generic]
    places: NDArray[np.intp]
    times_s: Sequence[float] | None
    width: int
    height: int
    rate: float | None
    first_s: float | None
    facts: Mapping[str, object]
    note: str = ""
    cut: str = ""
    orientation: Orientation = UPRIGHT
    time_base: Fraction | None = None

    @property
    def expected(self) -> int:
        """Number of different frames."""
        return len(self.places)

    def images(self) -> Generator[tuple[float | None, av.VideoFrame]]:
        """Every frame in order with its time in s; DamageError where values are no brightness."""
        for k, (window, at) in enumerate(self.places.tolist()):
            yield None if self.times_s is None else self.times_s[k], self._image(window, at)

    def survey(self) -> list[tuple[int, bool]]:
        """The number of each frame; each stands for itself, like a key frame."""
        return [(number, True) for number in range(len(self.places))]

    def seconds(self, stamp: int) -> float | None:
        """The time in s of the frame of that number; None where no times are known."""
        return None if self.times_s is None else self.times_s[stamp]

    def orientation_for(self, image: av.VideoFrame) -> Orientation:
        """Tensors are as displayed."""
        return self.orientation

    def pick(self, bursts: Sequence[tuple[int, Sequence[int]]]) -> Iterator[tuple[int, av.VideoFrame]]:
        """The frames of those numbers."""
        for number in (index for _, wanted in bursts for index in wanted):
            window, at = self.places[number].tolist()
            yield number, self._image(window, at)

    def images_from(self, stamp: int) -> Generator[tuple[int, av.VideoFrame]]:
        """Number and image of every frame from that number on."""
        yield from self.pick([(stamp, range(stamp, len(self.places)))])

    def _image(self, window: int, at: int) -> av.VideoFrame:
        levels = _levels(self.tensor[window, at], window, at)
        if levels.shape[0] == 1:
            return av.VideoFrame.from_ndarray(np.ascontiguousarray(levels[0]), format="gray")
        return av.VideoFrame.from_ndarray(np.ascontiguousarray(levels.transpose(1, 2, 0)), format="rgb24")


def _levels(image: NDArray[np.generic], window: int, at: int) -> Bytes:
    """Brightness (C, H, W) as whole levels from 0 to 255."""
    if image.dtype == np.uint8:
        return np.asarray(image)
    values = np.asarray(image, dtype=np.float64)
    if not (np.isfinite(values).all() and values.min() >= -ROUNDING and values.max() <= 1 + ROUNDING):
        low, high = float(np.min(values)), float(np.max(values))
        raise DamageError(f"image {at} of window {window} has values from {low:g} to {high:g}, not from 0 to 1")
    return np.asarray(np.rint(np.clip(values, 0.0, 1.0) * GREY), dtype=np.uint8)


# --------------------------------------------------------------------------- opening


def open_tensor(path: Path, label: str) -> TensorSource:
    """Open a ``.npy`` file as the benchmark writes them, with the times in ``<name>.npy.json`` where that is there.

    Nothing is unpickled, and the header is believed only where the file is as long as it says. VideoError says what
    is wrong.
    """
    tensor = _mapped(path, label)
    beside = sidecar(path)
    if beside.exists():
        return _with_times(path, label, tensor, read_document(beside, TensorDocument))
    step = 1 if tensor.shape[1] == 1 else found_step(tensor)
    if step is None:
        places = np.array([(0, at) for at in range(tensor.shape[1])], dtype=np.intp)
        note = (
            ""
            if len(tensor) == 1
            else f"the {len(tensor)} windows do not overlap, and nothing says how they follow one another: only the "
            "first was read"
        )
    else:
        places = places_of(tensor.shape[0], tensor.shape[1], step, 1)[1]
        note = f"the windows overlap as if their frames were {step} apart; the frame rate is that of the clip"
    return _source(label, tensor, places, None, note)


def sidecar(path: Path) -> Path:
    """Where the times of a tensor are."""
    return path.with_name(f"{path.name}.json")


def _with_times(path: Path, label: str, tensor: NDArray[np.generic], told: TensorDocument) -> TensorSource:
    if tuple(told.shape) != tensor.shape:
        raise VideoError(
            f"{sidecar(path).name} is of a tensor of shape {told.shape}, {label} is {list(tensor.shape)}: "
            "make the tensor again"
        )
    places = places_of(tensor.shape[0], tensor.shape[1], told.step, told.stride)[1]
    if len(places) != len(told.t_s):
        raise VideoError(
            f"{sidecar(path).name} holds {len(told.t_s)} times for {len(places)} frames: make the tensor again"
        )
    if tensor.shape[0] > 1 and not repeats(tensor, told.step, told.stride):
        raise VideoError(
            f"{label}: the windows do not overlap as {sidecar(path).name} says (every {told.step}. frame, a window "
            f"every {told.stride}): make the tensor again"
        )
    return _source(label, tensor, places, told.t_s)


def _source(
    label: str,
    tensor: NDArray[np.generic],
    places: NDArray[np.intp],
    times_s: Sequence[float] | None,
    note: str = "",
) -> TensorSource:
    pixels = "gray" if tensor.shape[2] == 1 else "rgb24"
    several = times_s is not None and len(times_s) > 1 and times_s[-1] > times_s[0]
    return TensorSource(
        label=label,
        tensor=tensor,
        places=places,
        times_s=times_s,
        width=tensor.shape[4],
        height=tensor.shape[3],
        rate=(len(times_s) - 1) / (times_s[-1] - times_s[0]) if times_s is not None and several else None,
        first_s=None if times_s is None else times_s[0],
        facts={
            "format": "npy",
            "codec": "none",
            "pixel_format": pixels,
            "luma_range": "full",
            "pixel_aspect": 1.0,
        },
        note=note,
    )


def _mapped(path: Path, label: str) -> NDArray[np.generic]:
    """The array (N, n_f, C, H, W) on disk, read-only; its header is checked before anything is mapped."""
    shape, order, dtype, start = _header(path, label)
    if len(shape) != 5 or shape[2] not in CHANNELS or min(shape) < 1:
        raise VideoError(f"{label} has the shape {shape}; a tensor is {AXES} with 1 or 3 channels")
    check_size(shape[4], shape[3], label)
    if shape[0] > MAX_WINDOWS or shape[1] > MAX_FRAMES:
        raise VideoError(f"{label} claims {shape[0]} windows of {shape[1]} frames, more than any clip has")
    promised, there = start + math.prod(shape) * dtype.itemsize, path.stat().st_size
    if promised != there:
        raise VideoError(f"{label} is {there} bytes long where its header promises {promised}: it is damaged")
    return np.memmap(path, dtype=dtype, mode="r", offset=start, shape=shape, order="F" if order else "C")


def _header(path: Path, label: str) -> tuple[tuple[int, ...], bool, np.dtype[np.generic], int]:
    """Shape, whether in Fortran order, type, and where the data begin."""
    with path.open("rb") as file:
        try:
            version = npy.read_magic(file)
            if version not in ((1, 0), (2, 0)):
                raise VideoError(f"{label} is a .npy file of version {version}; a tensor has version 1 or 2")
            read = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
            shape, order, dtype = read(file)
        except (ValueError, TypeError, SyntaxError, TokenError, RecursionError, MemoryError) as error:
            raise VideoError(f"{label} is no .npy file that can be read: {_one_line(error)}") from error
        if dtype.hasobject or dtype.str[1:] not in NUMBERS:
            raise VideoError(f"{label} holds {dtype}, which is no brightness; it must be float from 0 to 1, or uint8")
        return tuple(map(int, shape)), order, dtype, file.tell()


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


# --------------------------------------------------------------------------- windows and frames


def places_of(windows: int, frames: int, step: int, stride: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Which frames of a clip a tensor holds, and the first position of each: numbers (n,), and (window, index) (n, 2).

    Parameters
    ----------
    windows, frames
        Number of windows, and of frames in each.
    step
        Frames of the clip from one frame of a window to the next.
    stride
        Frames of the clip from the start of one window to that of the next.
    """
    numbers = np.add.outer(np.arange(windows) * stride, np.arange(frames) * step)
    found, where = np.unique(numbers.ravel(), return_index=True)
    return found, np.stack(np.divmod(where, frames), axis=1)


def found_step(tensor: NDArray[np.generic]) -> int | None:
    """How many frames apart the images of a window are when each window starts one frame later; None if unknown.

    The tensor is (windows, frames, channels, height, width), as in the file.

    Where the image does not change for longer than the step, the smallest step that agrees everywhere is found.
    """
    for step in range(1, min(len(tensor) - 1, LONGEST_STEP) + 1):
        if repeats(tensor, step, 1):
            return step
    return None


def repeats(tensor: NDArray[np.generic], step: int, stride: int) -> bool:
    """Whether images that should be the same frame are the same, in up to nine pairs of windows over the whole.

    The tensor is (windows, frames, channels, height, width), as in the file.
    """
    later = step // math.gcd(step, stride)  # windows, after which a frame is met again
    along = later * stride // step  # that many places earlier
    if later >= len(tensor) or along >= tensor.shape[1]:
        return True  # no frame is in two windows
    starts = np.unique(np.linspace(0, len(tensor) - 1 - later, 9).astype(int)).tolist()
    return all(np.array_equal(tensor[start + later, :-along], tensor[start, along:]) for start in starts)


# --------------------------------------------------------------------------- making


def grey_levels(frame: Frame, size: tuple[int, int]) -> Bytes:
    """A frame as the benchmark's script makes it: resized by bilinear interpolation, then grey, (h, w) uint8.

    Parameters
    ----------
    frame
        Of any size.
    size
        Width and height in px.
    """
    return np.asarray(cv2.cvtColor(cv2.resize(frame.bgr(), size), cv2.COLOR_BGR2GRAY))
