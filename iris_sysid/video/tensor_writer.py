"""The benchmark's tensor format (N, n_f, C, H, W), written from any clip with its true time step beside it.

A tensor holds windows of grey images from 0 to 1. Window i begins with frame i * stride of the clip, and its
images are ``step`` frames apart: with the benchmark's 10 images 6 frames apart at 60 fps, 0.1 s from one to the
next. The benchmark's own script (video2npy.py of the pipeline that it builds on) makes one window a frame and leaves
out the last ``step``; its tensor is the beginning of this one. :func:`iris_sysid.open_video` reads a tensor back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from iris_sysid.errors import DataError
from iris_sysid.io.files import atomic_path, check_writable, origin_of
from iris_sysid.io.json_documents import write_document
from iris_sysid.io.schemas import TensorDocument
from iris_sysid.types import Array, Progress, with_progress
from iris_sysid.video.container import check_size
from iris_sysid.video.reader import Video
from iris_sysid.video.tensor_reader import GREY, grey_levels, places_of, sidecar

FRAMES, STEP, SIZE = 10, 6, (100, 56)  # images a window, frames between them, width and height in px


def write_tensor(
    clip: Video,
    path: str | Path,
    *,
    frames: int = FRAMES,
    step: int = STEP,
    stride: int = 1,
    size: tuple[int, int] = SIZE,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> TensorDocument:
    """Write a clip as a tensor of windows, and the times of its frames to ``<path>.json``.

    Parameters
    ----------
    clip
        From :func:`iris_sysid.open_video`; its true times are used.
    path
        ``.npy`` file: float32 from 0 to 1, one channel (grey).
    frames
        Images in a window.
    step
        Frames of the clip from one image of a window to the next.
    stride
        Frames of the clip from the start of a window to that of the next.
    size
        Width and height of the images in px.
    overwrite
        Replace files that exist.
    progress
        Called with (frames done, frames expected).

    Returns
    -------
    TensorDocument
        Content of the file beside the tensor: shape, true time step and its spread, time of every frame used.

    Raises
    ------
    DataError
        When a number makes no window, or the clip is shorter than one.
    OutputError
        When a file exists or cannot be written.
    VideoError
        When the clip cannot be read.
    """
    path = Path(path)
    _check(path, frames, step, stride, size)
    for file in (path, sidecar(path)):
        check_writable(file, overwrite=overwrite)
    images, t_s = _images(clip, size, progress)
    windows = (len(images) - (frames - 1) * step - 1) // stride + 1
    if windows < 1:
        raise DataError(
            f"{clip.path.name} has {len(images)} frames; a window of {frames}, {step} apart, needs "
            f"{(frames - 1) * step + 1}"
        )
    used, _ = places_of(windows, frames, step, stride)
    shape = (windows, frames, 1, size[1], size[0])
    told = _document(shape, step, stride, t_s, used, _origin(clip, frames, step, stride, size))
    with atomic_path(path, overwrite=overwrite) as temporary, temporary.open("wb") as output:
        _write_windows(output, images, shape, step, stride)
    write_document(told, sidecar(path), overwrite=overwrite)
    return told


def _check(path: Path, frames: int, step: int, stride: int, size: tuple[int, int]) -> None:
    if path.suffix != ".npy":
        raise DataError(f"a tensor is a .npy file, not {path.name}; call it {path.stem}.npy")
    for name, value in (("frames", frames), ("step", step), ("stride", stride)):
        if not 1 <= value <= 10_000:
            raise DataError(f"{name} must be a whole number from 1 to 10000, not {value}")
    check_size(*size, "the tensor")


def _images(clip: Video, size: tuple[int, int], progress: Progress | None) -> tuple[list[NDArray[np.uint8]], Array]:
    """Grey images (h, w) of all frames, and their times (n,) in s."""
    images, times = [], []
    for frame in with_progress(clip.frames(), progress, clip.n_expected):
        images.append(grey_levels(frame, size))
        times.append(frame.t_s)
    return images, np.array(times)


def _write_windows(
    file: BinaryIO, images: Sequence[NDArray[np.uint8]], shape: tuple[int, ...], step: int, stride: int
) -> None:
    npy.write_array_header_1_0(file, {"descr": "<f4", "fortran_order": False, "shape": shape})
    for window in range(shape[0]):
        start = window * stride
        chosen = np.stack(images[start : start + (shape[1] - 1) * step + 1 : step])
        file.write((chosen / GREY).astype("<f4").tobytes())


def _document(
    shape: tuple[int, ...], step: int, stride: int, t_s: Array, used: NDArray[np.intp], origin: Mapping[str, Any]
) -> TensorDocument:
    apart = t_s[step:] - t_s[:-step] if shape[1] > 1 else np.array([])
    time_step = float(np.median(apart)) if apart.size else None
    return TensorDocument(
        shape=list(shape),
        time_step_s=time_step,
        time_step_spread_s=float(np.max(np.abs(apart - time_step))) if time_step is not None else None,
        step=step,
        stride=stride,
        t_s=t_s[used].tolist(),
        origin=dict(origin),
    )


def _origin(clip: Video, frames: int, step: int, stride: int, size: tuple[int, int]) -> dict[str, Any]:
    return origin_of(clip.path, {"frames": frames, "step": step, "stride": stride, "size": list(size)})
