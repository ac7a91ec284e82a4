"""Checked, read-only copies of arrays for the types of :mod:`iris_sysid.types`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from iris_sysid.errors import DataError

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
MAX_VALUE = 1e60  # fourth powers of it, summed over any number of samples, stay far below the largest float


def frozen_array(values: ArrayLike, shape: tuple[int | None, ...], name: str) -> Array:
    """Copy values to a read-only float64 array and check its shape; None allows any length.

    The values may have any shape, for example (n,) or (n, d), and keep their unit.
    """
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} must hold numbers only: {error}") from error
    if array.ndim != len(shape) or any(
        expected is not None and length != expected for length, expected in zip(array.shape, shape, strict=True)
    ):
        expected_shape = tuple("n" if expected is None else expected for expected in shape)
        raise DataError(f"{name} must have shape {expected_shape}, not {array.shape}")
    array.flags.writeable = False
    return array


def frozen_mask(values: ArrayLike, n: int, name: str) -> Mask:
    """Copy values to a read-only array of booleans; the shape must be (n,)."""
    mask = np.array(values, dtype=np.bool_)
    if mask.shape != (n,):
        raise DataError(f"{name} must have shape ({n},), not {mask.shape}")
    mask.flags.writeable = False
    return mask


def check_size(values: Array, name: str) -> None:
    """Raise DataError where a value, of any shape and unit, is too large for sums of fourth powers of it."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if largest > MAX_VALUE:
        raise DataError(f"{name} of {largest:.3g} is too large to compute with; give it in a larger unit")


def increasing_times(t_s: ArrayLike) -> Array:
    """Copy times in seconds to a read-only array; they must be finite and strictly increase. The shape must be (n,)."""
    times = frozen_array(t_s, (None,), "t_s")
    if times.size == 0:
        raise DataError("t_s is empty: there is no sample")
    if not np.all(np.isfinite(times)):
        raise DataError(f"t_s[{int(np.argmin(np.isfinite(times)))}] is not a finite number")
    step = np.diff(times)
    if np.any(step <= 0):
        k = int(np.argmax(step <= 0))
        raise DataError(
            f"t_s must increase: t_s[{k}] = {times[k]:.6g} >= t_s[{k + 1}] = {times[k + 1]:.6g}; "
            "is the file sorted by time, without duplicates?"
        )
    return times


def runs(mask: Mask) -> list[tuple[int, int]]:
    """(start, stop) of each run of true samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def correlation_matrix(covariance: Array) -> Array:
    """Correlations (k, k) of a covariance (k, k) in any units; not finite where a variance is zero or not known."""
    with np.errstate(all="ignore"):
        sizes = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(sizes, sizes))
