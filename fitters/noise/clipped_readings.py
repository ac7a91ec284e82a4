"""Readings at the end of a sensor's range: runs of its largest or smallest value where the motion went on beyond it.

Such a reading says only that the quantity was at or beyond the limit; as a measured value it would bend the fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from fitters.noise.reading_step import STEP_TO_SD, reading_step
from iris_sysid.types import Array, Mask, Trajectory, runs

MIN_RUN = 3  # equal readings in a row: noise repeats the largest value of a record once or twice by chance
MIN_BESIDE = 6  # samples beside a run that a parabola is fitted to: twice its values
FOLLOWED = 2.0  # errors of a value that a parabola may be off where it follows the samples
SURE = 3.0  # standard errors beyond the limit on each side of a run: by chance in 2 of 1e6 runs
THIRD = 1.4826 / np.sqrt(20.0)  # of the median absolute third difference: standard deviation of white normal noise


@dataclass(frozen=True, slots=True)
class Clipping:
    """The samples (n,) of a quantity that read the end of its range, in the quantity's unit."""

    name: str
    unit: str
    limit: float
    samples: Mask

    def __str__(self) -> str:
        count, total = int(self.samples.sum()), self.samples.size
        limit = f"{self.limit:.6g} {self.unit}, the end of the sensor's range"
        return (
            f"{self.name} is clipped at {limit}: {count} of {total} samples ({100 * count / total:.2g} %) are left out"
        )


def clippings(trajectory: Trajectory) -> tuple[Clipping, ...]:
    """The clipped readings of each quantity: its largest or smallest value, in runs that both sides lead beyond.

    Parabolas through the samples on either side of a run are continued into it; where both lead beyond the limit by the
    sensor's step and several standard errors, the run is clipped, and so is every other reading of that value. A run at
    an end of the record, where a body rests, and the reading zero are never taken for it.

    Parameters
    ----------
    trajectory
        As it was read.
    """
    return tuple(found for column in range(len(trajectory.quantities)) for found in _of(trajectory, column))


def without_clipped(trajectory: Trajectory) -> Trajectory:
    """The trajectory with its clipped samples as gaps, which are not fitted.

    ``origin["clipped_readings"]`` says how many, a sentence a quantity.

    Parameters
    ----------
    trajectory
        As it was read: limits are the largest and the smallest value of each quantity.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import Quantity, Trajectory, without_clipped
    >>> t_s = np.arange(100) / 10
    >>> y = np.minimum(np.sin(t_s), 0.9)[:, None]
    >>> read = Trajectory(t_s, (Quantity("y", "V"),), y, np.full_like(y, np.nan), np.ones(100, bool))
    >>> int(without_clipped(read).valid.sum())
    82
    """
    found, valid = clippings(trajectory), np.array(trajectory.valid)
    for each in found:
        valid &= ~each.samples
    said = {**trajectory.origin, "clipped_readings": [str(each) for each in found]}
    return trajectory.with_(valid=valid, origin=said) if found and valid.sum() > 1 else trajectory


def _of(trajectory: Trajectory, column: int) -> Iterator[Clipping]:
    known = np.flatnonzero(trajectory.valid)
    t_s, values = trajectory.t_s[known], trajectory.position[known, column]
    if known.size < 2 * MIN_BESIDE + MIN_RUN:
        return
    step, inside = reading_step(values), values[(values > values.min()) & (values < values.max())]
    error = max(THIRD * float(np.median(np.abs(np.diff(inside, 3)))), STEP_TO_SD * step) if inside.size > 3 else step
    for sign in (1.0, -1.0):
        limit = float(sign * np.max(sign * values))
        at, limits = values == limit, (sign * limit + step, error)
        long = [run for run in runs(at) if run[1] - run[0] >= MIN_RUN]
        if limit != 0 and any(_goes_on(t_s, sign * values, at, run, limits) for run in long):
            samples = np.zeros(trajectory.n, dtype=np.bool_)
            samples[known[at]] = True
            quantity = trajectory.quantities[column]
            yield Clipping(quantity.name, quantity.unit, limit, samples)


def _goes_on(t_s: Array, values: Array, at: Mask, run: tuple[int, int], limits: tuple[float, float]) -> bool:
    """Whether both sides of a run lead beyond the first of ``limits``; the second is the error of a value."""
    first, stop = run
    before, after = np.flatnonzero(~at[:first])[::-1], stop + np.flatnonzero(~at[stop:])
    return all(
        _leads_on(t_s[side] - t_s[edge], values[side], stop - first, *limits)
        for side, edge in ((before, first), (after, stop - 1))
    )


def _leads_on(t_s: Array, values: Array, count: int, limit: float, error: float) -> bool:
    """Whether the parabola through samples, the nearest to the edge at time zero first, leads beyond the limit.

    Through as many as the run has, if a parabola follows them, else fewer; it is asked a third of their length further.
    """
    count = max(min(count, values.size), MIN_BESIDE)
    if values.size < MIN_BESIDE:
        return False
    near, powers = values[:count], (t_s[:count] / t_s[count - 1])[:, None] ** np.arange(3)
    inverse = np.linalg.pinv(powers)
    spread = float(np.std(near - powers @ (inverse @ near))) * np.sqrt(count / (count - 3))
    if spread > FOLLOWED * error and count > MIN_BESIDE:
        return _leads_on(t_s, values, count // 2, limit, error)
    weights = (-np.ones(3) / 3) ** np.arange(3) @ inverse
    return bool(weights @ near - limit > SURE * max(error, spread) * float(np.linalg.norm(weights)))
