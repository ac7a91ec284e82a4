"""What a value needs to be known better: further clips, or a smaller error of what all clips share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitters.ode.error_budget import RANDOM

MAX_CLIPS = 100  # nobody films more
MIN_FACTOR = 0.01  # factor on an error below which nobody measures better


@dataclass(frozen=True, slots=True)
class Need:
    """One way to a smaller standard error: ``clips`` more as today's, and the error of ``source`` times ``factor``.

    ``source`` is empty where all systematic errors may stay.
    """

    clips: int
    source: str = ""
    factor: float = 1.0


def needs(parts: Mapping[str, float], repeated: float, wanted: float) -> tuple[Need, ...]:
    """The ways to a standard error: clips alone, and the largest systematic error made smaller; empty where none is.

    Random errors become smaller with the information of each further clip, systematic ones stay: they are common to
    all clips of a set-up.

    Parameters
    ----------
    parts
        Today's standard errors by source, in the unit of the value.
    repeated
        The random one with one clip more.
    wanted
        The standard error that is wanted, of all sources together.
    """
    random = parts[RANDOM]
    systematic = {source: part for source, part in parts.items() if source != RANDOM and part > 0}
    left = wanted**2 - sum(part**2 for part in systematic.values())
    alone = _clips(random, repeated, left)
    ways = [] if alone is None else [Need(alone)]
    if systematic and alone != 0:
        source, error = max(systematic.items(), key=lambda item: item[1])
        better = _with_better(random, repeated, left + error**2, error)
        if better is not None and (alone is None or better[0] < alone):
            ways.append(Need(better[0], source, better[1]))
    return tuple(ways)


def _random(today: float, repeated: float, clips: int) -> float:
    """Variance of the random part with that many more clips: each adds what the first repeat adds."""
    if today == 0:
        return 0.0
    added = max(repeated**-2.0 - today**-2.0, 0.0)
    return 1.0 / (today**-2.0 + clips * added)


def _clips(today: float, repeated: float, variance: float) -> int | None:
    """How many clips more bring the random variance down to this; None where no number does."""
    counts = range(MAX_CLIPS + 1)
    return next((count for count in counts if _random(today, repeated, count) <= variance), None)


def _with_better(today: float, repeated: float, variance: float, error: float) -> tuple[int, float] | None:
    """Clips more, and the factor on a systematic error, that leave this variance; as few clips as make it possible."""
    for count in range(MAX_CLIPS + 1):
        left = variance - _random(today, repeated, count)
        if left > (MIN_FACTOR * error) ** 2:
            return count, min(float(np.sqrt(left)) / error, 1.0)
    return None
