"""Moments at which something sudden may have happened."""

from __future__ import annotations

import numpy as np

from iris_sysid.types import Array, Parameter

FEWEST, MOST = 8, 40
SAMPLES_EACH = 10  # between two moments, unless that makes too many
WIDTH = 1.0  # frame intervals: sudden for the camera, smooth for the integrator


def moments(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """Times (s) spread evenly over the clip, its ends left out, and how sudden (s) it is.

    Parameters
    ----------
    t_s
        (n,) s.
    observed
        (n, d), not used.
    """
    count = int(np.clip(t_s.size // SAMPLES_EACH, FEWEST, MOST))
    return [(float(when), sudden(t_s)) for when in np.linspace(t_s[0], t_s[-1], count + 2)[1:-1]]


def sudden(t_s: Array) -> float:
    """How long (s) something sudden lasts in a clip with these times (n,)."""
    return WIDTH * frame_interval(t_s)


def frame_interval(t_s: Array) -> float:
    """The usual time (s) between two samples at these times (n,)."""
    return float(np.median(np.diff(t_s)))


def start_parameter(name: str) -> Parameter:
    """The time from which an effect counts: that of the first sample, so that no result depends on the clock's zero."""
    return Parameter(name, "s", "t_0", default=0.0, constant=True, source="a diagnosis takes the first sample used")


def first_time(t_s: Array, observed: Array) -> list[tuple[float, ...]]:
    """The time (s) of the first of the samples (n,), as the only value to try; ``observed`` (n, d) is not used."""
    return [(float(t_s[0]),)]
