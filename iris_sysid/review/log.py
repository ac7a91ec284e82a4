"""The log of a review: one JSON object a line, on disk before an edit counts, so that no crash loses one.

The first line says which clip is reviewed and how it is fitted; each other one is an edit, an undo, a redo or a save.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from iris_sysid.errors import DataError, OutputError
from iris_sysid.io.files import read_file
from iris_sysid.review.edits import Edit, parse_edit

LOG_NAME = "review.jsonl"
FORMAT = 1
MAX_LINE = 20_000  # bytes; an edit is far shorter


@dataclass(frozen=True, slots=True)
class Entry:
    """One line: ``what`` was done, and the edit where it was one."""

    what: str
    edit: Edit | None = None


@dataclass(frozen=True, slots=True)
class LoggedReview:
    """What a log holds. ``header`` is its first line; ``whole_bytes`` how much of the file are whole lines."""

    header: Mapping[str, Any]
    entries: tuple[Entry, ...]
    whole_bytes: int


def read_log(path: Path) -> LoggedReview:
    """Read a log; a last line that was cut off, as by a machine that stopped, is left out.

    DataError when another line is damaged, or the file is not a log of a review.
    """
    data = read_file(path)
    whole = data.rfind(b"\n") + 1
    lines = data[:whole].decode("utf-8", "replace").splitlines()
    if not lines:
        raise DataError(f"{path} is empty: it is not a log of a review; delete it to begin again")
    header = _object(path, 1, lines[0])
    if header.get("review") != FORMAT:
        raise DataError(
            f"{path}: its first line has no review: {FORMAT}; it is of another version, or no log of a review"
        )
    entries = tuple(_entry(path, number, line) for number, line in enumerate(lines[1:], start=2) if line.strip())
    return LoggedReview(header, entries, whole)


class LogWriter:
    """Adds lines to a log that nobody else writes to.

    Attributes
    ----------
    path
        The log.
    """

    def __init__(self, path: Path, header: Mapping[str, Any] | None = None, whole_bytes: int = 0) -> None:
        self.path = path
        self._bytes = whole_bytes
        if header is not None:
            self._append({"review": FORMAT, **header}, "xb")
        elif path.stat().st_size > whole_bytes:
            os.truncate(path, whole_bytes)  # a last line that was cut off

    def add(self, entry: Entry, version: int) -> None:
        """Write the line of an entry, with the number of the state that it leads to, and wait until it is on disk.

        OutputError where it cannot be written, or another process has written.
        """
        edit = {} if entry.edit is None else {"edit": entry.edit.model_dump(mode="json")}
        if self.path.is_file() and self.path.stat().st_size != self._bytes:
            raise OutputError(f"another review has written to {self.path} since; end one of the two, and open it again")
        self._append({"version": version, "what": entry.what, **edit}, "ab")

    def _append(self, content: Mapping[str, Any], mode: Literal["ab", "xb"]) -> None:
        line = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
        try:
            with self.path.open(mode) as file:
                file.write(line.encode("utf-8", "replace"))
                file.flush()
                os.fsync(file.fileno())
                self._bytes = file.tell()
        except OSError as error:
            remedy = "the edit was not made; free some space, or allow writing there"
            raise OutputError(f"cannot write {self.path}: {error.strerror}; {remedy}") from error


def _entry(path: Path, number: int, line: str) -> Entry:
    content = _object(path, number, line)
    what = content.get("what")
    if what not in ("edit", "undo", "redo", "save"):
        raise DataError(f"{path}, line {number}: what was done is {what!r:.60}, none of edit, undo, redo, save")
    try:
        return Entry(what, parse_edit(content.get("edit")) if what == "edit" else None)
    except DataError as error:
        raise DataError(f"{path}, line {number}: {error}") from error


def _object(path: Path, number: int, line: str) -> dict[str, Any]:
    try:
        content = json.loads(line) if len(line) <= MAX_LINE else None
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise DataError(
            f"{path}, line {number}, is damaged: {line!r:.60}; repair it, or delete the file to begin again"
        )
    return content
