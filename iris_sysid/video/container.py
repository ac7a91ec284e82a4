"""Video files through PyAV: opened without trusting name or header, decoded in order, checked at the end."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from pathlib import Path

import av
from av.container import InputContainer
from av.stream import Discard, Disposition
from av.video.stream import VideoStream

from iris_sysid.errors import VideoError
from iris_sysid.video.completeness import EMPTY_PACKET_BYTES, Promise, StreamCounts, promise_of, what_is_missing
from iris_sysid.video.container_ends import boxes, truncation_reason
from iris_sysid.video.even_times import EvenTimes, even_times, is_coarse
from iris_sysid.video.pixel_formats import Orientation, coding_of, orientation_of

MAX_SIDE_PX = 16384
MAX_PIXELS = 2**28

# Containers that hold their own data; playlists (hls, concat, dash) and name patterns (image2) would open other files.
_FORMATS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,gif,apng,mpegts,mpeg,mpegvideo,m4v,asf,flv,ogg,h264,hevc,obu,ivf,"
    "mjpeg,yuv4mpegpipe,mxf,nut,dv,wav,mp3,aac,flac"
)
_OPTIONS = {
    "format_whitelist": _FORMATS,
    "protocol_whitelist": "file",
    "max_pixels": str(MAX_PIXELS),
}
DECODED_AHEAD = 4  # images beside one a processor: what is done with one must not keep the decoder waiting
MAX_DECODED = 16  # at once, 12 MB each of 3840x2160
# AVI states no times to show its frames at: their order in the file, which with B-frames is not that of showing
_IN_DECODING_ORDER = {"avi"}
_NO_TIMESTAMPS = 0x0080  # AVFMT_NOTIMESTAMPS: a bare stream of images, such as .h264
CAPTURE_RATE = "com.android.capture.fps"  # what Android writes into files of slow motion
FASTEST_HZ = 1e5


class DamageError(Exception):
    """The rest of the file cannot be read, and why; the images before it are good."""


@dataclass(eq=False)
class ContainerSource:
    """A video file that was opened, checked, and whose first image was decoded.

    ``width`` and ``height`` are as displayed. ``rate`` is the header's average in 1/s, None when it does
    not say; ``time_base`` is the unit of the file's stamps in s. ``first_s`` is the time of the first
    image as the container has it (it need not be 0). ``even`` are the times without their rounding, where the rate
    is even.
    """

    path: Path
    label: str
    width: int
    height: int
    coded_size: tuple[int, int]
    orientation: Orientation
    time_base: Fraction | None
    rate: float | None
    first_s: float | None
    promise: Promise
    facts: dict[str, object]
    note: str = ""
    timeless: bool = False
    even: EvenTimes | None = None
    reordered: bool = False

    @property
    def expected(self) -> int:
        """Number of frames that the header promises, or about that by its duration; 0 when neither is there."""
        return self.promise.frames

    @cached_property
    def cut(self) -> str:
        """Why the file's structure does not go on to its end; empty where it does, or its format does not tell."""
        return truncation_reason(self.path, str(self.facts["format"]))

    def images(self) -> Generator[tuple[float | None, av.VideoFrame]]:
        """Every image in display order with its time in s (None where the file has none).

        Raises DamageError where the file stops being readable, or at its end when images are missing.
        """
        tally = StreamCounts()
        with _opened_again(self.path, self.label) as (container, stream):
            stream.thread_type = "AUTO"
            stream.codec_context.thread_count = min((os.cpu_count() or 1) + DECODED_AHEAD, MAX_DECODED)
            stamps = iter(self._decoding_stamps() if self.reordered else ())
            for image in _decoded(container, stream, tally):
                stamp = next(stamps, None) if self.reordered else image.pts
                seconds = None if self.timeless or stamp is None else self.seconds(stamp)
                tally.count_image(image, seconds)
                if (image.width, image.height) != self.coded_size:
                    raise DamageError(f"the image's size changes to {image.width}x{image.height} px")
                yield seconds, image
            reason = what_is_missing(self.promise, tally, stream, self.path)
        if reason:
            raise DamageError(reason)

    def survey(self) -> list[tuple[int, bool]]:
        """Stamp, and whether a key frame, of every frame in display order, without decoding; [] where unstamped."""
        listed: list[tuple[int, bool]] = []
        if self.reordered:
            return []
        with suppress(av.FFmpegError), _opened(self.path, self.label) as (container, stream):
            for packet in _packets(container, stream):
                if packet.size <= EMPTY_PACKET_BYTES or packet.is_discard or packet.is_corrupt:
                    continue
                if packet.pts is None or self.timeless:
                    return []
                listed.append((packet.pts, packet.is_keyframe))
        return sorted(listed)

    def _decoding_stamps(self) -> list[int]:
        """Stamps of all frames in the order of decoding: the k-th image shown has the k-th of them."""
        with _opened_again(self.path, self.label) as (container, stream), suppress(av.FFmpegError):
            packets = _packets(container, stream)
            return sorted(p.dts for p in packets if p.dts is not None and p.size > EMPTY_PACKET_BYTES)
        return []

    def seconds(self, stamp: int) -> float | None:
        """The time in s of a stamp."""
        unrounded = stamp if self.even is None else self.even.unrounded(stamp)
        return None if self.time_base is None else _seconds(unrounded, self.time_base)

    def orientation_for(self, image: av.VideoFrame) -> Orientation:
        """How that image is turned for display: all as the first."""
        return self.orientation

    def pick(self, bursts: Sequence[tuple[int, Sequence[int]]]) -> Iterator[tuple[int, av.VideoFrame]]:
        """Images with the wanted stamps, by seeking: each burst is a key frame's stamp and the wanted ones after it.

        Unreadable frames are left out. Two decoders share the work: one decoder of several threads decodes ahead of
        every seek for nothing.
        """
        half = -(-len(bursts) // 2)
        with ThreadPoolExecutor(2) as pool:
            for found in pool.map(self._picked, (bursts[:half], bursts[half:])):
                yield from found

    def images_from(self, stamp: int) -> Generator[tuple[int, av.VideoFrame]]:
        """Stamp and image of every frame from the key frame with that stamp on, by one thread: a seek wastes none.

        Frames that refer to what is before the key frame are left out.
        """
        with _opened_again(self.path, self.label) as (container, stream):
            stream.thread_type = "NONE"
            try:
                container.seek(stamp, stream=stream)
                for packet in _packets(container, stream):
                    yield from _stamped(packet.decode() if packet.size else [])
                yield from _stamped(stream.codec_context.decode(None))
            except av.FFmpegError as error:
                raise DamageError(f"it cannot be decoded from stamp {stamp} on ({error.strerror})") from error

    def _picked(self, bursts: Sequence[tuple[int, Sequence[int]]]) -> list[tuple[int, av.VideoFrame]]:
        found: list[tuple[int, av.VideoFrame]] = []
        with _opened(self.path, self.label) as (container, stream):
            stream.thread_type = "NONE"
            for key, wanted in bursts:
                with suppress(av.FFmpegError, DamageError):
                    container.seek(key, stream=stream)
                    found += _wanted(_decoded(container, stream, StreamCounts()), wanted)
        return found


def open_container(path: Path, label: str) -> ContainerSource:
    """Open a video file: check its type and image size, then decode the first image.

    Raises VideoError, which states the actual file type or the fault.
    """
    try:
        with _opened(path, label) as (container, stream):
            promise = promise_of(container, stream, path)
            image = _first_image(container, stream, promise, label)
            timeless = bool(container.format.flags & _NO_TIMESTAMPS) or image.pts is None
            orientation = orientation_of(image)
            width, height = orientation.size(image.width, image.height)
            check_size(image.width, image.height, label)
            rate = stream.average_rate
            source = ContainerSource(
                path=path,
                label=label,
                width=width,
                height=height,
                coded_size=(image.width, image.height),
                orientation=orientation,
                time_base=stream.time_base,
                rate=float(rate) if rate and not timeless else None,
                first_s=None if timeless or not stream.time_base else _seconds(image.pts or 0, stream.time_base),
                promise=promise,
                facts=_facts(container, stream, image),
                note=_rotation_note(image),
                timeless=timeless,
                reordered=container.format.name in _IN_DECODING_ORDER and bool(stream.codec_context.has_b_frames),
            )
            if source.reordered:
                source.first_s = source.seconds(min(source._decoding_stamps(), default=0))
            source.even = _even(source, (rate, stream.guessed_rate, stream.base_rate))
            return source
    except av.FFmpegError as error:
        raise VideoError(f"{label} cannot be read as a video: {_why(path, error)}; no frame was read") from error


def check_size(width: int, height: int, label: str) -> None:
    """Raise VideoError for images without a size, or too large to be meant."""
    if width < 1 or height < 1:
        raise VideoError(f"{label} gives no size of its images, or one beyond {MAX_PIXELS} px; no frame was read")
    if max(width, height) > MAX_SIDE_PX or width * height > MAX_PIXELS:
        raise VideoError(
            f"{label} claims images of {width}x{height} px; at most {MAX_SIDE_PX} px a side and {MAX_PIXELS} px "
            "in all are read: make it smaller, if the size is right; no frame was read"
        )


# --------------------------------------------------------------------------- opening


@contextmanager
def _opened(path: Path, label: str) -> Iterator[tuple[InputContainer, VideoStream]]:
    """The container and its video stream. The name is never read as a protocol or a pattern."""
    with av.open("file:" + os.fspath(path), "r", options=_OPTIONS, metadata_errors="replace") as container:
        stream = _video_stream(container, label)
        for other in container.streams:
            if other.index != stream.index:
                other.discard = Discard.all
        stream.codec_context.options = {"max_pixels": str(MAX_PIXELS)}
        yield container, stream


@contextmanager
def _opened_again(path: Path, label: str) -> Iterator[tuple[InputContainer, VideoStream]]:
    """As :func:`_opened`, for a file that could be opened before."""
    try:
        with _opened(path, label) as opened:
            yield opened
    except av.FFmpegError as error:
        raise DamageError(f"it can no longer be opened ({error.strerror})") from error


def _video_stream(container: InputContainer, label: str) -> VideoStream:
    found = [stream for stream in container.streams.video if not stream.disposition & Disposition.attached_pic]
    if not found:
        kinds = ", ".join(sorted({stream.type for stream in container.streams})) or "nothing"
        raise VideoError(f"{label} holds no video, only: {kinds}; no frame was read")
    stream = found[0]
    if stream.codec_context is None:
        raise VideoError(f"{label} is coded in a way that this decoder does not know; convert it to H.264")
    check_size(stream.codec_context.width, stream.codec_context.height, label)
    return stream


def _first_image(container: InputContainer, stream: VideoStream, promise: Promise, label: str) -> av.VideoFrame:
    promised = f"{promise.frames} frames are promised" if promise.frames else "the file promises none"
    try:
        image = next(_decoded(container, stream, StreamCounts()), None)
    except DamageError as damage:
        raise VideoError(f"{label}: no frame could be read, {promised}: {damage}") from damage
    if image is None:
        raise VideoError(f"{label}: it is a video with no frame in it that can be decoded, {promised}")
    return image


def _why(path: Path, error: av.FFmpegError) -> str:
    """Type of a file that is not a video, from its first bytes."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(512)
    if size == 0:
        return "it is empty (0 bytes)"
    if head[4:8] == b"ftyp" and not _has_box(path, b"moov"):
        return f"it is an MP4 without its index (moov box), as when recording or copying was cut off ({size} bytes)"
    if all(byte in b"\t\n\r\f" or 32 <= byte < 127 for byte in head):
        return f"it is a text file that begins with {head[:40].decode('ascii').split(chr(10))[0]!r}"
    return f"its format is unknown, or its beginning is damaged ({error.strerror or error})"


def _has_box(path: Path, kind: bytes) -> bool:
    """Whether an MP4 has a whole top-level box of that kind."""
    size = path.stat().st_size
    with path.open("rb") as file:
        return any(name == kind and end <= size for name, end in boxes(file, size))


# --------------------------------------------------------------------------- decoding


def _packets(container: InputContainer, stream: VideoStream) -> Iterator[av.Packet[VideoStream]]:
    """The stream's packets, without the empty one with which PyAV ends."""
    try:
        yield from (packet for packet in container.demux(stream) if packet.dts is not None or packet.size)
    except IndexError:  # PyAV 18.1: so ends a transport stream in which another stream begins late
        return


def _decoded(container: InputContainer, stream: VideoStream, tally: StreamCounts) -> Iterator[av.VideoFrame]:
    """Images in display order up to the end or the first damage, which is raised as DamageError."""
    try:
        for packet in _packets(container, stream):
            tally.count_packet(packet)
            if packet.is_corrupt:
                break
            if packet.size:
                yield from _sound(packet.decode())
        yield from _sound(stream.codec_context.decode(None))  # those that the decoder still holds
    except av.FFmpegError as error:
        raise DamageError(f"packet {tally.packets} cannot be decoded ({error.strerror})") from error
    if tally.cut_off:
        raise DamageError(f"packet {tally.packets} is cut off or damaged")


def _sound(images: Sequence[av.VideoFrame]) -> Iterator[av.VideoFrame]:
    """Images that decoded without an error that had to be concealed."""
    for image in images:
        if image.is_corrupt:
            raise DamageError("the data of a frame is damaged")
        yield image


def _stamped(images: Sequence[av.VideoFrame]) -> Iterator[tuple[int, av.VideoFrame]]:
    """The sound images that have a stamp, with it."""
    return ((image.pts, image) for image in images if image.pts is not None and not image.is_corrupt)


def _wanted(images: Iterator[av.VideoFrame], stamps: Sequence[int]) -> Iterator[tuple[int, av.VideoFrame]]:
    left = set(stamps)
    for image in images:
        if image.pts in left:
            left.remove(image.pts)
            yield image.pts, image
        if not left or (image.pts is not None and image.pts > max(left)):
            return


def _even(source: ContainerSource, rates: Sequence[Fraction | None]) -> EvenTimes | None:
    """The times without their rounding, where the unit is coarse and all frames are at one of the rates stated."""
    if source.time_base is None or source.timeless or not any(is_coarse(rate, source.time_base) for rate in rates):
        return None
    return even_times([stamp for stamp, _ in source.survey()], rates, source.time_base)


def _seconds(stamp: int | Fraction, time_base: Fraction) -> float:
    """The stamp in s: one division of whole numbers, so the nearest float to the exact time."""
    return stamp.numerator * time_base.numerator / (stamp.denominator * time_base.denominator)


def _rotation_note(image: av.VideoFrame) -> str:
    if image.rotation % 90 == 0:
        return ""
    return f"the file asks to be shown turned by {image.rotation} degrees; the nearest right angle was used"


def _facts(container: InputContainer, stream: VideoStream, image: av.VideoFrame) -> dict[str, object]:
    aspect = stream.sample_aspect_ratio
    return {
        "format": container.format.name,
        "codec": stream.codec_context.name,
        "pixel_format": image.format.name,
        "luma_range": {1: "limited", 2: "full"}.get(image.color_range, "not stated"),
        "transfer": coding_of(image).transfer or "not stated",
        "pixel_aspect": float(aspect) if aspect else 1.0,
        **_capture_rate(container, stream),
    }


def _capture_rate(container: InputContainer, stream: VideoStream) -> dict[str, object]:
    """The rate at which a phone says that it recorded, 1/s; nothing where the file does not state one."""
    for metadata in (container.metadata, stream.metadata):
        try:
            rate = float(metadata.get(CAPTURE_RATE, ""))
        except ValueError:
            continue
        if 0 < rate < FASTEST_HZ:
            return {"capture_rate": rate}
    return {}
