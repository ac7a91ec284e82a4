"""Single frames of a clip by number, as JPEG: what was decoded is kept up to a limit, and the next frames are prepared.

A frame is decoded from the key frame before it. Steps forward go on where the decoder is; steps back are served from
the frames kept, and a thread decodes those further back before they are requested.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from contextlib import suppress
from threading import Event, Lock, Thread

import cv2
import numpy as np
from numpy.typing import NDArray

from iris_sysid.errors import VideoError
from iris_sysid.types import Frame
from iris_sysid.video.reader import Video

HELD_BYTES = 160_000_000  # of decoded frames: 51 of 1920x1080, 12 of 3840x2160
MIN_HELD = 4
BYTES_PER_PX = 1.5  # of 4:2:0 video
NEAR = 24  # frames: decoded through rather than entered at a key frame again
AHEAD = 6  # frames prepared after a step forward
QUALITY = 88  # of JPEG, percent


class FrameAccess:
    """Frames of one clip by number; from several threads.

    Attributes
    ----------
    video
        The clip.
    most_held
        Number of decoded frames that are kept.
    """

    def __init__(self, video: Video, held_bytes: int = HELD_BYTES) -> None:
        self.video = video
        self.most_held = max(MIN_HELD, int(held_bytes / (video.width * video.height * BYTES_PER_PX)))
        self._held: OrderedDict[int, Frame] = OrderedDict()
        self._lock = Lock()  # of the frames held
        self._decoding = Lock()  # of the decoder
        self._decoder: Iterator[Frame] = iter(())
        self._next = -1  # number of the frame that the decoder gives next; -1: none
        self._last_asked = 0
        self._wanted: tuple[int, int] | None = None  # first and last frame to prepare
        self._wake, self._closed = Event(), False
        self._worker = Thread(target=self._prepare, name="frames ahead", daemon=True)
        self._worker.start()

    def close(self) -> None:
        """End the thread that prepares frames."""
        self._closed = True
        self._wake.set()
        self._worker.join(timeout=5.0)

    def frame(self, number: int) -> Frame:
        """The frame of that number in the file; VideoError when there is none, or it cannot be decoded."""
        found = self._kept(number)
        if found is None:
            with self._decoding:
                found = self._kept(number) or self._decoded(number)
        step, self._last_asked = number - self._last_asked, number
        reach = self.most_held // 2
        self._wanted = (max(0, number - reach), number - 1) if step < 0 else (number + 1, number + min(AHEAD, reach))
        self._wake.set()
        return found

    def jpeg(self, number: int, width: int | None = None) -> bytes:
        """The frame of that ``number`` as JPEG, at most ``width`` px wide; VideoError as :meth:`frame`."""
        image = self.frame(number).bgr()
        if width is not None and width < image.shape[1]:
            height = max(1, round(image.shape[0] * width / image.shape[1]))
            image = np.asarray(cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)
        return jpeg_of(image)

    def _kept(self, number: int) -> Frame | None:
        with self._lock:
            found = self._held.get(number)
            if found is not None:
                self._held.move_to_end(number)
            return found

    def _decoded(self, number: int) -> Frame:
        """Decode up to a frame, keeping those on the way that fit."""
        if self._next < 0 or not 0 <= number - self._next <= NEAR:
            self._decoder, self._next = self.video.frames_from(max(0, number)), number
        for frame in self._decoder:
            self._next = frame.index + 1
            self._keep(frame)
            if frame.index == number:
                return frame
            if frame.index > number:
                break
        self._decoder, self._next = iter(()), -1
        count = len(self.video.frame_times) or self.video.n_expected
        raise VideoError(f"{self.video.path.name} has no frame {number} to show; it has about {count}, from 0")

    def _keep(self, frame: Frame) -> None:
        with self._lock:
            self._held[frame.index] = frame
            self._held.move_to_end(frame.index)
            while len(self._held) > self.most_held:
                self._held.popitem(last=False)

    def _prepare(self) -> None:
        """Decode what was last wanted, until it is; frames that are requested meanwhile come first."""
        while not self._closed:
            self._wake.wait()
            self._wake.clear()
            with suppress(VideoError):  # asked for itself, the frame says what is wrong
                self._prepare_once()

    def _prepare_once(self) -> None:
        wanted = self._wanted
        if wanted is None or self._closed:
            return
        first, last = wanted
        with self._lock:
            missing = [number for number in range(first, last + 1) if number not in self._held]
        if not missing:
            return
        if first > self._last_asked:  # ahead: the decoder goes on
            for number in missing:
                if self._wanted != wanted or not self._decoding.acquire(timeout=0.5):
                    return
                try:
                    if self._kept(number) is None:
                        self._decoded(number)
                finally:
                    self._decoding.release()
            return
        # behind: by a second decoder, so that the other stays where it is
        if len(missing) < (last - first) // 2 and self._last_asked - missing[-1] > self.most_held // 4:
            return  # near frames are there; wait until more are used up
        for frame in self.video.frames_from(missing[0]):
            if frame.index > missing[-1] or self._closed:
                return
            self._keep(frame)


def jpeg_of(image: NDArray[np.uint8], quality: int = QUALITY) -> bytes:
    """An image (h, w, 3), BGR levels, as JPEG bytes; ``quality`` is that of the format, 1 to 100."""
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes())
