"""A directory of this user alone, for results that are costly to compute and dangerous to take from others.

Machine code is executed when it is loaded, so it is only read from files that nobody else can have written: directory
and file belong to the user who runs the program, nobody else may write to them, and no symbolic link is followed. A
directory that is not so, or cannot be written, is not used at all: what was sought is then computed anew.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

VARIABLE = "IRIS_SYSID_CACHE"  # a directory; "off" for none
OFF = ("off", "0", "")
NAME = re.compile(r"[0-9a-f]{64}")
LARGEST = 1 << 26  # bytes of a file
MAX_FILES = 1000  # more, and those that were not used for longest are removed
OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH


def cache_directory() -> Path | None:
    """Where the cache is: $IRIS_SYSID_CACHE, else the user's cache directory; None where it is off or unknown."""
    chosen = os.environ.get(VARIABLE)
    if chosen is not None:
        return None if chosen.strip().lower() in OFF else Path(chosen).expanduser()
    if not hasattr(os, "geteuid"):  # no owner to check
        return None
    standard = os.environ.get("XDG_CACHE_HOME", "")
    if Path(standard).is_absolute():
        return Path(standard) / "iris-sysid"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    return home / ("Library/Caches" if sys.platform == "darwin" else ".cache") / "iris-sysid"


def read_private(name: str) -> bytes | None:
    """The content kept under a name (64 hexadecimal digits); None where there is none that can be trusted."""
    with suppress(OSError), _opened_directory(create=False) as directory:
        if directory is None or not NAME.fullmatch(name):
            return None
        descriptor = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=directory)
        with os.fdopen(descriptor, "rb") as file:
            state = os.fstat(descriptor)
            mine = state.st_uid == os.geteuid() and not state.st_mode & OTHERS_WRITE
            if not (stat.S_ISREG(state.st_mode) and mine and state.st_size <= LARGEST):
                return None
            content = file.read(LARGEST)
            with suppress(OSError):
                os.utime(descriptor)  # used now: to be kept
            return content
    return None


def write_private(name: str, content: bytes) -> bool:
    """Keep content under a name (64 hexadecimal digits), whole or not at all; whether it was kept.

    Two processes may do so at once: each writes a file of its own and puts it in place in one step.
    """
    with suppress(OSError), _opened_directory(create=True) as directory:
        if directory is None or not NAME.fullmatch(name) or len(content) > LARGEST:
            return False
        own = f".{name}.{secrets.token_hex(8)}"
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        try:
            with os.fdopen(os.open(own, flags, 0o600, dir_fd=directory), "wb") as file:
                file.write(content)
            os.replace(own, name, src_dir_fd=directory, dst_dir_fd=directory)
        except OSError:
            with suppress(OSError):
                os.unlink(own, dir_fd=directory)
            return False
        _remove_oldest(directory)
        return True
    return False


@contextmanager
def _opened_directory(*, create: bool) -> Iterator[int | None]:
    """The directory, open; None where there is none, or where somebody else could write to it."""
    path = cache_directory()
    if path is None or not hasattr(os, "geteuid"):
        yield None
        return
    if create:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        state = os.fstat(descriptor)
        private = state.st_uid == os.geteuid() and not stat.S_IMODE(state.st_mode) & 0o077
        yield descriptor if private else None
    finally:
        os.close(descriptor)


def _remove_oldest(directory: int) -> None:
    """Remove a quarter of the files, those not used for longest, when there are too many."""
    names = os.listdir(directory)
    if len(names) <= MAX_FILES:
        return
    used = []
    for name in names:
        with suppress(OSError):
            used.append((os.stat(name, dir_fd=directory, follow_symlinks=False).st_mtime_ns, name))
    for _, name in sorted(used)[: MAX_FILES // 4]:
        with suppress(OSError):
            os.unlink(name, dir_fd=directory)
