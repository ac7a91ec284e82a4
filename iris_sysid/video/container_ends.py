"""Whether a file's own structure is whole to its end, where neither its header nor a decoder tells.

Ogg and MPEG-TS state no duration, and a fragmented MP4 none of its last fragments: cut off, they play as shorter clips.
Ogg numbers its pages, packets of MPEG-TS have one length, boxes of MP4 state theirs, and WMV that of the whole file.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO

OGG_HEADER, OGG_LAST = 27, 0x04  # bytes; flag of a stream's last page (RFC 3533, section 6)
REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
TS_SYNC, TS_PACKET = b"\x47", 188  # ISO 13818-1, 2.4.3
BOX_HEADER = 8  # bytes of a box's length and kind
FILE_PROPERTIES = bytes.fromhex("a1dcab8c47a9cf118ee400c00c205365")  # ASF specification, 10.1
ASF_BROADCAST = 0x01


def truncation_reason(path: Path, kind: str) -> str:
    """Why a file's structure is not whole to its end; empty where it is, or where its format does not tell.

    ``kind`` is the name of its format, as the demuxer has it.
    """
    for name, check in CHECKS.items():
        if name in kind.split(","):
            with path.open("rb") as file:
                return check(file, os.fstat(file.fileno()).st_size)
    return ""


def boxes(file: BinaryIO, size: int) -> Iterator[tuple[bytes, int]]:
    """Kind, and the place where it should end (bytes), of every top-level box of an MP4 (ISO 14496-12, 4.2).

    The last one is the first that states a length below that of its own header; 0 means: to the end.
    """
    position, length = 0, BOX_HEADER
    while position < size and length >= BOX_HEADER:
        file.seek(position)
        head = file.read(16)
        length = int.from_bytes(head[8:16], "big") if head[:4] == b"\0\0\0\1" else int.from_bytes(head[:4], "big")
        yield head[4:8], position + length
        position += length


def _ogg(file: BinaryIO, size: int) -> str:
    """Pages have a checksum, those of each stream are numbered, and a flag marks the last one."""
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
    """A cut rarely falls between two packets; the demuxer marks packets that are missing within the stream."""
    return "its last packet is cut off" if file.read(1) == TS_SYNC and size % TS_PACKET else ""


def _mp4(file: BinaryIO, size: int) -> str:
    return "its last box is cut off" if any(end > size for _, end in boxes(file, size)) else ""


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
    "mov": _mp4,
    "asf": _windows_media,
}
