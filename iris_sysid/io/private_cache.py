"""A directory of this user alone, for results that are costly to compute and dangerous to take from others.

Machine code is executed when it is loaded, so it is only read from a directory that belongs to the user who runs the
program and that nobody else can enter. Any other one, and one that cannot be written, is not used at all: what was
sought is then computed anew.
"""

from __future__ import annotations

import os
import re
import secrets
import stat
import sys
from contextlib import suppress
from pathlib import Path

VARIABLE = "IRIS_SYSID_CACHE"  # a directory; "off" for none
OFF = ("off", "0", "")
NAME = re.compile(r"[0-9a-f]{64}")
MAX_BYTES = 1 << 26  # of a file
MAX_FILES = 1000  # more, and those that were not used for longest are removed


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
    with suppress(OSError):
        file = _private(name)
        if file is not None and file.stat().st_size <= MAX_BYTES:
            content = file.read_bytes()
            os.utime(file)  # used now: to be kept
            return content
    return None


def write_private(name: str, content: bytes) -> bool:
    """Keep content under a name (64 hexadecimal digits), whole or not at all; whether it was kept.

    Two processes may do so at once: each writes its own file and puts it in place in one step.
    """
    with suppress(OSError):
        file = _private(name, create=True)
        if file is None or len(content) > MAX_BYTES:
            return False
        own = file.with_name(f".{name}.{secrets.token_hex(8)}")
        try:
            own.write_bytes(content)
            own.replace(file)
        finally:
            own.unlink(missing_ok=True)
        _remove_oldest(file.parent)
        return True
    return False


def _private(name: str, *, create: bool = False) -> Path | None:
    """The file of a name; None where there is no directory, or where somebody else could enter it."""
    path = cache_directory()
    if path is None or not hasattr(os, "geteuid") or not NAME.fullmatch(name):
        return None
    if create:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
    state = path.lstat()
    private = stat.S_ISDIR(state.st_mode) and state.st_uid == os.geteuid() and not stat.S_IMODE(state.st_mode) & 0o077
    return path / name if private else None


def _remove_oldest(directory: Path) -> None:
    """Remove a quarter of the files, those not used for longest, when there are too many."""
    files = list(directory.iterdir())
    if len(files) <= MAX_FILES:
        return
    used = []
    for file in files:
        with suppress(OSError):
            used.append((file.stat().st_mtime_ns, file))
    for _, file in sorted(used)[: MAX_FILES // 4]:
        file.unlink(missing_ok=True)
