"""Files inside an archive by name: ``file.trz:NAME``."""

from __future__ import annotations

import lzma
import os
import re
import struct
import zipfile
import zlib
from collections.abc import Iterable
from pathlib import Path, PurePosixPath

IN_ARCHIVE = re.compile(r"(.+\.(?:trz|zip)):(.+)", re.IGNORECASE | re.DOTALL)
MAX_LISTED = 8
# what reading a damaged or odd archive raises; ValueError: names that are no UTF-8, positions before its start
ZIP_TROUBLE = (
    zipfile.BadZipFile,
    NotImplementedError,
    RuntimeError,
    ValueError,
    EOFError,
    OSError,
    zlib.error,
    lzma.LZMAError,
    struct.error,
)


def member_of(path: str | Path) -> tuple[Path, str | None]:
    """Split ``archive.trz:NAME`` into the archive and the name of its member; None where it has no name."""
    match = IN_ARCHIVE.fullmatch(os.fspath(path))
    if match is None or Path(path).exists():
        return Path(path), None
    return Path(match[1]), match[2]


def members_named(name: str, members: Iterable[str]) -> list[str]:
    """The members of an archive of that path; else of that file name; else of that file name without its suffix."""
    listed = list(members)
    files = [PurePosixPath(member) for member in listed]
    parts = (listed, [file.name for file in files], [file.stem for file in files])
    found = ([listed[k] for k, part in enumerate(names) if part == name] for names in parts)
    return next(filter(None, found), [])


def listed(members: Iterable[str]) -> str:
    """Names of members for a message, the first few."""
    names = sorted(members)
    return ", ".join(names[:MAX_LISTED]) + (", ..." if len(names) > MAX_LISTED else "")
