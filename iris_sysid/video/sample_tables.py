"""Whether the tables of an MP4 agree: those of sizes, of times and of chunks each count the samples of a track.

A changed bit in one of them loses frames of which no decoder speaks (ISO 14496-12, 8.6.1 and 8.7).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

BOX_HEADER = 8  # bytes of a box's length and kind
MAX_BOXES = 1000  # that are looked at in one box
LARGEST_TABLE = 2**26  # bytes; an hour at 1,000 frames/s has 14 MB of sizes
TABLES = (b"stsz", b"stts", b"stsc", b"stco", b"co64")
PICTURES = b"vide"  # the kind of a track, in its box hdlr

Box = tuple[bytes, int, int]


def boxes(file: BinaryIO, start: int, end: int) -> Iterator[Box]:
    """Kind, start and stated length of the boxes between two places of a file, bytes (ISO 14496-12, 4.2).

    The last one is the first that states a length below that of its own header; 0 means: to the end.
    """
    position, length = start, BOX_HEADER
    while position < end and length >= BOX_HEADER:
        file.seek(position)
        head = file.read(16)
        length = int.from_bytes(head[8:16], "big") if head[:4] == b"\0\0\0\1" else int.from_bytes(head[:4], "big")
        yield head[4:8], position, length
        position += length


def what_disagrees(file: BinaryIO, size: int) -> str:
    """How the tables of a track of pictures disagree; empty where they agree, or are not there.

    Parameters
    ----------
    file
        An MP4 or MOV file.
    size
        Its length, bytes.
    """
    for track in _inside(file, 0, size, b"moov", b"trak"):
        counts = _counts(file, track)
        if len(set(counts.values())) > 1:
            return "its tables disagree: " + ", ".join(f"{count:.15g} {what}" for what, count in counts.items())
    return ""


def _counts(file: BinaryIO, track: tuple[int, int]) -> dict[str, float]:
    """How many samples each table of a track counts; none where it holds no pictures."""
    kinds = [_numbers(file, start, end)[2:3].tobytes() for start, end in _inside(file, *track, b"mdia", b"hdlr")]
    if kinds != [PICTURES]:
        return {}
    tables = {
        kind: _numbers(file, start + BOX_HEADER, min(start + length, end))
        for first, end in _inside(file, *track, b"mdia", b"minf", b"stbl")
        for kind, start, length in islice(boxes(file, first, end), MAX_BOXES)
        if kind in TABLES
    }
    counts: dict[str, float] = {}
    if b"stsz" in tables:
        counts["sizes"] = float(tables[b"stsz"][2:3].sum())
    if b"stts" in tables:
        counts["times"] = float(_entries(tables[b"stts"], 2)[:, 0].sum())
    chunks = tables.get(b"stco", tables.get(b"co64"))
    if b"stsc" in tables and chunks is not None:
        counts["samples in chunks"] = _in_chunks(_entries(tables[b"stsc"], 3), float(chunks[1:2].sum()))
    return counts


def _in_chunks(entries: NDArray[np.float64], chunks: float) -> float:
    """Samples in all chunks: an entry (n, 3) holds the first chunk, numbered from 1, with so many samples a chunk."""
    first = np.append(entries[:, 0], chunks + 1)
    return float(np.sum(np.diff(first) * entries[:, 1]))


def _entries(table: NDArray[np.uint32], width: int) -> NDArray[np.float64]:
    """The rows (n, width) of a table, which begins with a version and their number."""
    rows = table[2:]
    whole = rows[: rows.size // width * width].reshape(-1, width)
    return whole[: int(table[1:2].sum())].astype(np.float64)


def _numbers(file: BinaryIO, start: int, end: int) -> NDArray[np.uint32]:
    """The unsigned numbers of four bytes between two places of a file."""
    file.seek(start)
    read = file.read(min(max(end - start, 0), LARGEST_TABLE))
    return np.frombuffer(read, ">u4", len(read) // 4)


def _inside(file: BinaryIO, start: int, end: int, *kinds: bytes) -> list[tuple[int, int]]:
    """Start and end of what the boxes hold that lie along a path of kinds between two places of a file."""
    places = [(start, end)]
    for kind in kinds:
        places = [
            (at + BOX_HEADER, min(at + length, last))
            for first, last in places
            for name, at, length in islice(boxes(file, first, last), MAX_BOXES)
            if name == kind
        ]
    return places
