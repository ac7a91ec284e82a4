"""Frames to a video file with exact times, by PyAV; encoding runs beside rendering, with the same bytes each time."""

from __future__ import annotations

import queue
import threading
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import av
import av.video.stream
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import OutputError
from iris_sysid.synthetic.look import Look

FORMATS = {".mp4": "mp4", ".m4v": "mp4", ".mov": "mov", ".mkv": "matroska"}
QUEUE = 4  # frames in flight between rendering and encoding
FULL_RANGE = 2  # AVCOL_RANGE_JPEG
BT709 = 1
# Transfer functions by number (ITU-T H.273, table 3)
TRANSFER_TAGS = {"bt709": 1, "gamma=2.2": 4, "gamma=2.8": 5, "linear": 8, "srgb": 13, "pq": 16, "hlg": 18}
UNSPECIFIED = 2


class Encoder:
    """Write frames to a file: ``with Encoder(...) as encoder: encoder.write(frame, ticks)``."""

    def __init__(self, path: Path, size: tuple[int, int], rate: Fraction, look: Look) -> None:
        self.size, self.tick = size, 1 / rate
        try:
            self.container = av.open(str(path), "w", format=FORMATS[path.suffix.lower()])
            self.stream = _stream(self.container, size, rate, look)
        except av.FFmpegError as error:
            raise OutputError(f"cannot write {path}: {error.strerror}; give another path or codec") from error
        self.waiting: queue.Queue[av.VideoFrame | None] = queue.Queue()
        self.free: queue.Queue[av.VideoFrame] = queue.Queue()
        for _ in range(QUEUE):  # used again and again: fresh memory costs more than the painting
            self.free.put(av.VideoFrame(*size, "yuv420p"))
        self.failure: BaseException | None = None
        self.worker = threading.Thread(target=self._encode, daemon=True)

    def __enter__(self) -> Encoder:
        self.worker.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.waiting.put(None)
        self.worker.join()
        self.container.close()
        if self.failure is not None and kind is None:
            raise OutputError(f"the video could not be encoded: {self.failure}") from self.failure

    def blank(self) -> tuple[av.VideoFrame, tuple[NDArray[np.uint8], ...]]:
        """A frame to fill, and its three planes as writable arrays (h, w), (h/2, w/2), (h/2, w/2)."""
        frame = self.free.get()
        return frame, tuple(_array(plane) for plane in frame.planes)

    def write(self, frame: av.VideoFrame, ticks: int) -> None:
        """Queue a frame for display at ``ticks`` times one over the frame rate."""
        if self.failure is not None:
            raise OutputError(f"the video could not be encoded: {self.failure}") from self.failure
        frame.pts, frame.time_base = ticks, self.tick
        frame.color_range = FULL_RANGE
        self.waiting.put(frame)

    def _encode(self) -> None:
        while (frame := self.waiting.get()) is not None:
            if self.failure is None:
                self._encode_one(frame)
            self.free.put(frame)  # the encoder has copied it: it runs in this thread alone
        if self.failure is None:
            self._encode_one(None)

    def _encode_one(self, frame: av.VideoFrame | None) -> None:
        try:
            self.container.mux(self.stream.encode(frame))
        except (av.FFmpegError, ValueError, MemoryError) as error:
            self.failure = error


def _array(plane: Any) -> NDArray[np.uint8]:
    return np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)[:, : plane.width]


def _stream(container: Any, size: tuple[int, int], rate: Fraction, look: Look) -> Any:
    stream = container.add_stream("ffv1" if look.codec == "ffv1" else "libx264", rate=rate)
    stream.width, stream.height = size
    stream.pix_fmt = "yuv420p"
    context = stream.codec_context
    context.time_base = 1 / rate
    context.color_range, context.colorspace = FULL_RANGE, BT709
    tag = look.transfer if look.transfer_tag is None else look.transfer_tag
    context.color_primaries, context.color_trc = BT709, TRANSFER_TAGS.get(tag, UNSPECIFIED)
    context.thread_count = 1  # so that the bytes do not depend on the machine
    if look.codec == "h264":
        stream.bit_rate = int(look.bits_per_second(size, float(rate)))
        # no frames predicted from later ones: as phones write, and no offset in the times
        stream.options = {"preset": "superfast", "bf": "0", "g": str(max(1, round(float(rate))))}
    elif look.codec == "lossless":
        stream.options = {"preset": "ultrafast", "qp": "0", "bf": "0"}
    return stream
