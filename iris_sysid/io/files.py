"""Files whole or not at all, and where each came from: atomic writes, hashes, origins, strict JSON."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import platform
import secrets
import stat
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from iris_sysid.errors import DataError, OutputError
from iris_sysid.io.archives import member_of
from iris_sysid.io.windows_paths import length_trouble, name_trouble

# What the numbers depend on: ours, and the packages that compute.
PACKAGES = (
    "iris-sysid",
    "numpy",
    "scipy",
    "numba",
    "lmfit",
    "filterpy",
    "pandas",
    "pysindy",
    "opencv-contrib-python-headless",
    "av",
)
LEFT_S = 3600.0  # a temporary file without its process is left over after so long
MAX_BYTES = 256_000_000  # of a table or document that is read whole: some millions of rows
WINDOWS = os.name == "nt"
DISK_TROUBLE = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)


# --------------------------------------------------------------------------- writing


def check_writable(path: str | Path, *, overwrite: bool = False) -> Path:
    """Raise OutputError now rather than after the work, when ``path`` cannot be written; ``overwrite`` allows a file.

    Returns the path that will be written, symbolic links followed. Nothing is created or changed.
    """
    try:
        trouble = name_trouble(PureWindowsPath(path)) if WINDOWS else ""
        if trouble:
            raise OutputError(f"cannot write {path}: {trouble}; give another path")
        target = Path(os.path.realpath(path))
        parent = next(folder for folder in target.parents if folder.exists())
        _check_target(path, target, overwrite=overwrite)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise OutputError(f"cannot write {path}: {_reason(error)}; give another path") from error
    if not parent.is_dir():
        raise OutputError(f"cannot write {path}: {parent} is a file, not a folder; give another path")
    if not os.access(parent, os.W_OK | os.X_OK):
        raise OutputError(f"cannot write {path}: no permission to write in {parent}; choose another folder")
    return target


def check_folder(folder: str | Path, names: Iterable[str], *, overwrite: bool = False) -> Path:
    """Raise OutputError as :func:`check_writable` where a file of these ``names`` cannot be written into a folder."""
    for name in names:
        check_writable(Path(folder) / name, overwrite=overwrite)
    return Path(folder)


def _check_target(path: str | Path, target: Path, *, overwrite: bool) -> None:
    if target.is_dir():
        raise OutputError(f"cannot write {path}: it is a folder; give the name of a file in it")
    if not target.exists():
        return
    if not target.is_file():
        raise OutputError(f"cannot write {path}: it is a device or pipe, not an ordinary file; give a file name")
    if not overwrite:
        raise OutputError(f"{path} exists already; give another name, or --force to replace it")


def write_atomic(path: str | Path, content: str | bytes, *, overwrite: bool = False) -> Path:
    """Write a whole file or nothing: to a temporary file beside it, flushed to disk, then renamed; its path as given.

    Folders that are missing are made, a symbolic link is followed, text is written as UTF-8 with its line ends as they
    are. OutputError when the path exists (``overwrite`` replaces a file), is a folder or cannot be written.
    """
    data = content.encode("utf-8", "replace") if isinstance(content, str) else content
    with atomic_path(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(data)
    return Path(path)


@contextmanager
def atomic_path(path: str | Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Give a writer a temporary path of the same suffix; it becomes ``path`` when the block ends without an error.

    The temporary file exists and is empty, in the same folder; on any error it is removed and ``path`` is untouched.
    Raises OutputError as :func:`write_atomic` does, at the start of the block where possible.
    """
    target = check_writable(path, overwrite=overwrite)
    temporary = target.with_name(f"{_own_prefix()}{os.getpid()}-{secrets.token_hex(6)}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_leftovers(target.parent)
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        long = length_trouble(PureWindowsPath(temporary)) if WINDOWS else ""
        raise OutputError(f"cannot write {path}: {_reason(error)}{long}; choose another folder") from error
    try:
        yield temporary
        _publish(temporary, target, path, overwrite=overwrite)
    except OSError as error:
        if error.errno not in DISK_TROUBLE:
            raise
        raise OutputError(f"cannot write {path}: {_reason(error)}; free some space or choose another disk") from error
    finally:
        with suppress(FileNotFoundError):
            temporary.unlink()


@cache
def _own_prefix() -> str:
    """Beginning of the names of this machine's temporary files."""
    return f".iris-{hashlib.sha256(platform.node().encode()).hexdigest()[:6]}-"


@cache
def remove_leftovers(folder: Path) -> None:
    """Remove the temporary files that killed processes of this machine left in a folder, once a folder and process."""
    for path in folder.glob(f"{_own_prefix()}*-*"):
        number = path.name.removeprefix(_own_prefix()).partition("-")[0]
        with suppress(OSError):
            old = time.time() - path.stat().st_mtime > LEFT_S
            if number.isdecimal() and old and not _is_running(int(number)):
                path.unlink()


def _is_running(process: int) -> bool:
    if WINDOWS:  # there signal 0 is Ctrl-C; a file that is in use cannot be removed
        return False
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # of another user, or no number of a process
        return True
    return True


def _publish(temporary: Path, target: Path, path: str | Path, *, overwrite: bool) -> None:
    try:
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
    except FileNotFoundError as error:
        raise OutputError(f"nothing was written to {path}") from error
    _check_target(path, target, overwrite=overwrite)  # again: it may have come into being meanwhile
    try:
        temporary.replace(target)
    except PermissionError as error:  # Windows replaces no file that is open
        raise OutputError(
            f"cannot replace {path}: another program has it open; close it there, and try again"
        ) from error


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error)


