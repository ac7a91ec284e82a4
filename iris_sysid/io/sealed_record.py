"""A test record that only a look opens: sealed in a file that no other command reads, and each look logged.

Beside ``test.sealed`` the file ``test.sealed.looks`` holds one line of JSON a look: its number, the time, the SHA-256
of the record and of the frozen model, and that of all lines before it. The line is written before the record is opened,
so that a look counts even where it fails; a line that is changed or removed later breaks the chain.
"""

from __future__ import annotations

import datetime
import gzip
import hashlib
import json
import os
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from iris_sysid.errors import DataError, OutputError
from iris_sysid.io.csv_cells import sheet_of
from iris_sysid.io.csv_read import trajectory_of_sheet
from iris_sysid.io.dataframes import to_frame
from iris_sysid.io.files import MAX_BYTES, check_writable, json_text, origin_of, read_file, sha256_of, write_atomic
from iris_sysid.io.table_cells import SEALED
from iris_sysid.types import Trajectory

LOG = ".looks"
GZIP = 16 + zlib.MAX_WBITS  # the format that zlib reads
FIELDS = {"look": int, "utc": str, "record": str, "model": str, "name": str, "previous": str}


@dataclass(frozen=True, slots=True)
class LoggedLook:
    """One look at a record: its number, the time, the SHA-256 of record and frozen model, and the model's ``name``.

    ``previous`` is the SHA-256 of all lines before this one.
    """

    look: int
    utc: str
    record: str
    model: str
    name: str
    previous: str


def seal(record: Trajectory, path: str | Path, *, overwrite: bool = False) -> Path:
    """Write the positions and inputs of a record, exactly, into a ``.sealed`` file that only :func:`open_sealed` reads.

    OutputError when it exists, cannot be written, has another suffix, or was looked at: then it is never replaced.
    """
    path = Path(path)
    if path.suffix != SEALED:
        raise OutputError(f"cannot seal a record in {path}: give a name that ends in {SEALED}")
    if log_of(path).exists():
        raise OutputError(f"{path} was looked at, and {log_of(path).name} counts these looks; give another name")
    frame = to_frame(record.with_(smoothed=None, segments=()))
    flags = {name: frame[name].astype("Int8") for name in ("valid",) if name in frame}
    table = frame.assign(**flags).to_csv(index=False, lineterminator="\n")
    return write_atomic(path, gzip.compress(table.encode(), mtime=0), overwrite=overwrite)


def open_sealed(path: str | Path, model: str, name: str) -> tuple[Trajectory, tuple[LoggedLook, ...]]:
    """Log a look at a sealed record and open it: the record, and every look at it with this one the last.

    ``model`` is the SHA-256 of the frozen model by :func:`model_hash`, ``name`` what the log calls it. DataError when
    the file is not a sealed record, or its log was changed; OutputError when the look cannot be logged: the record is
    not opened then.
    """
    data = read_file(path)
    if Path(path).suffix != SEALED:
        raise DataError(f"{path} is not sealed; iris-sysid sealed TABLE --keep 20% -o FOLDER seals the end of a table")
    looks = log_look(log_of(path), sha256_of(path), model, name)
    return _unsealed(data, Path(path)), looks


def log_of(path: str | Path) -> Path:
    """Path of the log of looks at a sealed record."""
    return Path(f"{path}{LOG}")


def model_hash(equation: str, values: Mapping[str, float], how: Sequence[str] = ()) -> str:
    """SHA-256 of a frozen model: its equation, its values by name, and how it is simulated."""
    content = {"equation": equation, "values": dict(sorted(values.items())), "how": list(how)}
    return hashlib.sha256(json_text(content).encode()).hexdigest()


def looks_in(log: str | Path) -> tuple[LoggedLook, ...]:
    """The looks that a log holds; none where there is no log.

    DataError when a line cannot be read, or the lines before it are no longer those that it was written after.
    """
    if not Path(log).exists():
        return ()
    looks: list[LoggedLook] = []
    before = b""
    for line in read_file(log).splitlines(keepends=True):
        look = _look_of(line, f"{log}, line {len(looks) + 1}")
        if look.look != len(looks) + 1 or look.previous != hashlib.sha256(before).hexdigest():
            raise DataError(f"{log}, line {len(looks) + 1}: lines before it were changed or removed; restore the log")
        looks.append(look)
        before += line
    return tuple(looks)


def log_look(log: str | Path, record: str, model: str, name: str) -> tuple[LoggedLook, ...]:
    """Append a look to a log, whole or not at all, and return all looks with it the last.

    Parameters
    ----------
    log
        File of one line a look; made where there is none.
    record, model
        SHA-256 of the record and of the frozen model.
    name
        What the log calls the model.

    Raises
    ------
    DataError
        As for :func:`looks_in`.
    OutputError
        When the log cannot be written, or another look is being logged.
    """
    path = check_writable(log, overwrite=True)
    with _only_writer(path):
        looks = looks_in(path)
        before = read_file(path) if looks else b""
        now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        look = LoggedLook(len(looks) + 1, now, record, model, name, hashlib.sha256(before).hexdigest())
        write_atomic(path, before + f"{json.dumps(asdict(look))}\n".encode(), overwrite=True)
    return (*looks, look)


def counted(looks: Sequence[LoggedLook]) -> str:
    """How many looks there were, and by how many models: ``3 looks by 2 models``."""
    models = len({look.model for look in looks})
    several = f" by {models} model{'s' * (models > 1)}" if looks else ""
    return f"{len(looks)} look{'s' * (len(looks) != 1)}{several}"


@contextmanager
def _only_writer(log: Path) -> Iterator[None]:
    """A file that only one process can make stands beside the log while it is written."""
    lock = log.with_name(f"{log.name}.lock")
    try:
        os.close(os.open(lock, os.O_CREAT | os.O_EXCL | os.O_WRONLY))
    except FileExistsError as error:
        raise OutputError(f"another look is being logged in {log}; if none is, remove {lock.name}") from error
    except OSError as error:
        raise OutputError(f"cannot log a look in {log}: {error.strerror}; the record stays sealed") from error
    try:
        yield
    finally:
        lock.unlink()


def _look_of(line: bytes, where: str) -> LoggedLook:
    with suppress(ValueError, AttributeError, RecursionError):
        content = json.loads(line)
        if {key: type(value) for key, value in content.items()} == FIELDS:
            return LoggedLook(**content)
    raise DataError(f"{where}: this is not a look as iris-sysid logs it; restore the log")


def _unsealed(data: bytes, path: Path) -> Trajectory:
    try:
        reader = zlib.decompressobj(GZIP)
        table = reader.decompress(data, MAX_BYTES)
    except zlib.error as error:
        raise DataError(f"{path} is not a record that iris-sysid sealed: {error!s:.100}") from error
    if not reader.eof:
        raise DataError(f"{path} is cut short, or unpacks to more than {MAX_BYTES / 1e6:.0f} MB")
    return trajectory_of_sheet(sheet_of(table, str(path)), origin_of(path, {}))
