"""Whether a file's own structure is whole to its end: chains of pages, packets, tags, elements and boxes.

A file that was cut off while it was recorded or copied often plays as a shorter clip. These formats number or measure
their parts, which shows a cut that no header speaks of. A cut between two parts of a format that marks no end (MPEG-TS,
live Matroska, fragmented MP4) cannot be seen.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from iris_sysid.video.sample_tables import BOX_HEADER, boxes, what_disagrees

OGG_HEADER, OGG_LAST = 27, 0x04  # bytes; flag of a stream's last page (RFC 3533, section 6)
REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
FLV_FILE_HEADER, FLV_TAG_HEADER, FLV_BACK = 9, 11, 4  # bytes (Adobe FLV 10.1, E.2 to E.4)
TS_SYNC, TS_PACKET, TS_NULL = 0x47, 188, 0x1FFF  # ISO 13818-1, 2.4.3
TS_AT_ONCE = 100_000  # packets, 19 MB
FILE_PROPERTIES = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365")  # ASF specification, 10.1
ASF_BROADCAST = 0x01
UNKNOWN_SIZE = -1
EBML_HEADER, SEGMENT = 0x1A45DFA3, 0x18538067  # RFC 8794 and RFC 9559


def what_is_cut(path: Path, kind: str) -> str:
    """Why the file's structure is not whole to its end; empty where it is, or where the format does not tell.

    Parameters
    ----------
    path
        The file.
    kind
        Name of its format, as the demuxer has it.
    """
    for name, check in CHECKS.items():
        if name in kind.split(","):
            with path.open("rb") as file:
                return check(file, os.fstat(file.fileno()).st_size)
    return ""


def _ogg(file: BinaryIO, size: int) -> str:
    """Pages have a checksum, those of each stream are numbered, and the last one says so."""
    position, last = 0, dict[bytes, tuple[int, int]]()
    while position < size:
        file.seek(position)
        header = file.read(OGG_HEADER)
        if len(header) < OGG_HEADER:
            return "its last page is cut off"
        if header[:4] != b"OggS":
            return f"no page begins at byte {position}, where one must"
        lengths = file.read(header[26])
        if position + OGG_HEADER + header[26] + sum(lengths) > size:
            return "its last page is cut off"
        if _ogg_checksum(header, lengths + file.read(sum(lengths))) != int.from_bytes(header[22:26], "little"):
            return f"the page at byte {position} is damaged"
        stream, number = header[14:18], int.from_bytes(header[18:22], "little")
        if stream in last and number != (last[stream][0] + 1) % 2**32:
            return f"page {number} of a stream follows page {last[stream][0]}"
        last[stream] = number, header[5]
        position += OGG_HEADER + header[26] + sum(lengths)
    return "" if all(flags & OGG_LAST for _, flags in last.values()) else "the last page of a stream is missing"


def _ogg_checksum(header: bytes, rest: bytes) -> int:
    """CRC-32 of a page with 0 in place of its checksum, highest bit first: zlib's with all bits in reverse."""
    page = (header[:22] + bytes(4) + header[26:] + rest).translate(REVERSED)
    return int(f"{zlib.crc32(page, 0xFFFFFFFF) ^ 0xFFFFFFFF:032b}"[::-1], 2)