# --------------------------------------------------------------------------- reading


def read_file(path: str | Path) -> bytes:
    """The bytes of an ordinary file of at most MAX_BYTES.

    Raises DataError for what cannot be read, is larger, or is a folder, device or pipe, which may never end.
    """
    try:
        about = Path(path).stat()
        if stat.S_ISREG(about.st_mode) and about.st_size <= MAX_BYTES:
            return Path(path).read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise DataError(f"cannot read {path}: {_reason(error)}") from error
    if not stat.S_ISREG(about.st_mode):
        kind = "a folder" if stat.S_ISDIR(about.st_mode) else "a device or pipe, not an ordinary file"
        raise DataError(f"cannot read {path}: it is {kind}")
    size, most = about.st_size / 1e6, MAX_BYTES / 1e6
    raise DataError(f"{path} has {size:.0f} MB; at most {most:.0f} MB are read: split it")


# --------------------------------------------------------------------------- origin


def sha256_of(path: str | Path) -> str:
    """The SHA-256 of a file's bytes as 64 hexadecimal digits; of a folder, that of its files' names and hashes.

    Of ``archive.trz:NAME``, that of the archive. Raises DataError when it cannot be read.
    """
    path, _ = member_of(path)
    try:
        if path.is_dir():
            return _sha256_of_folder(path)
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise DataError(f"cannot read {path}: {_reason(error)}") from error


def _sha256_of_folder(folder: Path) -> str:
    digest = hashlib.sha256()
    for file in sorted(path for path in folder.rglob("*") if path.is_file()):
        digest.update(f"{os.fspath(file.relative_to(folder))}\0{sha256_of(file)}\n".encode("utf-8", "surrogateescape"))
    return digest.hexdigest()


def origin_of(source: str | Path | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """Record the origin of a result reproducibly: without time stamp and without the folders of this machine.

    ``source`` is the file, or folder of images, that was read (None for data made in memory); ``options`` are
    everything else that the result depends on, a seed included; paths are kept as names only. The record holds
    ``source`` (name), ``sha256``, ``options``, ``versions`` of the packages that compute, ``python``. DataError when
    the source cannot be read, or an option cannot be written as JSON.
    """
    return {
        "source": None if source is None else _plain(Path(source)),
        "sha256": None if source is None else sha256_of(source),
        "options": {key: _plain(options[key]) for key in sorted(options)},
        "versions": dict(_versions()),
        "python": platform.python_version(),
    }


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    versions = []
    for package in PACKAGES:
        with suppress(PackageNotFoundError):
            versions.append((package, version(package)))
    return tuple(versions)


# --------------------------------------------------------------------------- JSON


def json_text(value: Any) -> str:
    """Write a value as strict JSON text, the same bytes each time, ending in a line feed.

    Mappings keep their order, sets are sorted, numpy numbers and arrays become numbers and lists, paths their names.
    Floats are the shortest text that reads back exactly; NaN and infinity become ``null``. Raises DataError for a
    value that JSON cannot hold.
    """
    return json.dumps(_plain(value), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _plain(value: Any) -> Any:
    """The value converted to JSON types."""
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, str | Path):
        return _text(value)
    if isinstance(value, float | np.generic | np.ndarray):
        return _plain_number(value)
    if isinstance(value, Mapping):
        return {_text(str(key)): _plain(item) for key, item in value.items()}
    if isinstance(value, set | frozenset):
        return [_plain(item) for item in sorted(value)]
    if isinstance(value, Sequence):
        return [_plain(item) for item in value]
    raise DataError(
        f"cannot write {value!r:.60} as JSON: {type(value).__name__} is not a number, text, list or mapping"
    )


def _plain_number(value: Any) -> Any:
    if isinstance(value, float):  # np.float64 is one
        return float(value) if math.isfinite(value) else None
    return _plain(value.tolist() if isinstance(value, np.ndarray) else value.item())


def _text(value: str | Path) -> str:
    text = value.name or str(value) if isinstance(value, Path) else value
    return text.encode("utf-8", "replace").decode("utf-8")  # file names may hold bytes that are not text
