"""Tables in files of arrays: MATLAB's .mat up to version 7 and NumPy's .npy, as benchmarks ship them.

SciPy and NumPy read them; here is only decided which arrays are columns. Objects are never unpickled.
"""

from __future__ import annotations

import io
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.io.files import MAX_BYTES
from iris_sysid.types import Array

NUMPY, MATLAB, HDF5 = b"\x93NUMPY", b"MATLAB 5.0 MAT-file", b"\x89HDF\r\n\x1a\n"
HEADER, TAG, COMPRESSED = 128, 8, 15  # bytes of a .mat's header and of an element's tag, type of a compressed one
PIECE = 1 << 20  # bytes unpacked at once
SAMPLE_TIMES, SAMPLE_RATES = ("ts", "dt", "t_sample", "sampletime"), ("fs", "f_s", "samplerate")
REMEDY = "save the columns as CSV, or as plain arrays of numbers (in MATLAB with save -v7)"
NUMBERS = "iufb"  # kinds of NumPy's types

Columns = tuple[tuple[str, ...], list[Array], tuple[str, ...]]  # titles, columns (n,), notes on the others


def is_array_file(data: bytes) -> bool:
    """Whether the bytes of a file begin as those of a .mat or .npy file do."""
    return data.startswith((NUMPY, MATLAB, HDF5)) or (data[:6] == MATLAB[:6] and b"HDF5" in data[:HEADER])


def array_columns(data: bytes, label: str) -> Columns:
    """The columns (n,) of the arrays in a file, or of the fields of its only one, by title; Ts or fs gives the times.

    ``data`` are the file's bytes, ``label`` is its name in messages. DataError when it is damaged, of another version,
    unpacks to too much, or holds no columns of numbers.
    """
    if data.startswith(NUMPY):
        return _titled(_numpy_arrays(data, label), label)
    if not data.startswith(MATLAB):
        raise DataError(f"{label} is a MATLAB file of version 7.3, which is not read; {REMEDY}")
    return _titled(_matlab_arrays(data, label), label)


def _numpy_arrays(data: bytes, label: str) -> dict[str, Array]:
    """The array of a .npy file without a name; its fields by name where it has some."""
    try:
        array: Any = np.load(io.BytesIO(data), allow_pickle=False, max_header_size=10_000)
        return {name: array[name] for name in array.dtype.names or ()} or {"": array}
    except (ValueError, OSError, EOFError, MemoryError, TypeError, SyntaxError) as error:
        raise DataError(f"{label} cannot be read as a .npy file: {str(error).splitlines()[0]:.200}") from error


def _matlab_arrays(data: bytes, label: str) -> dict[str, Array]:
    """The numeric arrays of a .mat file by name; those in structures as ``structure.field``."""
    from scipy.io import loadmat

    _check_unpacked(data, label)
    file: Any = io.BytesIO(data)  # the stubs know paths only
    try:
        found = loadmat(file, simplify_cells=True, mat_dtype=True)
    except Exception as error:  # whatever SciPy raises on damaged files, of several kinds
        raise DataError(f"{label} cannot be read as a .mat file: {str(error)[:200]}; {REMEDY}") from error
    return dict(_flat({name: value for name, value in found.items() if not name.startswith("__")}))


def _check_unpacked(data: bytes, label: str) -> None:
    """DataError where a .mat file unpacks to more than a table may have."""
    order = "little" if data[126:128] == b"IM" else "big"
    at, left = HEADER, MAX_BYTES
    while at + TAG <= len(data):
        kind, size = (int.from_bytes(data[at + k : at + k + 4], order) for k in (0, 4))  # type: ignore[arg-type]
        at += TAG
        unpacked = _unpacked_size(data[at : at + size], left) if kind == COMPRESSED else size
        left -= unpacked
        if left < 0:
            raise DataError(f"{label} unpacks to more than {MAX_BYTES / 1e6:.0f} MB: split it")
        at += size


def _unpacked_size(packed: bytes, most: int) -> int:
    """Number of bytes that packed ones unpack to, counted up to a little more than ``most``."""
    unpack, size = zlib.decompressobj(), 0
    try:
        while packed and size <= most:
            size += len(unpack.decompress(packed, PIECE))
            packed = unpack.unconsumed_tail
    except zlib.error:  # the reader says what is wrong
        return size
    return size


def _flat(values: Mapping[str, object], within: str = "") -> Iterator[tuple[str, Array]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{within}{name}.")
        elif not isinstance(value, (str, list)):
            array = np.asarray(value)
            if array.dtype.kind in NUMBERS:
                yield f"{within}{name}", array


# --------------------------------------------------------------------------- which arrays are columns


def _titled(arrays: Mapping[str, Array], label: str) -> Columns:
    """The columns of the usual length; one name for a single column, names with numbers for several."""
    numbers = {name: array for name, array in arrays.items() if array.dtype.kind in NUMBERS}
    tables = {name: _upright(array) for name, array in numbers.items() if 0 < array.ndim <= 2 and array.size > 1}
    if not tables:
        found = ", ".join(f"{name} {array.dtype} {array.shape}".strip() for name, array in arrays.items())
        raise DataError(f"{label} holds no columns of numbers (arrays: {found or 'none':.200}); {REMEDY}")
    count = max(Counter(len(table) for table in tables.values()).items(), key=lambda item: (item[1], item[0]))[0]
    kept = {name: table for name, table in tables.items() if len(table) == count}
    titles = list(chain.from_iterable(_titles(name, table.shape[1]) for name, table in kept.items()))
    columns = list(chain.from_iterable(table.T for table in kept.values()))
    left = [name for name in arrays if name not in kept]
    said = [f"left out, not {count} numbers long: {', '.join(left[:8])}"] if left else []
    step_s = _sample_time(numbers)
    if step_s is not None and not any(title.lower() in ("t", "time") for title in titles):
        titles, columns = ["t (s)", *titles], [step_s * np.arange(count), *columns]
        said = [f"times every {step_s:g} s, as the file states"]
    return tuple(titles), columns, tuple(said)


def _upright(array: Array) -> Array:
    """A row or a column as (n, 1), a table with its longer side downwards, as floats."""
    table = array.reshape(-1, 1) if array.ndim == 1 else array
    return (table.T if table.shape[0] < table.shape[1] else table).astype(np.float64)


def _titles(name: str, count: int) -> Sequence[str]:
    return [name] if count == 1 and name else [f"{name}{k}" for k in range(1, count + 1)]


def _sample_time(arrays: Mapping[str, Array]) -> float | None:
    """The sample time in s that a scalar of a usual name states."""
    scalars = {
        name.rpartition(".")[2].lower(): float(array.ravel()[0]) for name, array in arrays.items() if array.size == 1
    }
    steps = [scalars[name] for name in SAMPLE_TIMES if name in scalars]
    steps += [1.0 / scalars[name] for name in SAMPLE_RATES if scalars.get(name, 0.0) != 0.0]
    return next((step for step in steps if 0.0 < step < np.inf), None)