def _transport_stream(file: BinaryIO, size: int) -> str:
    """Packets have one length, and those of a stream are numbered from 0 to 15 and again from 0."""
    if file.read(1) != bytes([TS_SYNC]):
        return ""  # another length of packets, or a beginning without one: ends are not told
    file.seek(0)
    counters = np.full(TS_NULL + 1, -1)
    for first in range(0, size // TS_PACKET, TS_AT_ONCE):
        read = file.read(TS_AT_ONCE * TS_PACKET)
        packets = np.frombuffer(read, np.uint8, len(read) // TS_PACKET * TS_PACKET).reshape(-1, TS_PACKET)
        out_of_step = np.flatnonzero(packets[:, 0] != TS_SYNC)
        if out_of_step.size:
            return f"no packet begins at byte {(first + int(out_of_step[0])) * TS_PACKET}, where one must"
        if _skips(packets, counters):
            return "packets are missing"
    return "its last packet is cut off" if size % TS_PACKET else ""


def _skips(packets: NDArray[np.uint8], counters: NDArray[np.int_]) -> bool:
    """Whether a stream's counter skips a value in packets (n, 188); ``counters`` hold the last one of each stream."""
    head = packets[:, :6].astype(np.int64)
    streams = (head[:, 1] & 0x1F) << 8 | head[:, 2]
    has_payload, has_field = head[:, 3] & 0x10 > 0, head[:, 3] & 0x20 > 0
    restarts = has_field & (head[:, 4] > 0) & (head[:, 5] & 0x80 > 0)  # the stream says that its counter jumps
    damaged = head[:, 1] & 0x80 > 0
    counted = has_payload & (streams != TS_NULL) & ~damaged
    for stream in np.unique(streams[counted]):
        which = np.flatnonzero(counted & (streams == stream))
        now = head[which, 3] & 0x0F
        before = np.concatenate([[counters[stream]], now[:-1]])
        step = (now - before) % 16
        if np.any((before >= 0) & (step > 1) & ~restarts[which]):  # 0: a packet may be sent twice
            return True
        counters[stream] = now[-1]
    return False


def _flash(file: BinaryIO, size: int) -> str:
    """Each tag is followed by its length."""
    position = FLV_FILE_HEADER + FLV_BACK
    while position < size:
        file.seek(position)
        header = file.read(FLV_TAG_HEADER)
        position += FLV_TAG_HEADER + int.from_bytes(header[1:4], "big") + FLV_BACK
    return "its last tag is cut off" if position > size else ""


def _matroska(file: BinaryIO, size: int) -> str:
    """Elements state their length; a live recording leaves that of the segment and its clusters open."""
    position = 0
    while position < size:
        file.seek(position)
        identity, length, data = _element(file)
        if length == UNKNOWN_SIZE or (identity == SEGMENT and data + length == size):
            position = data
            continue
        if data + length > size:
            return "its last element is cut off"
        if data + length <= position:
            return ""
        position = data + length
    return ""


def _element(file: BinaryIO) -> tuple[int, int, int]:
    """Identity, length (UNKNOWN_SIZE where open) and start of the data of the element that begins here."""
    identity = _variable_integer(file, keep_marker=True)
    length = _variable_integer(file, keep_marker=False)
    return identity, length, file.tell()


def _variable_integer(file: BinaryIO, *, keep_marker: bool) -> int:
    """A whole number of 1 to 8 bytes (RFC 8794, section 4); UNKNOWN_SIZE where all its bits are set."""
    first = file.read(1)
    if not first or not first[0]:
        return 0
    length = 9 - first[0].bit_length()
    value = int.from_bytes(first + file.read(length - 1), "big")
    without = value & ((1 << 7 * length) - 1)
    if keep_marker:
        return value
    return UNKNOWN_SIZE if without == (1 << 7 * length) - 1 else without


def _boxes(file: BinaryIO, size: int) -> str:
    """Boxes state their length, and their tables count the same samples."""
    ends = [(start, length) for _, start, length in boxes(file, 0, size)]
    cut = any(0 < length < BOX_HEADER or start + length > size for start, length in ends)
    return "its last box is cut off" if cut else what_disagrees(file, size)


def _windows_media(file: BinaryIO, size: int) -> str:
    """The header states the size of the file, unless it was made for a broadcast (ASF specification, 3.2)."""
    header = file.read(4096)
    at = header.find(FILE_PROPERTIES)
    if at < 0 or len(header) < at + 92 or header[at + 88] & ASF_BROADCAST:
        return ""
    stated = int.from_bytes(header[at + 40 : at + 48], "little")
    return f"the file has {size} bytes, its header says {stated}" if size < stated else ""


CHECKS: dict[str, Callable[[BinaryIO, int], str]] = {
    "ogg": _ogg,
    "mpegts": _transport_stream,
    "flv": _flash,
    "matroska": _matroska,
    "mov": _boxes,
    "asf": _windows_media,
}
