"""Completeness of a video: its declared content, the content read, and the difference."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import av
from av.container import InputContainer
from av.video.stream import VideoStream

EMPTY_PACKET_BYTES = 8  # an MPEG-4 "not coded" image, which repeats the last one, has 7
_STATE_DURATION = ("matroska", "mov", "flv", "asf")  # others have it guessed, from what is there or the bit rate
_DECODER_DELAY = 64  # images; beyond that of any decoder


@dataclass(frozen=True, slots=True)
class Promise:
    """Declared content of a file.

    ``packets`` are those in its index, ``frames`` the images to be shown (0 where it does not say),
    ``end_s`` the end of its last image, where known only from a duration.
    """

    packets: int = 0
    frames: int = 0
    end_s: float | None = None


@dataclass(slots=True)
class StreamCounts:
    """Content read so far: packets, those of them without an image, and images."""

    packets: int = 0
    silent: int = 0
    images: int = 0
    interlaced: bool = False
    cut_off: bool = False
    end_s: float = float("-inf")
    longest_s: float = 0.0
    first_pts: int | None = None
    early_pts: list[int] = field(default_factory=list)

    def count_packet(self, packet: av.Packet[VideoStream]) -> None:
        """Count a packet from the file."""
        self.packets += 1
        self.cut_off |= packet.is_corrupt
        self.silent += packet.is_discard or packet.size <= EMPTY_PACKET_BYTES
        if packet.pts is not None and len(self.early_pts) < _DECODER_DELAY:
            self.early_pts.append(packet.pts)

    def count_image(self, image: av.VideoFrame, seconds: float | None) -> None:
        """Count an image from the decoder, with its time."""
        self.images += 1
        self.interlaced |= image.interlaced_frame
        if self.first_pts is None:
            self.first_pts = image.pts
        if seconds is not None:
            self.longest_s = max(self.longest_s, seconds - self.end_s) if self.images > 1 else 0.0
            self.end_s = seconds

    @property
    def lost(self) -> int:
        """Packets that should have given an image and did not; those before the first key frame do not count."""
        lead = 0 if self.first_pts is None else sum(pts < self.first_pts for pts in self.early_pts)
        return self.packets - self.silent - lead - self.images


def promise_of(container: InputContainer, stream: VideoStream, path: Path) -> Promise:
    """Number of frames that the file's index promises, or else its header."""
    kind, listed = container.format.name, len(stream.index_entries)
    if kind.startswith("mov") and stream.frames:
        hidden = sum(entry.is_discard for entry in stream.index_entries)  # before or after an edit list's cut
        return Promise(packets=listed, frames=listed - hidden)
    if kind == "gif":  # its header says nothing; the count is of what could be found
        return Promise(frames=stream.frames)
    duration, rate = _duration_s(container, stream), stream.average_rate
    if kind == "avi" and stream.frames:  # the header counts repeated images too, which the index leaves out
        whole = listed > 1 and stream.index_entries[listed - 1].timestamp + 1 >= stream.frames
        return Promise(listed, listed) if whole else Promise(0, stream.frames, duration)
    frames = round(duration * rate) if duration and rate else 0
    if not kind.startswith(_STATE_DURATION) or frames > path.stat().st_size:  # less than a byte a frame: damaged
        return Promise()
    return Promise(0, frames, duration)


def what_is_missing(promise: Promise, tally: StreamCounts, stream: VideoStream, path: Path) -> str:
    """Why the end of the stream is not the end of the clip; empty when it is.

    Parameters
    ----------
    promise
        Content of the header.
    tally
        Decoded content.
    stream
        The stream, for its codec and its rate.
    path
        The file.
    """
    if tally.packets < promise.packets:
        return "the file ends early"
    if promise.end_s is not None:
        # the end is stated to a frame or so, and at an uneven rate to the longest frame
        slack = max(0.1, 3 / float(stream.average_rate or math.inf), 2 * tally.longest_s)
        if tally.end_s < promise.end_s - slack:
            return f"it ends at {tally.end_s:.3f} s, its header says {promise.end_s:.3f} s"
    if stream.codec_context.name == "gif" and not _gif_is_whole(path):
        return "its end is missing or damaged"
    # VP8 has packets that are never shown; an interlaced image may come in two packets
    countable = stream.codec_context.name != "vp8" and not tally.interlaced
    if countable and tally.lost > max(2, stream.codec_context.reorder_depth):
        return f"{tally.lost} frames could not be decoded"
    return ""


def _duration_s(container: InputContainer, stream: VideoStream) -> float | None:
    """How long the video stream lasts by its own header, in s; None when it does not say."""
    with suppress(ValueError):  # Matroska: 00:00:02.000000000
        hours, minutes, seconds = stream.metadata.get("DURATION", "").split(":")
        return int(hours) * 3600 + int(minutes) * 60 + float(seconds)
    if stream.duration is not None and stream.time_base is not None:
        return float(stream.duration * stream.time_base)
    if container.duration is not None and len(container.streams) == 1:
        return container.duration / av.time_base
    return None


def _gif_is_whole(path: Path) -> bool:
    """Whether a GIF's chain of blocks leads to its trailer (GIF89a specification, appendix B)."""
    with path.open("rb") as file:
        file.seek(10)
        file.seek(13 + _colour_table_bytes(file.read(1)))
        while (kind := file.read(1)) in (b"!", b","):
            if kind == b"!":
                file.seek(1, 1)  # the extension's label
            else:
                file.seek(8, 1)  # the image's place and size
                file.seek(_colour_table_bytes(file.read(1)) + 1, 1)  # 1: code size
            while size := file.read(1):
                if size == b"\0":
                    break
                file.seek(size[0], 1)
    return kind == b";"


def _colour_table_bytes(flags: bytes) -> int:
    return 3 * 2 ** ((flags[0] & 7) + 1) if flags and flags[0] & 0x80 else 0
