"""The rate at which a phone recorded, which its slow-motion files state, against the times of the file."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from iris_sysid.types import Array, Doubt

STATED = "capture_rate"  # among the facts of a video, 1/s
SAME = 0.08  # natural logarithm: the rate of a phone's camera varies


def capture_rate_doubt(facts: Mapping[str, object], t_s: Array) -> Doubt | None:
    """A doubt where the facts of a video state another rate than its times (n,), s, show; None otherwise.

    ``capture_rate`` is what a phone wrote into it; the times are those of the frames, as they are used.
    """
    recorded = facts.get(STATED)
    if not isinstance(recorded, float) or len(t_s) < 2:
        return None
    played = 1.0 / float(np.median(np.diff(t_s)))
    if abs(math.log(recorded / played)) < SAME:
        return None
    finding = (
        f"slow motion: the file says that it was recorded at {recorded:.4g} fps, its times are those of {played:.3g}"
    )
    return Doubt("clock", finding, f"give --fps {recorded:.4g}")
