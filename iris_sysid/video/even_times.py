"""Times of frames at an even rate, where the container rounds them to a coarse unit.

Matroska, WebM, Flash and ASF state whole milliseconds: at 60 frames a second a time is off by up to half of one, in
which a body at 1000 px/s moves 0.5 px. Where every stamp agrees with one even rate to within its rounding, the frames
are at that rate; where a single one does not, the rate is uneven and the stamps are all that is known.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

COARSE = Fraction(1, 1000)  # of the frame interval: rounding to less is far below the error of any position
MIN_UNITS = 4  # units of a frame interval: stamps agree with a shorter one by chance
MIN_FRAMES = 12  # frames: fewer may agree with a rate by chance
ROUNDING = 1.0  # units: the largest difference of two roundings, either to the nearest or downwards


@dataclass(frozen=True, slots=True)
class EvenTimes:
    """Frame k of an even rate is at stamp ``first + k interval``, in the container's units."""

    first: int
    interval: Fraction

    def unrounded(self, stamp: int) -> Fraction:
        """The time of the frame with that stamp, in the container's units."""
        return self.first + round((stamp - self.first) / self.interval) * self.interval


def is_coarse(rate: Fraction | None, time_base: Fraction | None) -> bool:
    """Whether frames at that rate (1/s) get rounded times in units of ``time_base`` (s)."""
    if not rate or not time_base:
        return False
    interval = 1 / (rate * time_base)
    return interval.denominator > 1 and MIN_UNITS <= interval < 1 / COARSE


def even_times(stamps: Sequence[int], rates: Iterable[Fraction | None], time_base: Fraction) -> EvenTimes | None:
    """The even rate whose rounded times are the stamps; None where there is none, or nothing is rounded.

    Stamps are those of all frames in display order, in units of ``time_base`` s, with gaps where frames were dropped;
    ``rates`` are those that the header states, 1/s.
    """
    if len(stamps) < MIN_FRAMES:
        return None
    since = np.asarray(stamps, dtype=np.float64) - stamps[0]
    for rate in dict.fromkeys(rates):
        if rate is None or not is_coarse(rate, time_base):
            continue
        interval = 1 / (rate * time_base)
        number = np.rint(since / float(interval))
        rounded = since - number * float(interval)
        if (np.diff(number) >= 1).all() and np.ptp(rounded) <= ROUNDING:
            return EvenTimes(stamps[0], interval)
    return None
